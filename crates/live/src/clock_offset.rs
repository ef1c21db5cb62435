//! The offset of two cameras' clocks, from where both see the same aircraft.
//!
//! At one time the aircraft is on a line of the second view that the first one's pixel defines (epipolar). Images that were taken later
//! show it off that line by its motion across it. That motion is mostly vertical: nearly none on the glide path far out, two pixels a
//! second in level flight and near the runway. So a straight line through (motion, distance from the line) has the offset as its slope, and
//! the error of the cameras' directions as its beginning. Along the line, an offset cannot be told from a displacement of the aircraft.

use dataset::geometry::camera::Camera;
use dataset::geometry::rays::Ray;
use glam::DVec2;

/// Ranges of the points that define the line, metres.
const NEAR_M: f64 = 2_000.0;
const FAR_M: f64 = 30_000.0;
/// Seconds between measurements: errors of neighbouring images are alike.
const STEP_S: f64 = 0.5;
/// Measurements before there is an estimate.
const FEWEST: f64 = 40.0;
/// No measurement has a smaller standard deviation, pixels; and no offset, seconds.
const LEAST_SD_PX: f64 = 0.1;
const LEAST_SD_S: f64 = 0.003;

/// An offset of a clock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Offset {
    /// To be added to the times of the second view, seconds.
    pub(crate) seconds: f64,
    pub(crate) sd_s: f64,
}

/// Measurements of the offset of a view from the first one.
#[derive(Debug, Clone, Default)]
pub(crate) struct ClockOffset {
    last_s: Option<f64>,
    count: f64,
    motion: f64,
    motion_squared: f64,
    off: f64,
    off_squared: f64,
    off_times_motion: f64,
}

impl ClockOffset {
    /// Takes where both cameras, of the first view and of this one, see the aircraft in images of the same time, and by how much it moves
    /// in this view in a second.
    pub(crate) fn take(
        &mut self,
        time_s: f64,
        cameras: [&Camera; 2],
        places_px: [DVec2; 2],
        motion_px_s: DVec2,
    ) {
        if self.last_s.is_some_and(|last_s| time_s < last_s + STEP_S) {
            return;
        }
        let ray = Ray::through(cameras[0], places_px[0]);
        let at = |range_m: f64| cameras[1].project(ray.origin_m + range_m * ray.direction);
        let (Some(near), Some(far)) = (at(NEAR_M), at(FAR_M)) else {
            return;
        };
        let Some(along) = (far - near).try_normalize() else {
            return;
        };
        let across = along.perp() * along.x.signum();
        self.last_s = Some(time_s);
        let (off_px, motion_px_s) = (across.dot(places_px[1] - far), across.dot(motion_px_s));
        self.count += 1.0;
        self.motion += motion_px_s;
        self.motion_squared += motion_px_s * motion_px_s;
        self.off += off_px;
        self.off_squared += off_px * off_px;
        self.off_times_motion += off_px * motion_px_s;
    }

    /// The offset that remains, once it is known at all.
    pub(crate) fn remaining(&self) -> Option<Offset> {
        if self.count < FEWEST {
            return None;
        }
        let spread = self.motion_squared - self.motion * self.motion / self.count;
        let together = self.off_times_motion - self.off * self.motion / self.count;
        let off = self.off_squared - self.off * self.off / self.count;
        if spread <= 0.0 {
            return None;
        }
        let seconds = together / spread;
        let left = (off - seconds * together).max(0.0);
        let sd_px = (left / (self.count - 2.0)).sqrt().max(LEAST_SD_PX);
        let sd_s = (sd_px / spread.sqrt()).hypot(LEAST_SD_S);
        Some(Offset { seconds, sd_s })
    }

    /// These seconds are added to the times of the view from now on: what was measured is as if they had always been.
    pub(crate) fn applied(&mut self, seconds: f64) {
        self.off_squared += seconds * (seconds * self.motion_squared - 2.0 * self.off_times_motion);
        self.off -= seconds * self.motion;
        self.off_times_motion -= seconds * self.motion_squared;
    }
}

#[cfg(test)]
mod tests {
    use dataset::geometry::geodesy::Geodetic;
    use glam::DVec3;
    use testkit::changi_02l;
    use testkit::rig::{VIEWS, placed};

    use super::*;

    const LEVEL_M: f64 = 900.0;
    const SPEED_MPS: f64 = 75.0;

    /// The aircraft a time after it is 24 km from the target: level, then on the glide path.
    fn place_m(time_s: f64) -> DVec3 {
        let runway = changi_02l();
        let along_m = 24_000.0 - SPEED_MPS * time_s;
        let height_m = LEVEL_M.min(along_m * 3_f64.to_radians().tan());
        let altitude_m = runway.threshold.altitude_msl_m + height_m;
        let at: Geodetic = runway
            .point_on_approach(along_m, 0.0)
            .at_altitude_m(altitude_m);
        at.to_ecef()
    }

    /// Measures an arrival whose second view has a clock that is slow by this much.
    fn measured(offset_s: f64, arrivals: usize) -> ClockOffset {
        let [left, right] = VIEWS.map(|view| Camera::from_pose(&placed(view), 1920, 1280));
        let mut clock = ClockOffset::default();
        for tick in 0..arrivals * 280 * 10 {
            let time_s = tick as f64 / 10.0;
            let flown_s = (tick % 2_800) as f64 / 10.0;
            let seen = |later_s: f64| {
                right
                    .project(place_m(flown_s + offset_s + later_s))
                    .unwrap()
            };
            let noise = |phase: f64| 0.1 * (tick as f64 * 12.9898 + phase).sin() * 1.4;
            let there = seen(0.0) + DVec2::new(noise(0.3) + 1.5, noise(1.7) - 0.8);
            let here = left.project(place_m(flown_s)).unwrap();
            let motion = (seen(0.1) - seen(-0.1)) / 0.2;
            clock.take(time_s, [&left, &right], [here, there], motion);
        }
        clock
    }

    #[test]
    fn an_arrival_with_a_level_segment_tells_the_offset_of_the_clocks() {
        for offset_s in [-0.3, 0.0, 0.5] {
            let found = measured(offset_s, 1).remaining().unwrap();
            let error_s = found.seconds - offset_s;
            assert!(error_s.abs() < 0.02, "{offset_s}: {found:?}");
            assert!(error_s.abs() < 3.0 * found.sd_s, "{offset_s}: {found:?}");
            assert!(found.sd_s < 0.03, "{offset_s}: {found:?}");
        }
    }

    #[test]
    fn an_offset_that_was_applied_does_not_remain() {
        let mut clock = measured(0.5, 1);
        let found = clock.remaining().unwrap();
        clock.applied(found.seconds);
        let left = clock.remaining().unwrap();
        assert!(left.seconds.abs() < 1e-9 && (left.sd_s - found.sd_s).abs() < 1e-9);
    }

    #[test]
    fn too_little_is_said_to_be_unknown() {
        assert_eq!(ClockOffset::default().remaining(), None);
    }
}
