//! Interpolation of flights between their states.
//!
//! Positions between two states follow a cubic Hermite curve through both positions with both velocities, in earth-centred metres, so that
//! path and speed are continuous and a 5 Hz recording is reproduced within millimetres. Angles are interpolated along the shorter way.

use glam::DVec3;

use crate::geometry::geodesy::Geodetic;
use crate::geometry::pose::{Controls, FlightState, Pose};
use crate::numbers::units::Degrees;

impl FlightState {
    /// Position of the centre of gravity, earth-centred and earth-fixed metres.
    pub fn position_ecef(&self) -> DVec3 {
        self.pose.position().to_ecef()
    }

    /// Velocity over ground, metres per second along the earth-centred axes.
    pub fn velocity_ecef(&self) -> DVec3 {
        let ned = DVec3::new(
            self.velocity_north_mps,
            self.velocity_east_mps,
            self.velocity_down_mps,
        );
        self.pose.position().ecef_from_ned() * ned
    }
}

/// A flight's state at a time in seconds. States are in order of time; before the first and after the last that state is held. `None` for a
/// flight without states.
pub fn state_at(states: &[FlightState], time_s: f64) -> Option<FlightState> {
    let after = states.partition_point(|state| state.time_s <= time_s);
    let before = after.checked_sub(1).and_then(|index| states.get(index));
    match (before, states.get(after)) {
        (Some(before), Some(after)) => Some(between(before, after, time_s)),
        (only, None) | (None, only) => only.copied(),
    }
}

fn between(before: &FlightState, after: &FlightState, time_s: f64) -> FlightState {
    let step_s = after.time_s - before.time_s;
    let u = (time_s - before.time_s) / step_s;
    let (p0, p1) = (before.position_ecef(), after.position_ecef());
    let (m0, m1) = (
        before.velocity_ecef() * step_s,
        after.velocity_ecef() * step_s,
    );
    let way = p1 - p0;
    // Relative to the first point: a cubic over coordinates of millions of metres would lose precision.
    let ecef = p0 + u * (m0 + u * (3.0 * way - 2.0 * m0 - m1 + u * (m0 + m1 - 2.0 * way)));
    let velocity =
        (m0 + u * (2.0 * (3.0 * way - 2.0 * m0 - m1) + 3.0 * u * (m0 + m1 - 2.0 * way))) / step_s;
    let position = Geodetic::from_ecef(ecef);
    let ned = position.ecef_from_ned().transpose() * velocity;
    let mix = |a: f64, b: f64| a + (b - a) * u;
    let turn = |a: f64, b: f64| a + Degrees(b - a).wrapped_180().0 * u;
    let (a, b) = (&before.pose, &after.pose);
    FlightState {
        time_s,
        pose: Pose {
            latitude_deg: position.latitude_deg,
            longitude_deg: position.longitude_deg,
            altitude_msl_m: position.altitude_msl_m,
            heading_true_deg: Degrees(turn(a.heading_true_deg, b.heading_true_deg))
                .wrapped_360()
                .0,
            pitch_deg: mix(a.pitch_deg, b.pitch_deg),
            roll_deg: Degrees(turn(a.roll_deg, b.roll_deg)).wrapped_180().0,
        },
        velocity_north_mps: ned.x,
        velocity_east_mps: ned.y,
        velocity_down_mps: ned.z,
        true_airspeed_mps: mix(before.true_airspeed_mps, after.true_airspeed_mps),
        controls: Controls {
            flap_ratio: mix(before.controls.flap_ratio, after.controls.flap_ratio),
            gear_ratio: mix(before.controls.gear_ratio, after.controls.gear_ratio),
        },
        on_ground: before.on_ground,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Due north over the equator, heading turning through north.
    fn state(time_s: f64, latitude_deg: f64, heading_true_deg: f64) -> FlightState {
        FlightState {
            time_s,
            pose: Pose {
                latitude_deg,
                longitude_deg: 104.0,
                altitude_msl_m: 500.0,
                heading_true_deg,
                pitch_deg: 0.0,
                roll_deg: 0.0,
            },
            velocity_north_mps: 55.3,
            velocity_east_mps: 0.0,
            velocity_down_mps: 0.0,
            true_airspeed_mps: 55.3,
            controls: Controls::default(),
            on_ground: false,
        }
    }

    #[test]
    fn a_state_between_two_lies_on_their_way_and_turns_the_shorter_way() {
        let flight = [state(1.0, 0.0, 358.0), state(2.0, 0.0005, 2.0)];
        let middle = state_at(&flight, 1.5).unwrap();
        assert!((middle.pose.latitude_deg - 0.000_25).abs() < 1e-8);
        assert!((middle.velocity_north_mps - 55.3).abs() < 0.1);
        let off_deg = Degrees(middle.pose.heading_true_deg).wrapped_180().0;
        assert!(off_deg.abs() < 1e-9, "{off_deg}");
        assert_eq!(middle.time_s, 1.5);
    }

    #[test]
    fn before_the_first_and_after_the_last_state_a_flight_stands_still() {
        let flight = [state(1.0, 0.0, 0.0), state(2.0, 0.0005, 0.0)];
        assert_eq!(state_at(&flight, 0.0), Some(flight[0]));
        assert_eq!(state_at(&flight, 2.0), Some(flight[1]));
        assert_eq!(state_at(&flight, 9.0), Some(flight[1]));
        assert_eq!(state_at(&flight[..1], 9.0), Some(flight[0]));
        assert_eq!(state_at(&[], 0.0), None);
    }
}
