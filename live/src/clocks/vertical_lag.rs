//! Lag between the clocks of two cameras, from an aircraft that both see during an arrival ([`sight::lag`]).
//!
//! The aircraft is on the epipolar line of the first view's pixel in the other view. The motion off that line is measured in the other view
//! by its own clock, uncorrected.

use std::slice::from_ref;

use dataset::geometry::camera::Camera;
use dataset::geometry::rays::{EpipolarLine, LAG_STEP_S};
use sight::lag::{self, PLACE_TERMS, Rows, Sighting};

use crate::clocks::clock_offset::Lag;

/// Time between sightings, s, and their maximum number.
const STEP_S: f64 = 0.19;
const MAX_SIGHTINGS: usize = 3_000;
/// Standard deviations of what cameras add to rows, pixels: a direction that is unknown, and slopes over a thousand pixels. With these,
/// ten recorded flights tell lags as well as they state.
const CAMERA_SD_PX: [f64; PLACE_TERMS] = [100.0, 0.06, 0.06, 0.06];
/// Minimum number of sightings that count.
const MIN_COUNTING: usize = 20;
/// Minimum standard deviation of lags, s: light and shade change the visible parts.
const MIN_LAG_SD_S: f64 = 0.005;
/// A lag with a larger one is none, seconds.
const MAX_LAG_SD_S: f64 = 1.0;

/// Measures a camera's lag behind the first one over one arrival.
#[derive(Debug, Clone)]
pub(crate) struct VerticalLag {
    cameras: [Camera; 2],
    seen: Vec<Sighting>,
    measured_s: f64,
    /// The last lag, seconds.
    about_s: f64,
}

impl VerticalLag {
    pub(crate) fn between(cameras: [Camera; 2]) -> Self {
        Self {
            cameras,
            seen: Vec::new(),
            measured_s: f64::NEG_INFINITY,
            about_s: 0.0,
        }
    }

    /// Takes sightings in the order of time; true if it is worth measuring again.
    pub(crate) fn take(&mut self, sighting: Sighting) -> bool {
        let time_s = sighting.time_s;
        if self
            .seen
            .last()
            .is_some_and(|last| time_s < last.time_s + STEP_S)
        {
            return false;
        }
        if self.seen.len() == MAX_SIGHTINGS {
            self.seen.remove(0);
        }
        self.seen.push(sighting);
        let is_due = time_s >= self.measured_s + LAG_STEP_S;
        if is_due {
            self.measured_s = time_s;
        }
        is_due
    }

    /// The lag, to be added to the times of the other view's images; `None` of too few sightings, and if the motion was always the same.
    pub(crate) fn lag(&mut self) -> Option<Lag> {
        let [first, other] = &self.cameras;
        let rows = Rows {
            off_px: &|[here_px, there_px]| {
                Some(EpipolarLine::of([first, other], here_px)?.off_px(there_px))
            },
            sd_px: CAMERA_SD_PX,
        };
        let fit = lag::constant(from_ref(&self.seen), &rows, self.about_s)?;
        let [lag] = fit.lags[..] else { return None };
        self.about_s = lag.seconds;
        let is_known = fit.sightings >= MIN_COUNTING && lag.sd_s < MAX_LAG_SD_S;
        is_known.then(|| Lag {
            at_s: fit.best_s,
            // A late image has too late a time.
            seconds: -lag.seconds,
            sd_s: lag.sd_s.hypot(MIN_LAG_SD_S),
        })
    }
}

#[cfg(test)]
mod tests {
    use dataset::geometry::camera::CameraPose;
    use dataset::geometry::geodesy::Geodetic;
    use dataset::geometry::pose::Pose;
    use glam::{DVec2, DVec3};

    use super::*;
    use crate::clocks::clock_offset::{ClockOffset, Offset, RECORDING_DRIFT_SD};

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
        let mut lag = VerticalLag::between(cameras);
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
                sd_px: 0.1,
                taken_off_s: -added_s(time_s),
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
            assert_found(found(|_| slow_s, added_s, 3.0), slow_s, 0.015);
        }
    }

    #[test]
    fn a_lag_needs_motion_that_changes() {
        let mut lag = VerticalLag::between(cameras());
        for second in 0..60 {
            let sighting = Sighting {
                time_s: f64::from(second),
                places_px: [DVec2::new(900.0, 600.0); 2],
                width_px: 30.0,
                sd_px: 0.1,
                taken_off_s: 0.0,
            };
            assert!(lag.take(sighting) && !lag.take(sighting));
        }
        assert!(lag.lag().is_none());
    }
}
