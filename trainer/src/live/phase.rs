//! Flight phase from the track: arrival or not.
//!
//! Estimates are valid for approaches, so a departure, an aircraft that taxis or crosses, a lamp, and a climb after a missed approach get
//! none. Two speeds decide: the closing speed, from the distances measured by the most precise fit, and the vertical speed, from the box's
//! elevation at these distances, with the training's camera. Each is the median slope over some seconds (Theil 1950, Sen 1968) with its
//! standard deviation; uncertain slopes change nothing, and an aircraft counts as arriving until its track contradicts that.

use std::collections::VecDeque;

use dataset::geometry::camera::Camera;
use dataset::numbers::spread::{Spread, median_of, median_slope};
use glam::DVec2;

use super::cameras_of;
use crate::estimators::inverse_range::Tick;
use crate::estimators::inverse_range::contradiction::MIN_CLOSING_MPS;
use crate::run::trained::TrainedRun;
use crate::samples::Observation;
use crate::samples::paired_views::RECENT_S;
use crate::samples::trusted_boxes::centre_and_size;

/// Maximum climb for an arrival, and minimum descent that ends a climb, m/s.
const MAX_CLIMB_MPS: f64 = 3.0;
const MIN_DESCENT_MPS: f64 = 1.0;
/// Minimum climb duration, seconds: shorter ones are gusts.
const CLIMB_S: f64 = 3.0;
/// Distance within which a climb is a missed approach, which ends with a descent, not with level flight, metres.
const MISSED_WITHIN_M: f64 = 8_000.0;
/// Significance for decisions, in standard deviations.
const SURE: f64 = 2.5;
/// Minimum number of ticks.
const MIN_COUNT: usize = 6;
/// Minimum time between ticks, seconds.
const STEP_S: f64 = 0.2;
/// Number of consecutive ticks with a common error.
const ALIKE: f64 = 3.0;
/// Minimum elevation standard deviation, radians: 0.33 px at a focal length of 11,000 px.
const MIN_ELEVATION_SD: f64 = 3e-5;
/// Minimum scatter of measurements, relative to their stated new error.
const MIN_NEW_PART: f64 = 0.5;

/// Flight phase.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Phase {
    /// Arrival.
    #[default]
    Arrival,
    /// Anything else.
    Other,
}

impl Phase {
    /// Word used in files.
    pub fn word(self) -> &'static str {
        match self {
            Self::Arrival => "arrival",
            Self::Other => "other",
        }
    }
}

/// Phase decision for one aircraft.
#[derive(Debug, Default)]
pub(super) struct PhaseJudge {
    seen: VecDeque<TrackPoint>,
    is_slow: bool,
    climbs: bool,
}

/// A tick with a measured distance.
#[derive(Debug, Clone, PartialEq)]
struct TrackPoint {
    time_s: f64,
    fit: usize,
    distance_m: f64,
    /// Distance from the cameras.
    range_m: f64,
    /// Standard deviation of the slowly varying error, its half-life, and standard deviation of the new error per tick.
    slow_m: f64,
    half_time_s: f64,
    new_m: f64,
    /// Per view, above the horizontal, radians.
    elevations: Vec<Option<f64>>,
}

/// Slope with its standard deviation, per second.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Slope {
    per_s: f64,
    sd: f64,
}

impl PhaseJudge {
    pub(super) fn take(&mut self, run: &TrainedRun, observed: &Observation, tick: &Tick) -> Phase {
        let time_s = observed.time_s();
        let is_next = |last: &TrackPoint| time_s - last.time_s >= STEP_S - 1e-6;
        if self.seen.back().is_none_or(is_next)
            && let Some(seen) = TrackPoint::of(run, observed, tick)
        {
            self.push(seen);
        }
        self.phase()
    }

    fn phase(&self) -> Phase {
        if self.is_slow || self.climbs {
            Phase::Other
        } else {
            Phase::Arrival
        }
    }

    fn push(&mut self, seen: TrackPoint) {
        let now_s = seen.time_s;
        self.seen.push_back(seen);
        let is_old = |seen: &TrackPoint| now_s - seen.time_s > RECENT_S;
        while self.seen.len() > MIN_COUNT && self.seen.front().is_some_and(is_old) {
            self.seen.pop_front();
        }
        self.judge();
    }

