//! One object in sight over time: where each view saw it last, and which boxes of the next tick continue that.

use std::collections::VecDeque;

use dataset::tables::pixel_box::PixelBox;
use glam::DVec2;

use super::path::Sighting;
use crate::samples::trusted_boxes::centre_and_size;
use crate::samples::trusted_boxes::other_boxes::Candidate;

/// Boxes of this time give the motion in an image, seconds, ...
const MOTION_S: f64 = 10.0;
/// ... and boxes of this time show whether it moves or grows, no more of them than one in a second. An aircraft that comes straight at a
/// camera from 13 NM stays where it is in the image and grows by 0.3 % per second: ten seconds of boxes show that from 4 NM on, a minute
/// of them from the beginning.
const REMEMBERED_S: f64 = 60.0;
const STEP_S: f64 = 1.0;
/// A shorter time gives no motion, seconds.
const MIN_MOTION_S: f64 = 2.0;
/// Objects that move less, pixels per second, and grow less, in parts of the width over the time that is remembered, stand still: at
/// 10 NM, an aircraft 300 m to the side of a mast moves six times as much, and any aircraft grows by twice as much in ten seconds.
const STILL_PX_S: f64 = 0.1;
const STILL_GROWTH: f64 = 0.02;
/// A still object exceeds that by chance: the centre and the width of a box of a far thing have these standard deviations, pixels, ...
const CENTRE_SD_PX: f64 = 0.35;
const WIDTH_SD_PX: f64 = 1.3;
/// ... so motion and growth have to be so many standard errors. Chance moves one thing in three thousand that far. An aircraft that moves
/// by 0.6 px/s does so within five seconds, and one that moves by 0.15 px/s within ten.
const SURE: f64 = 4.0;
/// Distance of a box from where it is expected, in widths of the box: at once, and per second since, with a known motion and without. An
/// airliner at 2 NM moves by a fifth of its width in a second.
const AWAY_AT_ONCE: f64 = 1.0;
const AWAY_PER_S: f64 = 0.1;
const AWAY_PER_S_WITHOUT_MOTION: f64 = 0.3;
/// A box of the same track may be this much farther away ...
const SAME_TRACK: f64 = 3.0;
/// ... and larger or smaller: fog may hide parts of it.
const SAME_TRACK_GROWTH: f64 = 1.5;
/// What a view saw longer ago says nothing about a box that other views agree with, seconds.
const LATE_S: f64 = 10.0;
/// Least and largest width of a box in parts of the last one's, and the growth of the latter per second.
const MIN_GROWTH: f64 = 0.7;
const MAX_GROWTH: f64 = 1.4;
const GROWTH_PER_S: f64 = 0.03;

/// A change per second, and its standard error.
#[derive(Debug, Clone, Copy)]
struct Slope {
    per_s: f64,
    error: f64,
}

impl Slope {
    /// True if it is certainly a change, and not below this.
    fn is_over(self, least_per_s: f64) -> bool {
        self.per_s >= least_per_s.max(SURE * self.error)
    }
}

/// What one view saw of an object.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Trace {
    last: Sighting,
    track: Option<u32>,
    /// Earlier sightings, the oldest first.
    earlier: VecDeque<Sighting>,
}

impl Trace {
    fn begin(time_s: f64, seen: Candidate) -> Self {
        let pixel_box = seen.pixel_box;
        Self {
            last: Sighting { time_s, pixel_box },
            track: seen.track,
            earlier: VecDeque::new(),
        }
    }

    fn extend(&mut self, time_s: f64, seen: Candidate) {
        let newest = self.earlier.back();
        if newest.is_none_or(|newest| self.last.time_s - newest.time_s >= STEP_S) {
            self.earlier.push_back(self.last);
        }
        while (self.earlier.front()).is_some_and(|oldest| time_s - oldest.time_s > REMEMBERED_S) {
            self.earlier.pop_front();
        }
        self.last.time_s = time_s;
        self.last.pixel_box = seen.pixel_box;
        self.track = seen.track;
    }

    /// The sighting that its motion begins at; `None` if it was seen for too short a time.
    fn first(&self) -> Option<&Sighting> {
        let since = |seen: &Sighting| self.last.time_s - seen.time_s;
        let first = (self.earlier.iter()).find(|seen| since(seen) <= MOTION_S);
        first.filter(|first| since(first) >= MIN_MOTION_S)
    }

