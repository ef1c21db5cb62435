//! Images of other ticks: from a tick on, or single ones.
//!
//! The offset of the centre of brightness from the box has two parts: a share of the size, because the visible part of an aircraft is not
//! centred in its box, and its motion in the image during the time by which image and table differ: `offset = share * size + ahead * motion
//! per tick`. Both are fitted by least squares; the tick where the time ahead starts is the one with the best fit. Lags that are smaller
//! than an aircraft are measured by its outline ([`lag`](super::lag)).

use std::ops::RangeInclusive;

use glam::{DVec2, DVec3};

use super::MIN_MOTION_PX;
use super::outline::ERROR_PX;
use crate::faults::Faults;
use dataset::numbers::least_squares::NormalEquations;
use dataset::numbers::spread::median_of;

/// Observation in an image.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point {
    pub(super) tick: usize,
    /// Centre of the object relative to the centre of the box, pixels.
    pub(super) offset_px: DVec2,
    /// Motion of the box in one tick, pixels.
    pub(super) per_tick_px: DVec2,
    pub(super) size_px: DVec2,
    /// True if its outline stands out, which lamps hide, and no rain falls before it.
    pub(super) is_plain: bool,
    /// Speed of the aircraft over ground, metres per second.
    pub(super) speed_mps: f64,
}

/// Images are of other ticks if they differ by this much, ticks: a little more than half ...
const MIN_TICKS: f64 = 0.6;
/// ... by this many standard errors ...
const MIN_STANDARD_ERRORS: f64 = 4.0;
/// ... and by this part of the aircraft's way, metres: what stands out may be at either end of the aircraft.
const MIN_WAY_M: f64 = 20.0;
/// Minimum number of points: anything fits fewer.
const MIN_POINTS: usize = 6;
/// Error of offsets beside [`ERROR_PX`], as a part of the size: light and attitude change what stands out.
const OFFSET_ERROR: f64 = 0.01;
/// Error of a single offset in an image that is not plain, or has a neighbour that is not. Where lamps outshine the aircraft, one at a wing
/// tip comes into sight as the aircraft turns by half a degree, and moves the centre of brightness by 3 %; streaks of rain move a faint one
/// as far.
const OFFSET_ERROR_OF_LAMPS_AND_RAIN: f64 = 0.04;
/// Number of places that are tried first for a lag's start.
const TRIED_STARTS: usize = 128;
/// Points on either side used to decide whether a point is out of line.
const NEIGHBOURS: usize = 5;

/// Names the first tick whose image is of a different tick, or single images that are. Returns the number of images that the next tick's
/// would not have passed for.
pub(super) fn check(
    points: &[Point],
    period_s: f64,
    file: &str,
    view: &str,
    faults: &mut Faults,
) -> usize {
    let Some((from, fit)) = out_of_step(points, period_s) else {
        return check_each(points, file, view, faults);
    };
    let (ahead, point) = (fit.ahead_ticks, &points[from]);
    let ahead_s = ahead.abs() * period_s;
    let message = format!(
        "from here on the images show the aircraft where it is {:.1} ticks {} (+-{:.1}), {:.0} ms or {:.0} m along its track",
        ahead.abs(),
        in_words(ahead),
        fit.error_ticks,
        ahead_s * 1e3,
        ahead_s * point.speed_mps,
    );
    faults.view_row(view, file, point.tick, "out of step", message);
    0
}

/// The best-fitting start of the shift, if there is one. Tries some places first, then all around the best.
fn out_of_step(points: &[Point], period_s: f64) -> Option<(usize, Fit)> {
    let last = points.len().checked_sub(MIN_POINTS / 2)?;
    let best = |places: &mut dyn Iterator<Item = usize>| {
        places
            .filter_map(|from| Some((from, Fit::of(points, from)?)))
            .filter(|(from, fit)| fit.is_of_other_ticks(period_s * points[*from].speed_mps))
            .min_by(|(_, a), (_, b)| a.misfit.total_cmp(&b.misfit))
    };
    let step = last.div_ceil(TRIED_STARTS).max(1);
    let (near, _) = best(&mut (0..=last).step_by(step))?;
    best(&mut (near.saturating_sub(step)..=(near + step).min(last)))
}

fn in_words(ahead: f64) -> &'static str {
    if ahead > 0.0 { "later" } else { "earlier" }
}

