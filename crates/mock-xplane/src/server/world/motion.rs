//! Aircraft motion between placements: calm, turning with the bank, levelling out, and never completely still.
//!
//! This is not a flight model: approaches are flown by [`flight_model`]. It makes the values that clients read over UDP move as in
//! a simulator, with rates consistent with the attitudes.

use dataset::geometry::geodesy::Geodetic;
use dataset::geometry::pose::FlightState;
use glam::DVec3;

const GRAVITY_MPS2: f64 = 9.81;
/// Time constant of the return of bank and pitch to their trim, seconds.
const RIGHTING_S: f64 = 3.0;
const TRIM_PITCH_DEG: f64 = 2.5;
/// Amplitude and period of the disturbance in roll.
const ROLL_UNREST: (f64, f64) = (0.6, 9.0);
/// Amplitude and period of the disturbance in pitch.
const PITCH_UNREST: (f64, f64) = (0.2, 5.0);
/// Minimum flying speed, metres per second.
pub(in crate::server) const FLYING_MPS: f64 = 20.0;

/// Rates of rotation about the body's axes, degrees per second.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Rates {
    pub(super) roll_deg_s: f64,
    pub(super) pitch_deg_s: f64,
    pub(super) yaw_deg_s: f64,
}

pub(super) fn is_flying(state: &FlightState) -> bool {
    !state.on_ground && state.velocity_north_mps.hypot(state.velocity_east_mps) > FLYING_MPS
}

/// Lets a flying aircraft continue for `elapsed_s`; returns its rates.
pub(super) fn fly_on(state: &mut FlightState, elapsed_s: f64) -> Rates {
    state.time_s += elapsed_s;
    let unrest = |(amplitude_deg, period_s): (f64, f64)| {
        amplitude_deg * (std::f64::consts::TAU * state.time_s / period_s).sin()
    };
    let (roll_goal_deg, pitch_goal_deg) =
        (unrest(ROLL_UNREST), TRIM_PITCH_DEG + unrest(PITCH_UNREST));
    let pose = &mut state.pose;
    let speed_mps = state.velocity_north_mps.hypot(state.velocity_east_mps);
    // Euler angles' rates: righting in bank and pitch, a coordinated turn in heading.
    let roll_rate = (roll_goal_deg - pose.roll_deg) / RIGHTING_S;
    let pitch_rate = (pitch_goal_deg - pose.pitch_deg) / RIGHTING_S;
    let heading_rate = (GRAVITY_MPS2 * pose.roll_deg.to_radians().tan() / speed_mps).to_degrees();
    let ((sin_roll, cos_roll), (sin_pitch, cos_pitch)) = (
        pose.roll_deg.to_radians().sin_cos(),
        pose.pitch_deg.to_radians().sin_cos(),
    );
    let rates = Rates {
        roll_deg_s: roll_rate - heading_rate * sin_pitch,
        pitch_deg_s: pitch_rate * cos_roll + heading_rate * sin_roll * cos_pitch,
        yaw_deg_s: heading_rate * cos_roll * cos_pitch - pitch_rate * sin_roll,
    };
    pose.roll_deg += roll_rate * elapsed_s;
    pose.pitch_deg += pitch_rate * elapsed_s;
    pose.heading_true_deg = (pose.heading_true_deg + heading_rate * elapsed_s).rem_euclid(360.0);

    let (sin, cos) = (heading_rate * elapsed_s).to_radians().sin_cos();
    let (north, east) = (state.velocity_north_mps, state.velocity_east_mps);
    state.velocity_north_mps = north * cos - east * sin;
    state.velocity_east_mps = north * sin + east * cos;
    let position = pose.position();
    let travelled_m = elapsed_s
        * DVec3::new(
            state.velocity_north_mps,
            state.velocity_east_mps,
            state.velocity_down_mps,
        );
    *pose = pose.moved_to(Geodetic::from_ecef(
        position.to_ecef() + position.ecef_from_ned() * travelled_m,
    ));
    rates
}
