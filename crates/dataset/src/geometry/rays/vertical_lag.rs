//! The lag between the clocks of two cameras, from where both see the same aircraft.
//!
//! At one time the aircraft is on a line of the other view that the first one's pixel defines (epipolar). Images that were taken later
//! show it off that line by its motion across it. That motion is mostly vertical: nearly none on the glide path far out, two pixels a
//! second in level flight and near the runway. So a straight line through (motion, distance from the line) has the lag as its slope, and
//! the error of the cameras' directions as its beginning. Along the line, a lag cannot be told from a displacement of the aircraft.

use std::collections::VecDeque;

use glam::DVec2;

use super::EpipolarLine;
use crate::geometry::camera::Camera;

/// Seconds between measurements: errors of neighbouring images are alike.
pub const LAG_STEP_S: f64 = 0.95;
/// Seconds before and after a measurement in which its motion is read off.
const SPAN_S: f64 = 2.1;
/// Measurements before there is a lag, and the most that are kept.
const FEWEST: usize = 20;
const MOST: usize = 600;
/// Standard deviation of a measurement, pixels, and per pixel of the aircraft's width: its parts have other distances.
const SD_PX: f64 = 0.04;
const SD_PART: f64 = 0.003;
/// No lag of one arrival has a smaller one, seconds: light and shade change which parts the views show.
const LEAST_SD_S: f64 = 0.005;

/// Standard deviation of the distance of registered places of an aircraft from the line, pixels. `width_px`: of the aircraft.
pub fn across_sd_px(width_px: f64) -> f64 {
    SD_PX.hypot(SD_PART * width_px)
}

/// An aircraft in the images of two cameras that have the same time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// The time, seconds.
    pub time_s: f64,
    /// Pixels of the same point of the aircraft in the first view and in the other.
    pub places_px: [DVec2; 2],
    /// Width of the aircraft in the other view.
    pub width_px: f64,
    /// Seconds that were already added to the time of the other view's image.
    pub added_s: f64,
}

/// A lag.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lag {
    /// The time for which it is best known, seconds.
    pub time_s: f64,
    /// To be added to the times of the other view's images, seconds.
    pub seconds: f64,
    /// Standard deviation of it.
    pub sd_s: f64,
}

/// Measures the lag of a camera from the first one over one arrival.
#[derive(Debug, Clone)]
pub struct VerticalLag {
    cameras: [Camera; 2],
    seen: VecDeque<Seen>,
}

#[derive(Debug, Clone, Copy)]
struct Seen {
    time_s: f64,
    place_px: DVec2,
    /// Unit vector across the line, and the distance from it.
    across: DVec2,
    off_px: f64,
    sd_px: f64,
    added_s: f64,
}

impl VerticalLag {
    /// For the first view's camera and another one.
    pub fn between(cameras: [&Camera; 2]) -> Self {
        Self {
            cameras: cameras.map(|camera| *camera),
            seen: VecDeque::new(),
        }
    }

    /// Takes where both cameras see the aircraft, in the order of time.
    pub fn take(&mut self, sighting: Sighting) {
        let Sighting {
            time_s, places_px, ..
        } = sighting;
        let last_s = self.seen.back().map(|seen| seen.time_s);
        if last_s.is_some_and(|last_s| time_s < last_s + LAG_STEP_S) {
            return;
        }
        let [first, second] = &self.cameras;
        let Some(line) = EpipolarLine::of([first, second], places_px[0]) else {
            return;
        };
        if self.seen.len() == MOST {
            self.seen.pop_front();
        }
        self.seen.push_back(Seen {
            time_s,
            place_px: places_px[1],
            across: line.across,
            off_px: line.off_px(places_px[1]),
            sd_px: across_sd_px(sighting.width_px),
            added_s: sighting.added_s,
        });
    }

    /// True if nothing was taken yet.
    pub fn is_empty(&self) -> bool {
        self.seen.is_empty()
    }

