//! Position and orientation of aircraft and cameras.
//!
//! Angles follow aviation (and X-Plane): heading clockwise from true north, pitch nose up, roll right wing down, applied in that order.
//! Body axes are x forward, y right, z down.

use glam::{DMat3, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::geometry::geodesy::Geodetic;
use crate::numbers::limits::{self, Check, Limits, check_fields};

/// Position and attitude.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Pose {
    /// Geodetic latitude (WGS-84), degrees.
    pub latitude_deg: f64,
    /// Longitude (WGS-84), degrees.
    pub longitude_deg: f64,
    /// Height above mean sea level (taken as above the ellipsoid) of the body's origin, metres.
    pub altitude_msl_m: f64,
    /// Heading, degrees clockwise from true north.
    pub heading_true_deg: f64,
    /// Pitch, degrees, nose up positive.
    pub pitch_deg: f64,
    /// Roll, degrees, right wing down positive.
    pub roll_deg: f64,
}

impl Pose {
    /// Checks for numbers outside an aircraft's limits.
    pub fn check_aircraft(&self, check: &mut Check) {
        self.check((limits::PITCH_DEG, limits::ROLL_DEG), check);
    }

    /// Checks for numbers outside a camera's limits.
    pub(crate) fn check_camera(&self, check: &mut Check) {
        self.check((limits::CAMERA_PITCH_DEG, limits::CAMERA_ROLL_DEG), check);
    }

    fn check(&self, (pitch, roll): (Limits, Limits), check: &mut Check) {
        self.position().check(limits::ALTITUDE_MSL_M, check);
        check_fields!(check, self, {
            heading_true_deg: limits::HEADING_TRUE_DEG,
            pitch_deg: pitch,
            roll_deg: roll,
        });
    }

    /// The position only.
    pub fn position(&self) -> Geodetic {
        Geodetic {
            latitude_deg: self.latitude_deg,
            longitude_deg: self.longitude_deg,
            altitude_msl_m: self.altitude_msl_m,
        }
    }

    /// This pose's attitude at a different position.
    pub fn moved_to(self, position: Geodetic) -> Self {
        Self {
            latitude_deg: position.latitude_deg,
            longitude_deg: position.longitude_deg,
            altitude_msl_m: position.altitude_msl_m,
            ..self
        }
    }

    /// Rotation from body axes (forward, right, down) to local north, east, down.
    pub fn ned_from_body(&self) -> DMat3 {
        DMat3::from_rotation_z(self.heading_true_deg.to_radians())
            * DMat3::from_rotation_y(self.pitch_deg.to_radians())
            * DMat3::from_rotation_x(self.roll_deg.to_radians())
    }

    /// Rotation from body axes to ECEF.
    pub fn ecef_from_body(&self) -> DMat3 {
        self.position().ecef_from_ned() * self.ned_from_body()
    }

    /// ECEF coordinates of the point given in body axes (metres).
    pub fn body_point_to_ecef(&self, body_m: DVec3) -> DVec3 {
        self.position().to_ecef() + self.ecef_from_body() * body_m
    }
}

/// Positions of the movable parts, 0 to 1, as in X-Plane and the recorded flights.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Controls {
    /// Flaps, 0 up to 1 full.
    pub flap_ratio: f64,
    /// Landing gear, 0 up to 1 down.
    pub gear_ratio: f64,
}

/// An instant of the flight: the 4D trajectory is a list of instants.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FlightState {
    /// Seconds since the flight started.
    pub time_s: f64,
    /// Position and attitude of the centre of gravity.
    pub pose: Pose,
    /// Velocity over ground: north, metres per second.
    pub velocity_north_mps: f64,
    /// Velocity over ground: east, metres per second.
    pub velocity_east_mps: f64,
    /// Velocity over ground: down, metres per second.
    pub velocity_down_mps: f64,
    /// True airspeed, metres per second.
    pub true_airspeed_mps: f64,
    /// Flaps and gear.
    pub controls: Controls,
    /// True if a wheel touches the ground.
    pub on_ground: bool,
}

impl FlightState {
    /// Checks for numbers that are impossible for an airliner on approach.
    pub fn check(&self, check: &mut Check) {
        check_fields!(check, self, { time_s: limits::FLIGHT_TIME_S });
        self.pose.check_aircraft(check);
        check_fields!(check, self, {
            velocity_north_mps: limits::VELOCITY_MPS,
            velocity_east_mps: limits::VELOCITY_MPS,
            velocity_down_mps: limits::VELOCITY_DOWN_MPS,
            true_airspeed_mps: limits::TRUE_AIRSPEED_MPS,
        });
        check_fields!(check, self.controls, {
            flap_ratio: limits::RATIO,
            gear_ratio: limits::RATIO,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn level(heading_true_deg: f64) -> Pose {
        Pose {
            latitude_deg: 1.3,
            longitude_deg: 104.0,
            altitude_msl_m: 0.0,
            heading_true_deg,
            pitch_deg: 0.0,
            roll_deg: 0.0,
        }
    }

    #[test]
    fn heading_east_points_the_nose_east_and_the_right_wing_south() {
        let rotation = level(90.0).ned_from_body();
        assert!((rotation * DVec3::X).abs_diff_eq(DVec3::Y, 1e-12));
        assert!((rotation * DVec3::Y).abs_diff_eq(-DVec3::X, 1e-12));
    }

    #[test]
    fn positive_pitch_lifts_the_nose_and_positive_roll_lowers_the_right_wing() {
        let nose = Pose {
            pitch_deg: 10.0,
            ..level(0.0)
        }
        .ned_from_body()
            * DVec3::X;
        assert!(nose.z < -0.17, "down component {}", nose.z);
        let right_wing = Pose {
            roll_deg: 10.0,
            ..level(0.0)
        }
        .ned_from_body()
            * DVec3::Y;
        assert!(right_wing.z > 0.17, "down component {}", right_wing.z);
    }
}
