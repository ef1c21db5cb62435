//! Lag between the clocks of two cameras, from an aircraft that both see during an arrival.
//!
//! At any time, the aircraft is on the epipolar line of the first view's pixel in the other view. An image taken at a different time shows
//! it off the line by its motion across the line during the lag. That motion is mostly vertical: almost none on the glide path far out, two
//! pixels per second in level flight and near the runway. So the distance from the line is linear in the motion, and the lag is the slope.
//! Camera errors (direction, roll, focal length) add a linear function of the places, which is fitted with the lag. Along the line, lag and
//! displacement cannot be distinguished.
//!
//! The motion is measured in the other view by its own clock, uncorrected, in the middle of the lag. Motion is less certain than place, so
//! distances after a correction weigh more.

use dataset::geometry::camera::Camera;
use dataset::geometry::rays::{EpipolarLine, LAG_STEP_S, across_sd_px};
use dataset::numbers::least_squares::NormalEquations;
use dataset::numbers::motion::motion_at;
use glam::DVec2;

use crate::clocks::clock_offset::{ClockOffset, LagLine, Sums};

/// Time between the places for the motion, s, and their maximum number.
const PLACE_STEP_S: f64 = 0.19;
const MAX_PLACES: usize = 3_000;
/// Standard deviation per place, px: boxes of ten recorded flights have 0.26 to 0.65.
const PLACE_SD_PX: f64 = 0.4;
/// The lag, its growth, the error of the directions, and its change with column and row in the first view and with the columns between the
/// views.
const UNKNOWNS: usize = 6;
const OF_PLACES: std::ops::Range<usize> = 3..6;
/// Unit of the places, pixels, and the standard deviation of that change, pixels for each: with it, ten recorded flights tell drifts as
/// well as they state.
const UNIT_PX: f64 = 1_000.0;
const OF_PLACES_SD_PX: f64 = 0.06;
/// Measurements before there is a lag, and the most that are kept.
const MIN_MEASUREMENTS: usize = 20;
const MAX_MEASUREMENTS: usize = 600;
/// Minimum standard deviation of lags, s: light and shade change the visible parts.
const MIN_LAG_SD_S: f64 = 0.005;
/// A lag with a larger one is none, seconds.
const MAX_LAG_SD_S: f64 = 1.0;
/// Rounds of reweighting with the previous lag.
const ROUNDS: usize = 3;

/// An aircraft in the images of two cameras that have the same time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Sighting {
    pub(crate) time_s: f64,
    /// Pixels of the same point of the aircraft in the first view and in the other.
    pub(crate) places_px: [DVec2; 2],
    /// Width of the aircraft in the other view.
    pub(crate) width_px: f64,
    /// Seconds that were already added to the time of the other view's image.
    pub(crate) added_s: f64,
}

/// Measures a camera's lag behind the first one over one arrival.
#[derive(Debug, Clone)]
pub(crate) struct VerticalLag {
    cameras: [Camera; 2],
    drift_sd: f64,
    /// Places in the other view, by its own clock.
    places: Vec<(f64, DVec2)>,
    seen: Vec<Measurement>,
}

#[derive(Debug, Clone, Copy)]
struct Measurement {
    time_s: f64,
    /// Column and row in the first view, and columns between the views, in units of [`UNIT_PX`].
    places: [f64; 3],
    /// Unit vector across the line, and the distance from it.
    across: DVec2,
    off_px: f64,
    sd_px: f64,
    added_s: f64,
}

/// A measurement with the motion across the line.
struct Moving {
    seen: Measurement,
    motion_px_s: f64,
    weight: f64,
}

impl VerticalLag {
    /// `drift_sd`: see [`ClockOffset::of`].
    pub(crate) fn between(cameras: [Camera; 2], drift_sd: f64) -> Self {
        Self {
            cameras,
            drift_sd,
            places: Vec::new(),
            seen: Vec::new(),
        }
    }

    /// Takes sightings in the order of time; true if this one is measured.
    pub(crate) fn take(&mut self, sighting: Sighting) -> bool {
        let Sighting {
            time_s,
            places_px: [first_px, other_px],
            added_s,
            ..
        } = sighting;
        let own_s = time_s - added_s;
        if is_due(self.places.last().map(|place| place.0), own_s, PLACE_STEP_S) {
            push(&mut self.places, (own_s, other_px), MAX_PLACES);
        }
        if !is_due(self.seen.last().map(|seen| seen.time_s), time_s, LAG_STEP_S) {
            return false;
        }
        let [first, other] = &self.cameras;
        let Some(line) = EpipolarLine::of([first, other], first_px) else {
            return false;
        };
        let seen = Measurement {
            time_s,
            places: [first_px.x, first_px.y, other_px.x - first_px.x].map(|px| px / UNIT_PX),
            across: line.across,
            off_px: line.off_px(other_px),
            sd_px: across_sd_px(sighting.width_px),
            added_s,
        };
        push(&mut self.seen, seen, MAX_MEASUREMENTS);
        true
    }