/// Names single images that are out of line with their neighbours along the path of the aircraft; returns how many can be decided.
fn check_each(points: &[Point], file: &str, view: &str, faults: &mut Faults) -> usize {
    let out_of_line: Vec<Option<f64>> = (0..points.len())
        .map(|index| out_of_line(points, index))
        .collect();
    let part = |index: usize, off_px: f64| off_px / points[index].size_px.max_element();
    let offs = || {
        let found = out_of_line.iter().enumerate();
        found.filter_map(|(index, off_px)| Some((index, (*off_px)?)))
    };
    let Some(usual) = median_of(offs().map(|(index, off_px)| part(index, off_px).abs())) else {
        return 0;
    };
    let mut decided = 0;
    for (index, off_px) in offs() {
        let point = &points[index];
        let (per_tick_px, size_px) = (point.per_tick_px.length(), point.size_px.max_element());
        let ticks = off_px / per_tick_px;
        let near = &points[neighbourhood(points, index)];
        let error = if near.iter().all(|point| point.is_plain) {
            OFFSET_ERROR
        } else {
            OFFSET_ERROR_OF_LAMPS_AND_RAIN
        };
        let of_errors_px = 2.5 * MIN_STANDARD_ERRORS * usual * size_px;
        let sure_px = (ERROR_PX * 3.0 + error * size_px).max(of_errors_px);
        decided += usize::from(per_tick_px >= sure_px.max(MIN_MOTION_PX));
        if ticks.abs() >= MIN_TICKS && off_px.abs() >= sure_px {
            let message = format!(
                "shows the aircraft {:.1} pixels from where it should be: where it is {:.1} ticks {}",
                off_px.abs(),
                ticks.abs(),
                in_words(ticks)
            );
            faults.view_row(view, file, point.tick, "out of step", message);
        }
    }
    decided
}

/// A point and those on either side.
fn neighbourhood(points: &[Point], index: usize) -> RangeInclusive<usize> {
    index.saturating_sub(NEIGHBOURS)..=(index + NEIGHBOURS).min(points.len() - 1)
}

/// Distance by which the point is ahead along the path of the aircraft, given the neighbours' offset, pixels.
fn out_of_line(points: &[Point], index: usize) -> Option<f64> {
    let point = &points[index];
    let way = point.per_tick_px.try_normalize()?;
    let others = || neighbourhood(points, index).filter(|other| *other != index);
    if others().count() < NEIGHBOURS {
        return None;
    }
    let share = |axis: usize| {
        median_of(others().map(|other| points[other].offset_px[axis] / points[other].size_px[axis]))
    };
    let usual_px = DVec2::new(share(0)?, share(1)?) * point.size_px;
    Some((point.offset_px - usual_px).dot(way))
}

/// A fit to all points, with a time ahead that starts at one point.
struct Fit {
    /// Lead of the images over the tables, ticks.
    ahead_ticks: f64,
    /// Standard error if the errors of all offsets are independent.
    error_ticks: f64,
    /// Weighted sum of squared residuals.
    misfit: f64,
}

impl Fit {
    fn of(points: &[Point], from: usize) -> Option<Self> {
        if points.len() < MIN_POINTS {
            return None;
        }
        let mut normal = NormalEquations::new(3);
        let mut rows = Vec::with_capacity(2 * points.len());
        for (index, point) in points.iter().enumerate() {
            let error_px = ERROR_PX + OFFSET_ERROR * point.size_px.max_element();
            let weight = 1.0 / (error_px * error_px);
            let way = if index >= from {
                point.per_tick_px
            } else {
                DVec2::ZERO
            };
            for (row, offset_px) in [
                ([way.x, point.size_px.x, 0.0], point.offset_px.x),
                ([way.y, 0.0, point.size_px.y], point.offset_px.y),
            ] {
                normal.add(&row, offset_px, weight);
                rows.push((DVec3::from_array(row), offset_px, weight));
            }
        }
        let found = DVec3::from_array(normal.solve_for()?);
        let misfits = rows.iter();
        let misfit: f64 = misfits
            .map(|(row, offset_px, weight)| weight * (offset_px - row.dot(found)).powi(2))
            .sum();
        // If the offsets scatter more than expected, so does the time.
        let scatter = (misfit / (2.0 * points.len() as f64 - 3.0)).max(1.0);
        Some(Self {
            ahead_ticks: found.x,
            error_ticks: (normal.inverse()?[0][0] * scatter).sqrt(),
            misfit,
        })
    }

