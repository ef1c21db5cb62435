//! Pitch and roll that a path needs, for an airliner whose type is not known.
//!
//! Turns are coordinated, which gives the roll. The pitch is the angle of the path and the angle of attack, which follows from the lift:
//! the coefficient falls with the square of the speed from its value on final approach, at 1.3 times the stall speed with the flaps
//! extended.

use dataset::numbers::spread::median;
use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;

use super::arrival::Seen;

const GRAVITY_MPS2: f64 = 9.81;
/// Distances between which an aircraft flies at its final speed, metres.
const FINAL_M: (f64, f64) = (METERS_PER_NAUTICAL_MILE, 3.0 * METERS_PER_NAUTICAL_MILE);
/// Final speeds of airliners, m/s, and the one of a track without speeds there.
const FINAL_SPEEDS_MPS: (f64, f64) = (55.0, 90.0);
const USUAL_FINAL_MPS: f64 = 70.0;
/// Lift coefficient on final approach: 2.7 at the stall, over 1.3 squared.
const FINAL_LIFT: f64 = 1.6;
/// Lift coefficient a degree, and the angle without lift: clean, and by how much flaps lower it.
const LIFT_PER_DEG: f64 = 0.09;
const NO_LIFT_DEG: f64 = -3.0;
const FLAPS_LOWER_DEG: f64 = 9.6;
/// Angles of attack, degrees.
const ATTACK_DEG: (f64, f64) = (-2.0, 10.0);

/// Roll of a coordinated turn, right wing down positive.
pub(super) fn roll_deg(speed_mps: f64, turn_deg_per_s: f64) -> f64 {
    let aside_mps2 = speed_mps * turn_deg_per_s.to_radians();
    (aside_mps2 / GRAVITY_MPS2).atan().to_degrees()
}

/// Ground speed on final approach.
pub(super) fn final_speed_mps(arrival: &[Seen]) -> f64 {
    let is_final = |at: &&Seen| (FINAL_M.0..=FINAL_M.1).contains(&at.to_go_m);
    let speeds = arrival.iter().filter(is_final);
    let mut speeds: Vec<f64> = speeds
        .filter_map(|at| at.fix.ground_speed_mps)
        .filter(|speed_mps| speed_mps.is_finite())
        .collect();
    if speeds.is_empty() {
        return USUAL_FINAL_MPS;
    }
    median(&mut speeds).clamp(FINAL_SPEEDS_MPS.0, FINAL_SPEEDS_MPS.1)
}

/// Pitch on a path that climbs at an angle.
pub(super) fn pitch_deg(climb_deg: f64, speed_mps: f64, final_mps: f64, roll_deg: f64) -> f64 {
    let slower = final_mps / speed_mps.max(30.0);
    let lift = FINAL_LIFT * slower * slower / roll_deg.to_radians().cos();
    let attack_deg = lift / LIFT_PER_DEG + NO_LIFT_DEG - FLAPS_LOWER_DEG * flaps(speed_mps);
    climb_deg + attack_deg.clamp(ATTACK_DEG.0, ATTACK_DEG.1)
}

/// Flaps by the speed: extended while it falls.
pub(super) fn flaps(speed_mps: f64) -> f64 {
    ((105.0 - speed_mps) / 33.0).clamp(0.0, 1.0)
}

/// Gear by the distance to go: down at five miles.
pub(super) fn gear(to_go_m: f64) -> f64 {
    ((9_500.0 - to_go_m) / 700.0).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_at_three_degrees_a_second_banks_by_21_degrees_at_72_metres_per_second() {
        assert!((roll_deg(72.0, 3.0) - 21.0).abs() < 0.1);
        assert_eq!(roll_deg(72.0, 0.0), 0.0);
    }

    #[test]
    fn the_nose_is_high_in_level_flight_and_nearly_level_on_the_glide_path() {
        let on_glide_path_deg = pitch_deg(-3.0, 70.0, 70.0, 0.0);
        assert!(
            (1.0..4.0).contains(&on_glide_path_deg),
            "{on_glide_path_deg}"
        );
        let level_deg = pitch_deg(0.0, 95.0, 70.0, 0.0);
        assert!((3.0..7.0).contains(&level_deg), "{level_deg}");
        assert!(pitch_deg(0.0, 95.0, 70.0, 25.0) > level_deg);
    }
}