    /// Motion in the image, pixels per second; `None` if it was seen for too short a time.
    fn motion_px_s(&self) -> Option<DVec2> {
        let first = self.first()?;
        let [last_px, first_px] =
            [&self.last, first].map(|seen| centre_and_size(&seen.pixel_box).0);
        Some((last_px - first_px) / (self.last.time_s - first.time_s))
    }

    /// True if it certainly moves or grows; `None` if it was seen for too short a time.
    fn is_moving(&self) -> Option<bool> {
        self.first()?;
        let lasted_s = self.last.time_s - self.earlier.front()?.time_s;
        let centre = |seen: &PixelBox| centre_and_size(seen).0;
        let right = self.slope(CENTRE_SD_PX, |seen| centre(seen).x);
        let down = self.slope(CENTRE_SD_PX, |seen| centre(seen).y);
        let width_sd = WIDTH_SD_PX / self.last.pixel_box.width_px;
        let growth = self.slope(width_sd, |seen| seen.width_px.ln());
        let motion = Slope {
            per_s: right.per_s.hypot(down.per_s),
            error: right.error.max(down.error),
        };
        Some(motion.is_over(STILL_PX_S) || growth.is_over(STILL_GROWTH / lasted_s))
    }

    /// The straight line through a number of its sightings, whose standard deviation is at least this. There are at least two of them.
    fn slope(&self, least_sd: f64, number: impl Fn(&PixelBox) -> f64) -> Slope {
        let sightings = self.earlier.iter().chain([&self.last]);
        let numbers: Vec<(f64, f64)> = sightings
            .map(|seen| (seen.time_s, number(&seen.pixel_box)))
            .collect();
        let count = numbers.len() as f64;
        let sum = |of: &dyn Fn(f64, f64) -> f64| -> f64 {
            numbers.iter().map(|&(at_s, number)| of(at_s, number)).sum()
        };
        let middle_s = sum(&|at_s, _| at_s) / count;
        let mean = sum(&|_, number| number) / count;
        let spread = sum(&|at_s, _| (at_s - middle_s).powi(2));
        let per_s = sum(&|at_s, number| (at_s - middle_s) * number) / spread;
        let left = |at_s: f64, number: f64| (number - mean - per_s * (at_s - middle_s)).powi(2);
        let sd = (sum(&left) / (count - 2.0).max(1.0)).sqrt().max(least_sd);
        Slope {
            per_s,
            error: sd / spread.sqrt(),
        }
    }

    fn is_of_track(&self, seen: Candidate) -> bool {
        seen.track.is_some() && seen.track == self.track
    }

    /// Distance of a box from where this object is expected, in parts of the largest possible one; `None` if it is another object.
    pub(super) fn distance_to(&self, time_s: f64, seen: Candidate) -> Option<f64> {
        let since_s = (time_s - self.last.time_s).max(0.0);
        let is_same_track = self.is_of_track(seen);
        let grown = seen.pixel_box.width_px / self.last.pixel_box.width_px;
        let freedom = if is_same_track {
            SAME_TRACK_GROWTH
        } else {
            1.0
        };
        let most_grown = freedom * MAX_GROWTH * (GROWTH_PER_S * since_s).exp();
        if !(MIN_GROWTH / freedom..=most_grown).contains(&grown) {
            return None;
        }
        let motion_px_s = self.motion_px_s();
        let per_s = if motion_px_s.is_some() {
            AWAY_PER_S
        } else {
            AWAY_PER_S_WITHOUT_MOTION
        };
        let (last_px, size_px) = centre_and_size(&self.last.pixel_box);
        let expected_px = last_px + motion_px_s.unwrap_or_default() * since_s;
        let (centre_px, _) = centre_and_size(&seen.pixel_box);
        let away = (centre_px - expected_px).length() / size_px.x.max(seen.pixel_box.width_px);
        let most = AWAY_AT_ONCE + per_s * since_s;
        let away = if is_same_track {
            away / (SAME_TRACK * most)
        } else {
            away / most
        };
        (away <= 1.0).then_some(away)
    }
}

/// An object that some views see.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Aircraft {
    /// Number in the order of appearance.
    pub(super) number: usize,
    /// By view.
    traces: Vec<Option<Trace>>,
    /// By view, index of its box among the candidates of this tick.
    pub(super) boxes: Vec<Option<usize>>,
    /// Time in which two views agreed on it, seconds.
    pub(super) paired_s: f64,
    /// Time in which any view saw it, seconds.
    pub(super) seen_s: f64,
    /// When that was last, seconds.
    pub(super) last_s: f64,
    /// Time for which the views have been contradicting each other, seconds.
    pub(super) disputed_s: f64,
    /// It came along the paths of the training at a usual speed.
    pub(super) has_approached: bool,
}

