//! An object in sight: its last sighting in each view, and the boxes that continue it.

use std::collections::VecDeque;

use dataset::numbers::least_squares::{NormalEquations, dot};
use dataset::tables::pixel_box::PixelBox;
use glam::DVec2;

use super::sighting::{MEMORY_S, RECENT_S, STEP_S, STILL_GROWTH, Sighting};
use crate::samples::Candidate;
use crate::samples::trusted_boxes::centre_and_size;

/// Minimum time for a motion estimate, seconds.
const MIN_MOTION_S: f64 = 2.0;
/// Maximum speed for a stationary object, px/s: at 10 NM, an aircraft 300 m beside a mast moves six times as fast.
const STILL_PX_S: f64 = 0.1;
/// Standard deviations of a distant box's centre and width, pixels: a stationary object may exceed [`STILL_PX_S`] by chance, ...
const CENTRE_SD_PX: f64 = 0.35;
const WIDTH_SD_PX: f64 = 1.3;
/// ... so motion and growth have to be significant by this many standard errors. Chance reaches that once in three thousand. An aircraft
/// with 0.6 px/s takes five seconds, one with 0.15 px/s ten.
const SURE: f64 = 4.0;
/// Maximum distance from the expected position, in box widths: immediately, and per second with and without a motion estimate. An airliner
/// at 2 NM moves by 0.2 widths per second.
const AWAY_AT_ONCE: f64 = 1.0;
const AWAY_PER_S: f64 = 0.1;
const AWAY_PER_S_WITHOUT_MOTION: f64 = 0.3;
/// Factor of that distance within a track.
const SAME_TRACK: f64 = 3.0;

/// Rate of change with its standard error.
#[derive(Debug, Clone, Copy)]
struct Slope {
    per_s: f64,
    error: f64,
}

impl Slope {
    /// True for a significant change, if it reaches the minimum.
    fn is_over(self, least_per_s: f64) -> bool {
        self.per_s >= least_per_s.max(SURE * self.error)
    }
}

/// An object's sightings in one view.
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
        while (self.earlier.front()).is_some_and(|oldest| time_s - oldest.time_s > MEMORY_S) {
            self.earlier.pop_front();
        }
        self.last.time_s = time_s;
        self.last.pixel_box = seen.pixel_box;
        self.track = seen.track;
    }

    /// First sighting of the motion estimate; `None` if the object is too new.
    fn first(&self) -> Option<&Sighting> {
        let since = |seen: &Sighting| self.last.time_s - seen.time_s;
        let first = (self.earlier.iter()).find(|seen| since(seen) <= RECENT_S);
        first.filter(|first| since(first) >= MIN_MOTION_S)
    }

    /// Motion in the image, pixels per second; `None` if the object is too new.
    fn motion_px_s(&self) -> Option<DVec2> {
        let first = self.first()?;
        let [last_px, first_px] =
            [&self.last, first].map(|seen| centre_and_size(&seen.pixel_box).0);
        Some((last_px - first_px) / (self.last.time_s - first.time_s))
    }

    /// True for significant motion or growth over a minute: an aircraft that flies straight at a camera from 13 NM stays in place and grows
    /// by 0.3 % per second, which ten seconds show only from 4 NM on. `None` if the object is too new.
    fn is_moving(&self) -> Option<bool> {
        self.first()?;
        let centre = |seen: &PixelBox| centre_and_size(seen).0;
        let right = self.slope(CENTRE_SD_PX, |seen| centre(seen).x)?;
        let down = self.slope(CENTRE_SD_PX, |seen| centre(seen).y)?;
        let motion = Slope {
            per_s: right.per_s.hypot(down.per_s),
            error: right.error.max(down.error),
        };
        Some(motion.is_over(STILL_PX_S) || self.is_growing()?)
    }

    /// True for significant growth; `None` if the object is too new.
    fn is_growing(&self) -> Option<bool> {
        self.first()?;
        let lasted_s = self.last.time_s - self.earlier.front()?.time_s;
        let width_sd = WIDTH_SD_PX / self.last.pixel_box.width_px;
        let growth = self.slope(width_sd, |seen| seen.width_px.ln())?;
        Some(growth.is_over(STILL_GROWTH / lasted_s))
    }

    /// Regression line for a quantity over at least two sightings, with a minimum standard deviation.
    fn slope(&self, least_sd: f64, number: impl Fn(&PixelBox) -> f64) -> Option<Slope> {
        let sightings = self.earlier.iter().chain([&self.last]);
        let numbers: Vec<_> = sightings
            .map(|seen| {
                let since_s = seen.time_s - self.last.time_s;
                ([1.0, since_s], number(&seen.pixel_box))
            })
            .collect();
        let mut line = NormalEquations::new(2);
        for (terms, number) in &numbers {
            line.add(terms, *number, 1.0);
        }
        let fitted: [f64; 2] = line.solve_for()?;
        let left = (numbers.iter()).map(|(terms, number)| (number - dot(terms, &fitted)).powi(2));
        let free = numbers.len().saturating_sub(2).max(1);
        let sd = (left.sum::<f64>() / free as f64).sqrt().max(least_sd);
        Some(Slope {
            per_s: fitted[1],
            error: sd * line.inverse()?[1][1].sqrt(),
        })
    }

    fn is_of_track(&self, seen: Candidate) -> bool {
        seen.track.is_some() && seen.track == self.track
    }

    /// Distance from the expected position relative to the maximum; `None` for a different object.
    pub(super) fn distance_to(&self, time_s: f64, seen: Candidate) -> Option<f64> {
        let since_s = (time_s - self.last.time_s).max(0.0);
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
        let of_track = if self.is_of_track(seen) {
            SAME_TRACK
        } else {
            1.0
        };
        let away = away / (of_track * (AWAY_AT_ONCE + per_s * since_s));
        (away <= 1.0).then_some(away)
    }
}