    /// The lag; `None` of too few measurements, and if the motion was always the same.
    pub fn lag(&self) -> Option<Lag> {
        let moving = self.seen.iter();
        let moving: Vec<(Seen, f64)> = moving
            .filter_map(|seen| Some((*seen, self.motion_px_s(seen)?)))
            .collect();
        if moving.len() < FEWEST {
            return None;
        }
        let weighted = |of: &dyn Fn(&Seen, f64) -> f64| -> f64 {
            let terms = moving.iter();
            terms
                .map(|(seen, motion)| of(seen, *motion) * seen.sd_px.powi(-2))
                .sum()
        };
        // As if nothing had been added.
        let off = |seen: &Seen, motion: f64| seen.off_px + seen.added_s * motion;
        let weight = weighted(&|_, _| 1.0);
        let mean_motion = weighted(&|_, motion| motion) / weight;
        let mean_off = weighted(&off) / weight;
        let spread = weighted(&|_, motion| (motion - mean_motion).powi(2));
        if spread <= 0.0 {
            return None;
        }
        let product = |seen: &Seen, motion: f64| (motion - mean_motion) * off(seen, motion);
        let seconds = weighted(&product) / spread;
        let left = |seen: &Seen, motion: f64| {
            let expected = mean_off + seconds * (motion - mean_motion);
            (off(seen, motion) - expected).powi(2)
        };
        // Errors that are larger than expected count, smaller ones may be chance.
        let excess = (weighted(&left) / (moving.len() - 2) as f64).max(1.0);
        let times = |seen: &Seen, motion: f64| seen.time_s * (motion - mean_motion).powi(2);
        Some(Lag {
            time_s: weighted(&times) / spread,
            seconds,
            sd_s: (excess / spread).sqrt().hypot(LEAST_SD_S),
        })
    }

    /// Motion across the line, from the places before and after.
    fn motion_px_s(&self, seen: &Seen) -> Option<f64> {
        let near = |other: &&Seen| (other.time_s - seen.time_s).abs() <= SPAN_S;
        // They are in order, so that few are looked at.
        let from = (self.seen).partition_point(|other| other.time_s < seen.time_s - SPAN_S);
        let around: Vec<&Seen> = self.seen.range(from..).take_while(near).collect();
        let (first, last) = (around.first()?, around.last()?);
        if first.time_s >= seen.time_s || last.time_s <= seen.time_s {
            return None;
        }
        let count = around.len() as f64;
        let mean_s = around.iter().map(|seen| seen.time_s).sum::<f64>() / count;
        let spread: f64 = (around.iter().map(|seen| (seen.time_s - mean_s).powi(2))).sum();
        let places = around.iter();
        let together: DVec2 = places
            .map(|seen| seen.place_px * (seen.time_s - mean_s))
            .sum();
        Some(seen.across.dot(together) / spread)
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::geometry::camera::CameraPose;
    use crate::geometry::geodesy::Geodetic;
    use crate::geometry::pose::Pose;

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

    /// Place of the aircraft: level, then on the glide path to a runway before the cameras.
    fn place_m(time_s: f64) -> DVec3 {
        let along_m = 22_000.0 - 75.0 * time_s;
        let height_m = 900_f64.min(along_m * 3_f64.to_radians().tan());
        let at = Geodetic {
            latitude_deg: 0.002,
            longitude_deg: (along_m + 1_500.0) / 111_320.0,
            altitude_msl_m: 10.0 + height_m,
        };
        at.to_ecef()
    }

    /// The lag that is found if the other view's clock is slow by this, of which so much was added already.
    fn found(slow_s: f64, added_s: f64) -> Lag {
        let cameras = cameras();
        let mut lag = VerticalLag::between([&cameras[0], &cameras[1]]);
        for tick in 0..250 * 5 {
            let time_s = f64::from(tick) / 5.0;
            let noise_px = 0.04 * (f64::from(tick) * 12.9898).sin() * 1.4;
            let there_px = cameras[1].project(place_m(time_s + slow_s - added_s));
            lag.take(Sighting {
                time_s,
                places_px: [
                    cameras[0].project(place_m(time_s)).unwrap(),
                    // A camera that is turned a little.
                    there_px.unwrap() + DVec2::new(1.5, noise_px - 0.8),
                ],
                width_px: 30.0,
                added_s,
            });
        }
        lag.lag().unwrap()
    }

    #[test]
    fn an_arrival_with_a_level_segment_tells_the_lag() {
        for (slow_s, added_s) in [(-0.3, 0.0), (0.0, 0.0), (0.5, 0.0), (0.5, 0.4)] {
            let found = found(slow_s, added_s);
            let error_s = (found.seconds - slow_s).abs();
            assert!(error_s < 0.02, "{slow_s}, {added_s}: {found:?}");
            assert!(error_s < 3.0 * found.sd_s, "{slow_s}: {found:?}");
            assert!(found.sd_s < 0.015, "{slow_s}: {found:?}");
            assert!((0.0..250.0).contains(&found.time_s));
        }
    }

    #[test]
    fn a_lag_needs_motion_that_changes() {
        let cameras = cameras();
        let mut lag = VerticalLag::between([&cameras[0], &cameras[1]]);
        for second in 0..60 {
            let places_px = [DVec2::new(900.0, 600.0); 2];
            lag.take(Sighting {
                time_s: f64::from(second),
                places_px,
                width_px: 30.0,
                added_s: 0.0,
            });
        }
        assert!(!lag.is_empty() && lag.lag().is_none());
    }
}