    /// The lag, to be added to the times of the other view's images, with its growth; `None` of too few measurements, and if the motion was
    /// always the same.
    pub(crate) fn lag(&self) -> Option<LagLine> {
        let zero_s = self.seen.first()?.time_s;
        let mut lag_s = self.seen.last()?.added_s;
        let mut line = None;
        for _ in 0..ROUNDS {
            let found = line_through(&self.moving(lag_s), zero_s, self.drift_sd)?;
            let best_s = found.best_s()?;
            lag_s = ClockOffset::of(None, self.drift_sd)
                .with(found)
                .at(best_s)?
                .offset_s;
            line = Some(found);
        }
        line
    }

    /// The measurements whose motion is known, for about this lag.
    fn moving(&self, lag_s: f64) -> Vec<Moving> {
        let moving = |seen: &Measurement| {
            let left_s = lag_s - seen.added_s;
            let motion = motion_at(&self.places, seen.time_s - (seen.added_s + lag_s) / 2.0)?;
            let unknown_px = left_s * motion.unit_sd_per_s * PLACE_SD_PX;
            Some(Moving {
                seen: *seen,
                motion_px_s: seen.across.dot(motion.per_s),
                weight: (seen.sd_px.powi(2) + unknown_px.powi(2)).recip(),
            })
        };
        self.seen.iter().filter_map(moving).collect()
    }
}

/// The lag and its growth by least squares, whatever the cameras' errors.
fn line_through(moving: &[Moving], zero_s: f64, drift_sd: f64) -> Option<LagLine> {
    if moving.len() < MIN_MEASUREMENTS {
        return None;
    }
    let mut normal = NormalEquations::new(UNKNOWNS);
    let mut expect_zero = |unknown: usize, sd: f64| {
        let mut row = [0.0; UNKNOWNS];
        row[unknown] = 1.0;
        normal.add(&row, 0.0, sd.powi(-2));
    };
    expect_zero(1, drift_sd);
    OF_PLACES.for_each(|unknown| expect_zero(unknown, OF_PLACES_SD_PX));
    let row = |one: &Moving| {
        let [column, row, apart] = one.seen.places;
        let growing = (one.seen.time_s - zero_s) * one.motion_px_s;
        [one.motion_px_s, growing, 1.0, column, row, apart]
    };
    // As if nothing had been added.
    let off_px = |one: &Moving| one.seen.off_px + one.seen.added_s * one.motion_px_s;
    for one in moving {
        normal.add(&row(one), off_px(one), one.weight);
    }
    let unknowns = normal.solve_for::<UNKNOWNS>()?;
    let left = |one: &Moving| {
        let terms = row(one).into_iter().zip(unknowns);
        let expected = terms.map(|(factor, unknown)| factor * unknown);
        one.weight * (off_px(one) - expected.sum::<f64>()).powi(2)
    };
    // Errors that are larger than expected count, smaller ones may be chance.
    let excess = moving.iter().map(left).sum::<f64>() / (moving.len() - UNKNOWNS) as f64;
    let covariance = normal.inverse()?;
    let [lag, together, growth] = [covariance[0][0], covariance[0][1], covariance[1][1]];
    let determinant = lag * growth - together * together;
    let [weight, time, time_squared] = [growth, -together, lag].map(|of| of / determinant);
    let sums = Sums {
        weight,
        time,
        // The expectation of the growth is the clock's own.
        time_squared: (time_squared - drift_sd.powi(-2)).max(0.0),
        lag: weight * unknowns[0] + time * unknowns[1],
        lag_times_time: time * unknowns[0] + time_squared * unknowns[1],
    };
    let sums = sums.scaled(excess.max(1.0).recip());
    (sums.weight > MAX_LAG_SD_S.powi(-2)).then(|| LagLine {
        zero_s,
        sums: sums.with_common_error(MIN_LAG_SD_S),
    })
}

fn is_due(last_s: Option<f64>, time_s: f64, step_s: f64) -> bool {
    last_s.is_none_or(|last_s| time_s >= last_s + step_s)
}

/// Adds a thing, and forgets the oldest one if there are too many.
fn push<T>(all: &mut Vec<T>, one: T, most: usize) {
    if all.len() == most {
        all.remove(0);
    }
    all.push(one);
}

#[cfg(test)]
mod tests {
    use dataset::geometry::camera::CameraPose;
    use dataset::geometry::geodesy::Geodetic;
    use dataset::geometry::pose::Pose;
    use glam::DVec3;