/// An object that some views see.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Aircraft {
    /// Number in order of appearance.
    pub(super) number: usize,
    /// Per view.
    traces: Vec<Option<Trace>>,
    /// Candidate index per view at this tick.
    pub(super) boxes: Vec<Option<usize>>,
    /// Time with agreement between two views, seconds.
    pub(super) paired_s: f64,
    /// Time in sight, seconds.
    pub(super) seen_s: f64,
    /// Time of the last sighting, seconds.
    pub(super) last_s: f64,
    /// Duration of the current contradiction between views, seconds.
    pub(super) disputed_s: f64,
    /// Time for which a view showed another approaching object in its place, less the time for which views have agreed since, seconds.
    pub(super) doubted_s: f64,
    /// True if it came along the training's paths at a usual speed.
    pub(super) has_approached: bool,
}

impl Aircraft {
    /// A new object, with one box.
    pub(super) fn new(number: usize, views: usize, view: usize, index: usize) -> Self {
        let mut new = Self {
            number,
            traces: vec![None; views],
            boxes: vec![None; views],
            paired_s: 0.0,
            seen_s: 0.0,
            last_s: 0.0,
            disputed_s: 0.0,
            doubted_s: 0.0,
            has_approached: false,
        };
        new.boxes[view] = Some(index);
        new
    }

    /// Number of views that see it at this tick.
    pub(super) fn count(&self) -> usize {
        self.boxes.iter().flatten().count()
    }

    /// See [`Trace::distance_to`]; also `None` if the view has not seen the object.
    pub(super) fn distance_to(&self, time_s: f64, view: usize, seen: Candidate) -> Option<f64> {
        self.traces[view].as_ref()?.distance_to(time_s, seen)
    }

    /// First and last sighting of the motion in each view.
    pub(super) fn motions(&self) -> impl Iterator<Item = (usize, [&Sighting; 2])> {
        let traces = self.traces.iter().enumerate();
        traces.filter_map(|(view, trace)| {
            let trace = trace.as_ref()?;
            Some((view, [trace.first()?, &trace.last]))
        })
    }

    /// True if a view sees it move or grow: approaches do, lamps and masts do not. `None` if the object is too new.
    pub(super) fn is_moving(&self) -> Option<bool> {
        let traces = self.traces.iter().flatten();
        traces.filter_map(Trace::is_moving).max()
    }

    /// True if it is an aircraft: views have agreed on it, it came along the training's paths, or it grows in a view.
    pub(super) fn approaches(&self) -> bool {
        let mut traces = self.traces.iter().flatten();
        self.paired_s > 0.0
            || self.has_approached
            || traces.any(|trace| trace.is_growing() == Some(true))
    }

    pub(super) fn is_of_track(&self, view: usize, seen: Candidate) -> bool {
        let trace = self.traces[view].as_ref();
        trace.is_some_and(|trace| trace.is_of_track(seen))
    }

    /// Last box per view.
    pub(super) fn last_boxes(&self) -> impl Iterator<Item = (usize, &PixelBox)> + Clone {
        let traces = self.traces.iter().enumerate();
        traces.filter_map(|(view, trace)| Some((view, &trace.as_ref()?.last.pixel_box)))
    }

    /// True if a box may show this object: it continues any recent sighting in its view.
    pub(super) fn may_be(&self, time_s: f64, view: usize, seen: Candidate) -> bool {
        let trace = self.traces[view].as_ref();
        let recent = trace.filter(|trace| time_s - trace.last.time_s <= RECENT_S);
        recent.is_none_or(|trace| trace.distance_to(time_s, seen).is_some())
    }

    /// Ends the tick: its boxes become the last sightings.
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

    /// Leaves a view's box to another object, which continues it from now on.
    pub(super) fn leave(&mut self, view: usize) {
        self.boxes[view] = None;
        self.traces[view] = None;
    }

    /// Splits the object by view, after a long contradiction. All pairing is lost.
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

    /// Takes over the boxes of an object that other views see at this tick.
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
        self.doubted_s = self.doubted_s.max(other.doubted_s);
    }
}