    fn is_of_other_ticks(&self, way_per_tick_m: f64) -> bool {
        let ahead = self.ahead_ticks.abs();
        ahead >= MIN_TICKS
            && ahead >= MIN_STANDARD_ERRORS * self.error_ticks
            && ahead * way_per_tick_m >= MIN_WAY_M
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An approaching aircraft: it grows and moves ever faster. What stands out is slightly below the centre.
    fn approach(ahead: impl Fn(usize) -> f64) -> Vec<Point> {
        (0..40)
            .map(|tick| {
                let range = 6_000.0 - 100.0 * tick as f64;
                let size_px = DVec2::new(36.0, 12.0) * (1_800.0 / range);
                let per_tick_px = DVec2::new(5.4e7, -1e7) / (range * range);
                let jitter = 0.1 * ((tick * 7 % 5) as f64 - 2.0);
                Point {
                    tick,
                    offset_px: size_px * DVec2::new(0.0, 0.1)
                        + per_tick_px * ahead(tick)
                        + DVec2::new(jitter, -jitter),
                    per_tick_px,
                    size_px,
                    is_plain: true,
                    speed_mps: 70.0,
                }
            })
            .collect()
    }

    fn found(points: &[Point]) -> Vec<(Option<u64>, String)> {
        let mut faults = Faults::of_scenario("0001");
        check(points, 0.5, "views/left.mp4", "left", &mut faults);
        let findings = faults.into_findings().into_iter();
        findings.map(|f| (f.row, f.message)).collect()
    }

    #[test]
    fn pictures_in_step_have_no_findings_though_they_are_off_the_middle() {
        assert_eq!(found(&approach(|_| 0.0)), []);
    }

    #[test]
    fn every_picture_that_is_decided_would_be_found_if_it_were_of_the_next_tick_and_slow_ones_are_not_decided()
     {
        let decided = |points: &[Point]| {
            let mut faults = Faults::of_scenario("0001");
            check(points, 0.5, "views/left.mp4", "left", &mut faults)
        };
        let in_step = approach(|_| 0.0);
        let is_found = |wrong: usize| {
            let points = approach(|tick| if tick == wrong { 1.0 } else { 0.0 });
            found(&points)
                .iter()
                .any(|(row, _)| *row == Some(wrong as u64))
        };
        let would_be_found = (0..in_step.len()).filter(|tick| is_found(*tick)).count();
        assert!(would_be_found > 20, "{would_be_found}");
        assert!(
            decided(&in_step) <= would_be_found,
            "{} {would_be_found}",
            decided(&in_step)
        );
        assert!(decided(&in_step) + 3 >= would_be_found);
        let mut slow = in_step;
        slow.iter_mut().for_each(|point| point.per_tick_px *= 0.1);
        assert_eq!(decided(&slow), 0);
    }

    #[test]
    fn pictures_of_the_next_tick_are_found_and_so_is_where_that_begins() {
        let all = found(&approach(|_| 1.0));
        assert_eq!(all.len(), 1);
        assert!(all[0].1.contains("1.0 ticks later"), "{all:?}");
        let later = found(&approach(|tick| if tick < 20 { 0.0 } else { 1.0 }));
        assert_eq!(later.len(), 1);
        assert!(
            later[0].0.is_some_and(|row| row.abs_diff(20) <= 1),
            "{later:?}"
        );
        let words = "1.0 ticks later (+-";
        assert!(later[0].1.contains(words), "{later:?}");
        assert!(later[0].1.contains(" ms or 35 m along"), "{later:?}");
    }

    #[test]
    fn one_doubled_picture_is_found_in_its_row() {
        let found = found(&approach(|tick| if tick == 30 { -1.0 } else { 0.0 }));
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!(found[0].0, Some(30));
        assert!(found[0].1.contains("1.0 ticks earlier"), "{found:?}");
    }

    #[test]
    fn a_lamp_that_comes_into_sight_is_no_image_of_another_tick() {
        let mut points = approach(|_| 0.0);
        // Large beside its motion: 49 pixels wide, and 3.4 in one tick.
        points.iter_mut().for_each(|point| point.size_px *= 3.0);
        points[20].offset_px.x += 2.4;
        assert_eq!(found(&points).len(), 1, "by day");
        points[20].is_plain = false;
        assert_eq!(found(&points), []);
        let in_a_tick_px = points[20].per_tick_px;
        points[20].offset_px += in_a_tick_px;
        assert_eq!(found(&points).len(), 1, "by a whole tick");
    }
}