    use super::*;
    use crate::clocks::clock_offset::{Offset, RECORDING_DRIFT_SD};

    /// Cameras beside a runway that look along the approach, 500 m apart.
    fn cameras() -> [Camera; 2] {
        [0.0, 500.0].map(|aside_m| {
            let pose = Pose {
                latitude_deg: aside_m / 111_000.0,
                longitude_deg: 0.0,
                altitude_msl_m: 10.0,
                heading_true_deg: 90.0,
                pitch_deg: 1.6,
                roll_deg: 0.0,
            };
            let hfov_deg = 10.0;
            Camera::from_pose(&CameraPose { pose, hfov_deg }, 1920, 1280)
        })
    }

    /// Place of the aircraft: level, then on the glide path to a runway before the cameras, and up and down in gusts.
    fn place_m(time_s: f64, gust_m: f64) -> DVec3 {
        let along_m = 22_000.0 - 75.0 * time_s;
        let height_m = 900_f64.min(along_m * 3_f64.to_radians().tan());
        let at = Geodetic {
            latitude_deg: 0.002,
            longitude_deg: (along_m + 1_500.0) / 111_320.0,
            altitude_msl_m: 10.0 + height_m + gust_m * (time_s / 1.3).sin(),
        };
        at.to_ecef()
    }

    /// The final lag for a clock that is slow by `slow_s`, with `added_s` already added.
    fn found(slow_s: impl Fn(f64) -> f64, added_s: impl Fn(f64) -> f64, gust_m: f64) -> Offset {
        const LASTS_S: u32 = 250;
        let cameras = cameras();
        let mut lag = VerticalLag::between(cameras, RECORDING_DRIFT_SD);
        for tick in 0..LASTS_S * 5 {
            let time_s = f64::from(tick) / 5.0;
            let noise_px = 0.04 * (f64::from(tick) * 12.9898).sin() * 1.4;
            let taken_s = time_s + slow_s(time_s) - added_s(time_s);
            let there_px = cameras[1].project(place_m(taken_s, gust_m));
            lag.take(Sighting {
                time_s,
                places_px: [
                    cameras[0].project(place_m(time_s, gust_m)).unwrap(),
                    // A camera that is turned a little.
                    there_px.unwrap() + DVec2::new(1.5, noise_px - 0.8),
                ],
                width_px: 30.0,
                added_s: added_s(time_s),
            });
        }
        let clock = ClockOffset::of(None, RECORDING_DRIFT_SD).with(lag.lag().unwrap());
        clock.at(f64::from(LASTS_S)).unwrap()
    }

    fn assert_found(found: Offset, slow_s: f64, most_s: f64) {
        let error_s = (found.offset_s - slow_s).abs();
        assert!(error_s < most_s, "{slow_s}: {found:?}");
        assert!(error_s < 3.0 * found.sd_s, "{slow_s}: {found:?}");
    }

    #[test]
    fn an_arrival_with_a_level_segment_tells_the_lag() {
        for (slow_s, added_s) in [(-0.3, 0.0), (0.0, 0.0), (0.5, 0.0), (0.5, 0.4)] {
            let found = found(|_| slow_s, |_| added_s, 0.0);
            assert_found(found, slow_s, 0.01);
            assert!(found.sd_s < 0.025, "{slow_s}: {found:?}");
        }
    }

    #[test]
    fn gusts_and_a_correction_on_the_way_do_not_disturb_it() {
        let corrected = |time_s: f64| if time_s < 70.0 { 0.0 } else { 0.52 };
        for slow_s in [0.5, -0.5] {
            let added_s = |time_s: f64| f64::copysign(corrected(time_s), slow_s);
            assert_found(found(|_| slow_s, added_s, 3.0), slow_s, 0.008);
        }
    }

    #[test]
    fn an_arrival_tells_that_a_lag_grows() {
        for drift in [100e-6, -100e-6] {
            let found = found(|time_s| 0.5 + drift * time_s, |_| 0.5, 0.0);
            assert_found(found, 0.5 + 250.0 * drift, 0.015);
            let part = found.drift_ppm * 1e-6 / drift;
            assert!((0.25..1.2).contains(&part), "{drift}: {found:?}");
        }
    }

    #[test]
    fn a_lag_needs_motion_that_changes() {
        let mut lag = VerticalLag::between(cameras(), RECORDING_DRIFT_SD);
        for second in 0..60 {
            let sighting = Sighting {
                time_s: f64::from(second),
                places_px: [DVec2::new(900.0, 600.0); 2],
                width_px: 30.0,
                added_s: 0.0,
            };
            assert!(lag.take(sighting) && !lag.take(sighting));
        }
        assert!(lag.lag().is_none());
    }
}
