//! Tolerance between the requested pose and the one that a simulator drew, shared by recording and verification.
//!
//! An echo is a simulator's report of the places of aircraft and camera when it drew an image. X-Plane places both in 32-bit floats, in
//! metres from an origin that may be 50 km away, and rotates them in 32-bit degrees. So an echo matches only approximately. The tolerance
//! is the rounding of those floats with a margin, and far less than a pixel: at a field of view of 10 degrees on 1920 pixels, 0.0002
//! degrees are 0.04 pixels. The next tick is metres away and never within tolerance.

use crate::geometry::camera::CameraPose;
use crate::geometry::pose::Pose;

/// Maximum distance between drawn and requested position, metres.
pub(crate) const POSITION_TOLERANCE_M: f64 = 0.01;
/// Maximum error of the aircraft's heading, pitch or roll, degrees.
pub(crate) const AIRCRAFT_ANGLE_TOLERANCE_DEG: f64 = 0.001;
/// Maximum error of the camera's heading, pitch, roll or field of view, degrees.
pub(crate) const CAMERA_ANGLE_TOLERANCE_DEG: f64 = 0.0002;

/// The first value of the drawn pose of the aircraft that differs from the requested one, in words.
pub fn aircraft_mismatch(drawn: &Pose, expected: &Pose) -> Option<String> {
    pose_mismatch(drawn, expected, AIRCRAFT_ANGLE_TOLERANCE_DEG)
}

/// The first value of the camera that an image was taken with that differs from the requested one, in words.
pub fn camera_mismatch(drawn: &CameraPose, expected: &CameraPose) -> Option<String> {
    let hfov = ("hfov_deg", drawn.hfov_deg, expected.hfov_deg);
    pose_mismatch(&drawn.pose, &expected.pose, CAMERA_ANGLE_TOLERANCE_DEG)
        .or_else(|| angle_mismatch(hfov, CAMERA_ANGLE_TOLERANCE_DEG))
}

fn pose_mismatch(drawn: &Pose, expected: &Pose, tolerance_deg: f64) -> Option<String> {
    let [found, asked] = [drawn, expected].map(Pose::position);
    let off_m = found.to_ecef().distance(asked.to_ecef());
    if !within(off_m, POSITION_TOLERANCE_M) {
        let [found, asked] = [found, asked].map(|at| {
            let (latitude_deg, longitude_deg) = (at.latitude_deg, at.longitude_deg);
            format!("{latitude_deg} {longitude_deg} {}", at.altitude_msl_m)
        });
        return Some(format!(
            "position {found}, expected {asked} (latitude, longitude, metres): {off_m:.4} m apart, at most {POSITION_TOLERANCE_M} m"
        ));
    }
    [
        (
            "heading_true_deg",
            drawn.heading_true_deg,
            expected.heading_true_deg,
        ),
        ("pitch_deg", drawn.pitch_deg, expected.pitch_deg),
        ("roll_deg", drawn.roll_deg, expected.roll_deg),
    ]
    .into_iter()
    .find_map(|angle| angle_mismatch(angle, tolerance_deg))
}

fn angle_mismatch(
    (name, drawn_deg, expected_deg): (&str, f64, f64),
    tolerance_deg: f64,
) -> Option<String> {
    // 359.9999 and 0.0001 are neighbours.
    let off_deg = (drawn_deg - expected_deg + 180.0).rem_euclid(360.0) - 180.0;
    (!within(off_deg.abs(), tolerance_deg))
        .then(|| format!("{name} {drawn_deg}, expected {expected_deg} within {tolerance_deg}"))
}

/// False for NaN.
fn within(off: f64, tolerance: f64) -> bool {
    off <= tolerance
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> CameraPose {
        CameraPose {
            pose: Pose {
                latitude_deg: 1.36,
                longitude_deg: 103.98,
                altitude_msl_m: 16.7,
                heading_true_deg: 0.0,
                pitch_deg: 1.6,
                roll_deg: 0.0,
            },
            hfov_deg: 10.0,
        }
    }

    #[test]
    fn what_32_bit_floats_lose_within_fifty_kilometres_is_allowed() {
        let expected = camera();
        let mut drawn = expected;
        // Half an f32 step at 50 km is 2 mm; 1 degree of latitude is 110.6 km here.
        drawn.pose.latitude_deg += 0.002 / 110_600.0;
        drawn.pose.altitude_msl_m -= 0.002;
        drawn.pose.heading_true_deg = 359.9999;
        drawn.pose.pitch_deg = f64::from(1.6_f32);
        assert_eq!(camera_mismatch(&drawn, &expected), None);
        assert_eq!(aircraft_mismatch(&drawn.pose, &expected.pose), None);
    }

    #[test]
    fn a_value_just_beyond_its_tolerance_is_named() {
        type Change = fn(&mut CameraPose);
        let cases: [(&str, Change); 7] = [
            ("position", |c| c.pose.latitude_deg += 0.011 / 110_500.0),
            ("position", |c| c.pose.longitude_deg -= 0.011 / 111_200.0),
            ("position", |c| c.pose.altitude_msl_m += 0.0101),
            ("heading_true_deg", |c| c.pose.heading_true_deg -= 0.00021),
            ("pitch_deg", |c| c.pose.pitch_deg += 0.00021),
            ("roll_deg", |c| c.pose.roll_deg = f64::NAN),
            ("hfov_deg", |c| c.hfov_deg += 0.00021),
        ];
        for (name, change) in cases {
            let mut drawn = camera();
            change(&mut drawn);
            let found = camera_mismatch(&drawn, &camera()).unwrap();
            assert!(found.starts_with(name), "{name}: {found}");
        }
        let mut nowhere = camera();
        nowhere.pose.latitude_deg = f64::NAN;
        assert!(camera_mismatch(&nowhere, &camera()).is_some());
    }

    #[test]
    fn the_aircraft_is_allowed_five_times_the_angle_of_the_camera_and_no_more() {
        let expected = camera().pose;
        let rolled = |by_deg: f64| Pose {
            roll_deg: by_deg,
            ..expected
        };
        assert_eq!(aircraft_mismatch(&rolled(0.00099), &expected), None);
        assert!(aircraft_mismatch(&rolled(0.00101), &expected).is_some());
    }
}
