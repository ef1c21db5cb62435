//! Views that together see an aircraft beside the paths of the training for a long time.
//!
//! Rows show whether two boxes are of one aircraft, and columns how far away it is. A camera that is turned sideways shifts its columns
//! alone: the views still agree, on a distance that is wrong by several per cent, and motion and size are those of an approach. The
//! background shows a turn within a flight; in fog the paths of the training are the only evidence. Gusts and intercepts lead away from
//! these paths and back within some seconds. A turned camera is off by the same number of columns as long as it stays turned.

use std::collections::VecDeque;

use dataset::tables::pixel_box::PixelBox;
use serde::{Deserialize, Serialize};

use super::relation::{Relation, width_px};
use super::robust_line::{dot, robust_line};
use crate::samples::Observation;
use crate::samples::camera_health::look::Look;

/// Unit of the coordinates in the fit, pixels: so small that what keeps slopes small in [`robust_line`] moves no column by a pixel.
const UNIT_PX: f64 = 100.0;
/// Pairs that decide about the fit; more do not change it.
const MAX_PAIRS: usize = 5_000;
/// Each part of the flights is judged by the others.
const PARTS: usize = 4;
/// Fewer flights that two views saw for a minute do not show how far flights are from their common path.
pub(super) const MIN_FLIGHTS: usize = 4;
/// An offset that lasts for this time counts, seconds.
const KEPT_S: f64 = 60.0;
/// A longer gap without a pair of boxes restarts the minute, seconds.
const MAX_GAP_S: f64 = 30.0;
/// Pairs are compared once in this time, seconds, and a minute has at least so many of them.
const STEP_S: f64 = 1.0;
const MIN_PAIRS: usize = 5;
/// Share of pairs on either side that do not count: single wrong boxes.
const OUTLIERS: f64 = 0.1;
/// A flight is beside the paths if its offset is so many times the largest one of the training's flights, and at least this, pixels.
const TIMES_OF_TRAINING: f64 = 3.0;
const MIN_OFF_PX: f64 = 5.0;

/// A pair of boxes at a time.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pair<'a> {
    pub(super) time_s: f64,
    pub(super) boxes: [&'a PixelBox; 2],
}

impl<'a> Pair<'a> {
    /// The boxes of two views at a tick, if both have one.
    pub(super) fn of([first, second]: [usize; 2], observed: &'a Observation) -> Option<Self> {
        let boxes = &observed.boxes;
        Some(Self {
            time_s: observed.time_ns as f64 / 1e9,
            boxes: [boxes[first].as_ref()?, boxes[second].as_ref()?],
        })
    }
}

/// The column in the second view by the place in the first, on the paths of the training.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Columns {
    /// Column, pixels, by the place in units of [`UNIT_PX`]: constant, and factors of the column, its square, and the row.
    column: [f64; 4],
    /// The largest offset that a training flight had for a minute, from a line through other flights, pixels.
    kept_px: f64,
}

fn terms(seen: &PixelBox) -> [f64; 4] {
    let x = seen.cx_px / UNIT_PX;
    [1.0, x, x * x, seen.cy_px / UNIT_PX]
}

/// The line near which nearly all pairs are.
fn line<'a>(pairs: impl Iterator<Item = &'a Pair<'a>> + Clone) -> Option<[f64; 4]> {
    let step = pairs.clone().count().div_ceil(MAX_PAIRS).max(1);
    let points = pairs.step_by(step).map(|pair| {
        let [first, second] = pair.boxes;
        // The nearer it is, the more pixels is an offset of as many metres.
        (terms(first), second.cx_px, width_px(pair.boxes))
    });
    let (column, _) = robust_line(&points.collect::<Vec<_>>())?;
    Some(column)
}

/// Columns by which the second view is off to the right, pixels.
fn off_px(column: &[f64; 4], [first, second]: [&PixelBox; 2]) -> f64 {
    second.cx_px - dot(column, &terms(first))
}

impl Columns {
    /// Of the pairs of training flights; `None` of too few.
    pub(super) fn fit(flights: &[Vec<Pair>]) -> Option<Self> {
        let mut amounts_px: Vec<f64> = Vec::new();
        for part in 0..PARTS {
            let is_of_part = |(index, _): &(usize, &Vec<Pair>)| index % PARTS == part;
            let others = flights.iter().enumerate().filter(|of| !is_of_part(of));
            let Some(column) = line(others.flat_map(|(_, flight)| flight)) else {
                continue;
            };
            let judged = flights.iter().enumerate().filter(is_of_part);
            amounts_px.extend(judged.filter_map(|(_, flight)| {
                let mut kept = Kept::default();
                let minutes = flight.iter().filter_map(|pair| {
                    let offset = Offset {
                        time_s: pair.time_s,
                        off_px: off_px(&column, pair.boxes),
                        is_hidden: false,
                    };
                    kept.take(offset, f64::INFINITY);
                    Some(kept.minute?.off_px)
                });
                minutes.reduce(f64::max)
            }));
        }
        if amounts_px.len() < MIN_FLIGHTS {
            return None;
        }
        Some(Self {
            column: line(flights.iter().flatten())?,
            kept_px: amounts_px.into_iter().fold(0.0, f64::max),
        })
    }

