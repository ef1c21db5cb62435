//! Forces of the runway on the wheels.
//!
//! Input: height of the wheels, velocity, heading. Output: acceleration by struts, tyres and brakes, or none in the air. Struts are
//! a damped spring that carries the weight, lift dumped, with the centre of gravity at the height that the airframe's mesh has on
//! the ground; so a wheel touches while it is still the static travel above that height.

use glam::DVec3;

use super::aerodynamics::GRAVITY_MPS2;

/// Compression of the struts under the weight, metres.
pub(crate) const STATIC_TRAVEL_M: f64 = 0.15;
/// Damping ratio of the struts: the aircraft does not bounce.
const STRUT_DAMPING: f64 = 0.9;
/// Time constant of sideways tyre friction, seconds.
const SIDEWAYS_TIME_S: f64 = 0.6;
const ROLLING_FRICTION: f64 = 0.015;

/// Acceleration by the ground, north, east and down, metres per second squared. `wheel_height_m` is zero at rest.
pub(crate) fn push(
    wheel_height_m: f64,
    velocity_ned_mps: DVec3,
    heading_rad: f64,
    braking_mps2: f64,
) -> Option<DVec3> {
    let travel_m = STATIC_TRAVEL_M - wheel_height_m;
    if travel_m <= 0.0 {
        return None;
    }
    let stiffness_per_s2 = GRAVITY_MPS2 / STATIC_TRAVEL_M;
    let damping_per_s = 2.0 * STRUT_DAMPING * stiffness_per_s2.sqrt();
    // A strut pushes, it never pulls.
    let up_mps2 = (stiffness_per_s2 * travel_m + damping_per_s * velocity_ned_mps.z).max(0.0);
    // Tyre grip is proportional to the load.
    let grip = (up_mps2 / GRAVITY_MPS2).min(1.0);
    let forward = DVec3::new(heading_rad.cos(), heading_rad.sin(), 0.0);
    let right = DVec3::new(-heading_rad.sin(), heading_rad.cos(), 0.0);
    let rolling_mps2 = braking_mps2 + ROLLING_FRICTION * GRAVITY_MPS2;
    // Brakes stop the aircraft, they do not push it backwards.
    let speed_mps = velocity_ned_mps.dot(forward);
    let backwards = -forward * rolling_mps2 * (speed_mps / 1.0).clamp(-1.0, 1.0) * grip;
    let sideways = -right * velocity_ned_mps.dot(right) / SIDEWAYS_TIME_S * grip;
    Some(DVec3::NEG_Z * up_mps2 + backwards + sideways)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_rest_height_the_struts_carry_the_weight() {
        let push = push(0.0, DVec3::ZERO, 0.3, 0.0).unwrap();
        assert!(
            push.abs_diff_eq(DVec3::NEG_Z * GRAVITY_MPS2, 1e-12),
            "{push}"
        );
    }

    #[test]
    fn in_the_air_there_is_no_push() {
        assert_eq!(
            push(STATIC_TRAVEL_M + 0.001, DVec3::X * 70.0, 0.0, 2.0),
            None
        );
    }

    #[test]
    fn brakes_slow_and_tyres_resist_going_sideways() {
        let push = push(0.0, DVec3::new(60.0, 2.0, 0.0), 0.0, 1.5).unwrap();
        assert!(push.x < -1.5 && push.x > -2.0, "{push}");
        assert!(push.y < -1.0, "{push}");
    }
}
