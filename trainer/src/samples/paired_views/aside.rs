//! Aircraft that several views see beside the training's paths for a long time.
//!
//! Rows tell whether two boxes show the same aircraft, columns how far away it is. A camera turned sideways shifts its columns only: the
//! views still agree, on a distance that is wrong by several percent, and motion and size look like an approach. The background reveals a
//! turn within a flight; in fog the training's paths are the only evidence. Gusts and intercepts leave these paths and return within
//! seconds. A turned camera is off by a constant number of columns.

use std::collections::VecDeque;

use dataset::tables::pixel_box::PixelBox;
use serde::{Deserialize, Serialize};

use super::relation::{Relation, width_px};
use super::sighting::{MAX_GAP_S, MEMORY_S, STEP_S};
use crate::samples::robust_line::{FINE_UNIT_PX, dot, robust_line};
use crate::samples::{Look, Observation};

/// Maximum number of pairs in the fit; more do not change it.
const MAX_PAIRS: usize = 5_000;
/// Number of cross-validation parts.
const PARTS: usize = 4;
/// Minimum number of flights, each seen by two views for a minute, that determine the spread around the common path.
pub(super) const MIN_FLIGHTS: usize = 4;
/// Minimum number of compared pairs per minute.
const MIN_PAIRS: usize = 5;
/// Share of outliers on either side: single wrong boxes.
const OUTLIERS: f64 = 0.1;
/// Limit for offsets: a multiple of the training's largest offset, and at least this many pixels.
const TIMES_OF_TRAINING: f64 = 3.0;
const MIN_OFF_PX: f64 = 5.0;

#[derive(Debug, Clone, Copy)]
pub(super) struct Pair<'a> {
    pub(super) time_s: f64,
    pub(super) boxes: [&'a PixelBox; 2],
}

impl<'a> Pair<'a> {
    /// Boxes in two views at a tick; `None` if one is missing.
    pub(super) fn of([first, second]: [usize; 2], observed: &'a Observation) -> Option<Self> {
        let boxes = &observed.boxes;
        Some(Self {
            time_s: observed.time_s(),
            boxes: [boxes[first].as_ref()?, boxes[second].as_ref()?],
        })
    }
}

/// Column in the second view as a function of the position in the first, on the training's paths.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Columns {
    /// Column, pixels, by position in units of [`FINE_UNIT_PX`]: constant, and factors for the column, its square, and the row.
    column: [f64; 4],
    /// Largest offset that a training flight kept for a minute, from a line through other flights, pixels.
    kept_px: f64,
}

fn terms(seen: &PixelBox) -> [f64; 4] {
    let x = seen.cx_px / FINE_UNIT_PX;
    [1.0, x, x * x, seen.cy_px / FINE_UNIT_PX]
}

/// Robust line through the pairs.
fn line<'a>(pairs: impl Iterator<Item = &'a Pair<'a>> + Clone) -> Option<[f64; 4]> {
    let step = pairs.clone().count().div_ceil(MAX_PAIRS).max(1);
    let points = pairs.step_by(step).map(|pair| {
        let [first, second] = pair.boxes;
        // The closer the aircraft, the larger the offset in pixels per metre.
        (terms(first), second.cx_px, width_px(pair.boxes))
    });
    let (column, _) = robust_line(&points.collect::<Vec<_>>())?;
    Some(column)
}

/// Column offset in the second view, to the right, pixels.
fn off_px(column: &[f64; 4], [first, second]: [&PixelBox; 2]) -> f64 {
    second.cx_px - dot(column, &terms(first))
}

impl Columns {
    /// Fits pairs from training flights; `None` with too few.
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
                let mut kept = OffsetHistory::default();
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

    /// Maximum offset on the paths, pixels.
    pub(super) fn limit_px(&self) -> f64 {
        (TIMES_OF_TRAINING * self.kept_px).max(MIN_OFF_PX)
    }

    pub(super) fn is_possible(&self) -> bool {
        self.kept_px >= 0.0
    }
}

/// Offset between two views at a tick, or for a minute from then on.
#[derive(Debug, Clone, Copy)]
struct Offset {
    time_s: f64,
    /// Pixels; for a minute the smallest to one side, 0 if offsets have both signs.
    off_px: f64,
    /// True if the background was hidden, for a minute in most images.
    is_hidden: bool,
}

/// Recent offsets between two views.
#[derive(Debug, Clone, Default)]
struct OffsetHistory {
    /// The oldest first.
    recent: VecDeque<Offset>,
    /// The last complete minute.
    minute: Option<Offset>,
}

impl OffsetHistory {
    /// Takes the next offset. After a minute over the limit a new one begins: returning to the paths takes a whole minute as well.
    fn take(&mut self, next: Offset, limit_px: f64) {
        let time_s = next.time_s;
        let last_s = self.recent.back().map_or(time_s, |last| last.time_s);
        if time_s - last_s > MAX_GAP_S {
            self.recent.clear();
        }
        if self.recent.is_empty() || time_s - last_s >= STEP_S {
            self.recent.push_back(next);
        }
        // The oldest offset is a minute old, or older if ticks are rare.
        let is_over = |second: &Offset| time_s - second.time_s >= MEMORY_S;
        while self.recent.get(1).is_some_and(is_over) {
            self.recent.pop_front();
        }
        let since_s = self.recent.front().map_or(time_s, |oldest| oldest.time_s);
        if time_s - since_s >= MEMORY_S && self.recent.len() >= MIN_PAIRS {
            let hidden = self.recent.iter().filter(|of| of.is_hidden).count();
            let off_px = self.off_px();
            self.minute = Some(Offset {
                time_s: since_s,
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

/// An aircraft beside the training's paths.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Aside {
    /// Views that may be turned: those that are not on the paths together with any other view.
    pub views: Vec<usize>,
    /// Start, seconds; negative infinity if the aircraft was never on the paths for a minute.
    pub since_s: f64,
    /// Largest offset between two views for a minute, and the limit, pixels.
    pub off_px: f64,
    pub limit_px: f64,
    /// True if the background was hidden for a minute: a camera may have been turned unnoticed.
    pub is_hidden: bool,
}

impl Aside {
    /// Line for users about these flights, all with a hidden background or all without; `None` for an empty list. `views`: names of all
    /// views.
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

/// Watch for one aircraft.
#[derive(Debug, Clone, Default)]
pub(crate) struct AsideWatch {
    /// Per relation.
    kept: Vec<OffsetHistory>,
    /// The result at the last tick.
    pub(super) aside: Option<Aside>,
    /// True after a minute on the paths.
    was_on_paths: bool,
}

impl AsideWatch {
    /// Takes the boxes of the next tick. The result lasts until the aircraft has been on the paths for a minute.
    pub(crate) fn next(
        &mut self,
        relations: &[Relation],
        observed: &Observation,
    ) -> Option<&Aside> {
        self.kept
            .resize_with(relations.len(), OffsetHistory::default);
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
                None if self.was_on_paths => minute.time_s,
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
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kept_px(times_s: impl Iterator<Item = f64>, off_px: impl Fn(f64) -> f64) -> Option<f64> {
        let mut kept = OffsetHistory::default();
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