    /// A larger offset is beside the paths, pixels.
    pub(super) fn limit_px(&self) -> f64 {
        (TIMES_OF_TRAINING * self.kept_px).max(MIN_OFF_PX)
    }

    /// All of its numbers.
    pub(super) fn constants(&self) -> impl Iterator<Item = f64> {
        self.column.into_iter().chain([self.kept_px])
    }

    /// True if the amount is possible.
    pub(super) fn is_possible(&self) -> bool {
        self.kept_px >= 0.0
    }
}

/// A minute of two views.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Minute {
    /// Its begin, seconds.
    since_s: f64,
    /// Offset to one side, pixels; 0 if they were off to both.
    off_px: f64,
    /// True if no background was visible in most of the images.
    is_hidden: bool,
}

/// An offset at a time.
#[derive(Debug, Clone, Copy)]
struct Offset {
    time_s: f64,
    off_px: f64,
    is_hidden: bool,
}

/// Offsets of two views over time.
#[derive(Debug, Clone, Default)]
struct Kept {
    /// The oldest first.
    recent: VecDeque<Offset>,
    /// The last minute of which enough is known.
    minute: Option<Minute>,
}

impl Kept {
    /// Takes the next one. A minute that is over the limit is followed by a new one: to be on the paths again takes a whole minute as well.
    fn take(&mut self, next: Offset, limit_px: f64) {
        let time_s = next.time_s;
        let last_s = self.recent.back().map_or(time_s, |last| last.time_s);
        if time_s - last_s > MAX_GAP_S {
            self.recent.clear();
        }
        if self.recent.is_empty() || time_s - last_s >= STEP_S {
            self.recent.push_back(next);
        }
        // The oldest one is a minute ago, or longer if ticks are rare.
        let is_over = |second: &Offset| time_s - second.time_s >= KEPT_S;
        while self.recent.get(1).is_some_and(is_over) {
            self.recent.pop_front();
        }
        let since_s = self.recent.front().map_or(time_s, |oldest| oldest.time_s);
        if time_s - since_s >= KEPT_S && self.recent.len() >= MIN_PAIRS {
            let hidden = self.recent.iter().filter(|of| of.is_hidden).count();
            let off_px = self.off_px();
            self.minute = Some(Minute {
                since_s,
                off_px,
                is_hidden: 2 * hidden > self.recent.len(),
            });
            if off_px > limit_px {
                self.recent.clear();
            }
        }
    }

    fn off_px(&self) -> f64 {
        let mut off: Vec<f64> = self.recent.iter().map(|of| of.off_px).collect();
        off.sort_by(f64::total_cmp);
        let outliers = (OUTLIERS * off.len() as f64) as usize;
        let [least, most] = [off[outliers], off[off.len() - 1 - outliers]];
        least.max(-most).max(0.0)
    }
}

/// An aircraft beside the paths of the training.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Aside {
    /// Indices of the views that may have been turned: those that are not on the paths together with any other view.
    pub views: Vec<usize>,
    /// When it began, seconds; before all times if the aircraft has not been on the paths for a minute.
    pub since_s: f64,
    /// Largest offset of two views for a minute, and the limit, pixels.
    pub off_px: f64,
    pub limit_px: f64,
    /// True if the background was hidden for a minute of it: a camera may have been turned without a sign.
    pub is_hidden: bool,
}

impl Aside {
    /// A line for users about such flights, all with a hidden background or none; `None` of none. `views`: the names of all views.
    pub(crate) fn line(views: &[String], found: &[(String, Self)]) -> Option<String> {
        let (scenario, worst) = found
            .iter()
            .max_by(|a, b| a.1.off_px.total_cmp(&b.1.off_px))?;
        let others = match found.len() - 1 {
            0 => String::new(),
            1 => " and 1 other flight".to_owned(),
            count => format!(" and {count} other flights"),
        };
        let named: Vec<&str> = (worst.views.iter())
            .map(|view| views[*view].as_str())
            .collect();
        let plural = if named.len() == 1 { "" } else { "s" };
        let (off_px, limit_px) = (worst.off_px, worst.limit_px);
        let consequence = if worst.is_hidden {
            "too little background is visible to exclude that a camera was turned: from there on they give no distances"
        } else {
            "if a camera was turned after the training, distances are wrong: compare its images, and see `dtd refit`"
        };
        Some(format!(
            "{scenario}{others}: for at least a minute the aircraft is {off_px:.0} px to the side of the training's paths (limit \
             {limit_px:.0} px) in view{plural} {}; {consequence}",
            named.join(" and ")
        ))
    }
}