    fn judge(&mut self) {
        let Some(last) = self.seen.back() else { return };
        // Errors differ between fits.
        let alike: Vec<&TrackPoint> = (self.seen.iter())
            .filter(|seen| seen.fit == last.fit)
            .collect();
        let lasted_s = last.time_s - alike[0].time_s;
        let distances = alike.iter().map(|seen| (seen.time_s, seen.distance_m));
        let Some(closing) = Slope::of(distances.collect(), MIN_NEW_PART * last.new_m) else {
            return;
        };
        let forgotten = 1.0 - 0.5_f64.powf(lasted_s / last.half_time_s);
        let slow_mps = last.slow_m * (2.0 * forgotten).sqrt() / lasted_s;
        let (speed_mps, sd_mps) = (-closing.per_s, SURE * closing.sd.hypot(slow_mps));
        if speed_mps + sd_mps < MIN_CLOSING_MPS {
            self.is_slow = true;
        } else if speed_mps - sd_mps > MIN_CLOSING_MPS {
            self.is_slow = false;
        }
        if let Some((climb_mps, sd_mps)) = climb_mps(&alike, closing) {
            let ends_mps = if last.distance_m <= MISSED_WITHIN_M {
                -MIN_DESCENT_MPS
            } else {
                MAX_CLIMB_MPS
            };
            if climb_mps - SURE * sd_mps > MAX_CLIMB_MPS && lasted_s >= CLIMB_S {
                self.climbs = true;
            } else if climb_mps + SURE * sd_mps < ends_mps {
                self.climbs = false;
            }
        }
    }
}

/// Vertical speed with its standard deviation, from the view with most boxes.
fn climb_mps(seen: &[&TrackPoint], closing: Slope) -> Option<(f64, f64)> {
    let views = seen[0].elevations.len();
    let of_view = |view: usize| -> Vec<(f64, f64)> {
        let elevations = seen.iter();
        elevations
            .filter_map(|seen| Some((seen.time_s, seen.elevations[view]?)))
            .collect()
    };
    let elevations = (0..views).map(of_view).max_by_key(Vec::len)?;
    let elevation = median_of(elevations.iter().map(|(_, angle)| *angle))?;
    let slope = Slope::of(elevations, MIN_ELEVATION_SD)?;
    let range_m = median_of(seen.iter().map(|seen| seen.range_m))?;
    let climb_mps = closing.per_s * elevation.sin() + range_m * slope.per_s * elevation.cos();
    let sd_mps = (closing.sd * elevation.sin()).hypot(range_m * slope.sd);
    Some((climb_mps, sd_mps))
}

impl TrackPoint {
    fn of(run: &TrainedRun, observed: &Observation, tick: &Tick) -> Option<Self> {
        let baselines = &run.baselines;
        let fits = &baselines.inverse_range;
        let best = tick.measurements.first()?;
        let (slow_m, half_time_s, new_m) = baselines.flight_filter.deviations_m(best);
        let cameras = cameras_of(run)?;
        let elevations = cameras.iter().enumerate().map(|(view, camera)| {
            let (centre_px, _) = centre_and_size(observed.best(view)?);
            Some(elevation(camera, centre_px))
        });
        Some(Self {
            time_s: observed.time_s(),
            fit: best.fit,
            distance_m: best.distance_m,
            range_m: best.distance_m + fits.setback_m(best.fit),
            slow_m,
            half_time_s,
            new_m,
            elevations: elevations.collect(),
        })
    }
}

/// Elevation above the horizontal, radians.
fn elevation(camera: &Camera, place_px: DVec2) -> f64 {
    let up = camera.center_ecef_m.normalize_or_zero();
    camera.ray(place_px).dot(up).clamp(-1.0, 1.0).asin()
}

impl Slope {
    /// Slope of numbers over time, with a minimum standard deviation of their errors; `None` with too few.
    fn of(numbers: Vec<(f64, f64)>, least_sd: f64) -> Option<Self> {
        let lasted_s = numbers.last()?.0 - numbers.first()?.0;
        if numbers.len() < MIN_COUNT {
            return None;
        }
        let per_s = median_slope(numbers.iter().copied())?;
        let residuals = numbers.iter().map(|(at_s, number)| number - per_s * at_s);
        let spread = Spread::of(residuals.collect())?;
        let independent = (numbers.len() as f64 / ALIKE).max(1.0);
        let sd = spread.deviation.max(least_sd) * (12.0 / independent).sqrt() / lasted_s;
        Some(Self { per_s, sd })
    }
}

#[cfg(test)]
mod tests;