impl Aircraft {
    /// An object of which the first box is this one of a view.
    pub(super) fn new(number: usize, views: usize, view: usize, index: usize) -> Self {
        let mut new = Self {
            number,
            traces: vec![None; views],
            boxes: vec![None; views],
            paired_s: 0.0,
            seen_s: 0.0,
            last_s: 0.0,
            disputed_s: 0.0,
            has_approached: false,
        };
        new.boxes[view] = Some(index);
        new
    }

    /// Number of views that see it at this tick.
    pub(super) fn count(&self) -> usize {
        self.boxes.iter().flatten().count()
    }

    /// Distance of a box from where this object is expected in that view ([`Trace::distance_to`]); `None` if it is another object, or the
    /// view has not seen it.
    pub(super) fn distance_to(&self, time_s: f64, view: usize, seen: Candidate) -> Option<f64> {
        self.traces[view].as_ref()?.distance_to(time_s, seen)
    }

    /// The first and the last sighting of the motion in each view that has seen one.
    pub(super) fn motions(&self) -> impl Iterator<Item = (usize, [&Sighting; 2])> {
        let traces = self.traces.iter().enumerate();
        traces.filter_map(|(view, trace)| {
            let trace = trace.as_ref()?;
            Some((view, [trace.first()?, &trace.last]))
        })
    }

    /// True if a view sees it move or grow: an approach does, lamps and masts do not. `None` if it was seen for too short a time.
    pub(super) fn is_moving(&self) -> Option<bool> {
        let traces = self.traces.iter().flatten();
        traces.filter_map(Trace::is_moving).max()
    }

    /// True if a box has the number of this object's track in that view.
    pub(super) fn is_of_track(&self, view: usize, seen: Candidate) -> bool {
        let trace = self.traces[view].as_ref();
        trace.is_some_and(|trace| trace.is_of_track(seen))
    }

    /// The last box in each view that has seen it.
    pub(super) fn last_boxes(&self) -> impl Iterator<Item = (usize, &PixelBox)> + Clone {
        let traces = self.traces.iter().enumerate();
        traces.filter_map(|(view, trace)| Some((view, &trace.as_ref()?.last.pixel_box)))
    }

    /// True if a box may be this object: it continues what its view saw, if anything of late.
    pub(super) fn may_be(&self, time_s: f64, view: usize, seen: Candidate) -> bool {
        let trace = self.traces[view].as_ref();
        let recent = trace.filter(|trace| time_s - trace.last.time_s <= LATE_S);
        recent.is_none_or(|trace| trace.distance_to(time_s, seen).is_some())
    }

    /// Ends the tick: its boxes become what was seen last.
    pub(super) fn remember(&mut self, time_s: f64, boxes: &[Vec<Candidate>]) {
        for (view, index) in self.boxes.iter().enumerate() {
            let Some(index) = *index else { continue };
            let seen = boxes[view][index];
            match &mut self.traces[view] {
                Some(trace) => trace.extend(time_s, seen),
                trace => *trace = Some(Trace::begin(time_s, seen)),
            }
            self.last_s = time_s;
        }
    }

    /// The same object in each view by itself, after the views have contradicted each other for too long. Nothing is paired any more.
    pub(super) fn divided(self, mut number: impl FnMut() -> usize) -> Vec<Self> {
        let views = 0..self.traces.len();
        let of_view = |view: usize| {
            let trace = self.traces[view].clone()?;
            let mut alone = Self {
                number: number(),
                traces: vec![None; self.traces.len()],
                boxes: vec![None; self.traces.len()],
                paired_s: 0.0,
                disputed_s: 0.0,
                has_approached: false,
                ..self
            };
            alone.last_s = trace.last.time_s;
            alone.boxes[view] = self.boxes[view];
            alone.traces[view] = Some(trace);
            Some(alone)
        };
        views.filter_map(of_view).collect()
    }

    /// Takes over what another one, seen by other views at this tick, has there.
    pub(super) fn absorb(&mut self, mut other: Self) {
        for view in 0..self.boxes.len() {
            if other.boxes[view].is_some() {
                self.boxes[view] = other.boxes[view];
                if self.traces[view].is_none() {
                    self.traces[view] = other.traces[view].take();
                }
            }
        }
        self.seen_s = self.seen_s.max(other.seen_s);
    }
}