/// Watches one aircraft.
#[derive(Debug, Clone, Default)]
pub(crate) struct AsideWatch {
    /// By relation.
    kept: Vec<Kept>,
    aside: Option<Aside>,
    /// True if it has been on the paths for a minute.
    was_on_paths: bool,
}

impl AsideWatch {
    /// Takes the boxes of the next tick. The result lasts until the aircraft has been on the paths for a minute.
    pub(super) fn next(
        &mut self,
        relations: &[Relation],
        observed: &Observation,
    ) -> Option<&Aside> {
        self.kept.resize_with(relations.len(), Kept::default);
        let (mut on_paths, mut beside) = (Vec::new(), Vec::new());
        for (relation, kept) in relations.iter().zip(&mut self.kept) {
            let Some(columns) = &relation.columns else {
                continue;
            };
            let pair = Pair::of(relation.views, observed);
            if let Some(pair) = pair.filter(|pair| relation.was_common(pair.boxes)) {
                let is_unplaced = |view: usize| observed.looks[view] == Look::Unplaced;
                let is_hidden = relation.views.into_iter().any(is_unplaced);
                let offset = Offset {
                    time_s: pair.time_s,
                    off_px: off_px(&columns.column, pair.boxes),
                    is_hidden,
                };
                kept.take(offset, columns.limit_px());
            }
            match kept.minute {
                Some(minute) if minute.off_px > columns.limit_px() => {
                    beside.push((minute, columns.limit_px(), relation.views));
                }
                Some(_) => on_paths.extend(relation.views),
                None => {}
            }
        }
        beside.sort_by(|(a, ..), (b, ..)| b.off_px.total_cmp(&a.off_px));
        let views = beside.iter().flat_map(|(_, _, views)| *views);
        let mut views: Vec<usize> = views.filter(|view| !on_paths.contains(view)).collect();
        views.sort_unstable();
        views.dedup();
        let worst = beside.first().filter(|_| !views.is_empty());
        self.was_on_paths |= worst.is_none() && !on_paths.is_empty();
        let earlier = self.aside.take();
        self.aside = worst.map(|(minute, limit_px, _)| {
            let since_s = match &earlier {
                Some(earlier) => earlier.since_s,
                None if self.was_on_paths => minute.since_s,
                None => f64::NEG_INFINITY,
            };
            Aside {
                views,
                since_s,
                off_px: (earlier.as_ref()).map_or(minute.off_px, |of| of.off_px.max(minute.off_px)),
                limit_px: *limit_px,
                is_hidden: beside.iter().any(|(minute, ..)| minute.is_hidden)
                    || earlier.is_some_and(|earlier| earlier.is_hidden),
            }
        });
        self.aside.as_ref()
    }

    /// The result at the last tick.
    pub(super) fn last(self) -> Option<Aside> {
        self.aside
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kept_px(times_s: impl Iterator<Item = f64>, off_px: impl Fn(f64) -> f64) -> Option<f64> {
        let mut kept = Kept::default();
        times_s.for_each(|time_s| {
            let offset = Offset {
                time_s,
                off_px: off_px(time_s),
                is_hidden: false,
            };
            kept.take(offset, f64::INFINITY);
        });
        Some(kept.minute?.off_px)
    }

    #[test]
    fn an_offset_that_stays_for_a_minute_is_kept_at_any_image_rate_and_a_passing_one_is_not() {
        for step_s in [1.0 / 30.0, 0.5, 2.0, 4.0, 15.0] {
            let times = |seconds: f64| {
                let count = (seconds / step_s).ceil() as u32;
                (0..=count).map(move |tick| f64::from(tick) * step_s)
            };
            assert_eq!(kept_px(times(75.0), |_| -57.0), Some(57.0));
            assert_eq!(kept_px(times(44.0), |_| 57.0), None);
            let intercept = |time_s: f64| (100.0 - 3.0 * time_s).max(-1.0);
            assert_eq!(kept_px(times(75.0), intercept), Some(0.0));
            let begins = |time_s: f64| if time_s < 40.0 { 2.0 } else { 57.0 };
            assert_eq!(kept_px(times(75.0), begins), Some(2.0));
        }
        let wrong_now_and_then = |time_s: f64| {
            if time_s as u32 % 12 == 3 {
                900.0
            } else {
                -57.0
            }
        };
        let seconds = (0..75).map(f64::from);
        assert_eq!(kept_px(seconds, wrong_now_and_then), Some(57.0));
        let rare = (0..20).map(|tick| f64::from(tick) * 20.0);
        assert_eq!(kept_px(rare, |_| 57.0), None);
    }

    #[test]
    fn what_was_before_a_gap_is_not_kept() {
        let times = (0..50).chain(90..120).map(f64::from);
        assert_eq!(kept_px(times, |_| 57.0), None);
    }
}
