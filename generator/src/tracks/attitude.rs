//! Pitch and roll that a path needs, for an airliner whose type is not known.
//!
//! Turns are coordinated, which gives the roll. The pitch is the angle of the path and the angle of attack, which follows from the lift:
//! the coefficient falls with the dynamic pressure from its value on final approach, at 1.3 times the stall speed with the flaps extended.

use dataset::numbers::spread::median;
use dataset::numbers::units::{Degrees, METERS_PER_NAUTICAL_MILE};

use super::arrival::ArrivalFix;
use super::formats::{Attitude, Fix};
use super::smoother::Smoothed;
use crate::recording::GRAVITY_MPS2;

/// Distances between which an aircraft flies at its final speed, metres.
const FINAL_M: (f64, f64) = (METERS_PER_NAUTICAL_MILE, 3.0 * METERS_PER_NAUTICAL_MILE);
/// Final speeds of airliners, m/s, and the default for tracks without speeds there.
const FINAL_SPEEDS_MPS: (f64, f64) = (55.0, 90.0);
const USUAL_FINAL_MPS: f64 = 70.0;
/// Lift coefficient on final approach: 2.7 at the stall, over 1.3 squared.
const FINAL_LIFT: f64 = 1.6;
/// Lift coefficient per degree, angle without lift, and its change by full flaps.
const LIFT_PER_DEG: f64 = 0.09;
const NO_LIFT_DEG: f64 = -3.0;
const FLAPS_LOWER_DEG: f64 = 9.6;
/// No aircraft flies slower, in ratio to its final speed.
const SLOWEST: f64 = 0.5;
/// Measured attitudes are interpolated over at most this time, seconds.
const MAX_INTERPOLATION_S: f64 = 4.0;
const ATTACK_DEG: (f64, f64) = (-2.0, 10.0);

/// Roll in coordinated turns, right wing down positive.
pub(super) fn roll_deg(speed_mps: f64, turn_deg_per_s: f64) -> f64 {
    let aside_mps2 = speed_mps * turn_deg_per_s.to_radians();
    (aside_mps2 / GRAVITY_MPS2).atan().to_degrees()
}

/// The fixes around a time, if they are near enough to interpolate between them, and the part of the way.
fn around(seen: &[ArrivalFix], time_s: f64) -> Option<([&Fix; 2], f64)> {
    let next = seen.partition_point(|at| at.fix.time_s < time_s).max(1);
    let (before, after) = (&seen[next - 1].fix, &seen.get(next)?.fix);
    let step_s = after.time_s - before.time_s;
    let part = (time_s - before.time_s) / step_s;
    (step_s <= MAX_INTERPOLATION_S).then_some(([before, after], part))
}

fn between([from, to]: [f64; 2], part: f64) -> f64 {
    from + part * Degrees(to - from).wrapped_180().0
}

/// The measured attitude at a time, interpolated between the fixes around it.
pub(super) fn measured_attitude(seen: &[ArrivalFix], time_s: f64) -> Option<Attitude> {
    let ([before, after], part) = around(seen, time_s)?;
    let (from, to) = before.attitude.zip(after.attitude)?;
    Some(Attitude {
        pitch_deg: between([from.pitch_deg, to.pitch_deg], part),
        roll_deg: between([from.roll_deg, to.roll_deg], part),
        heading_true_deg: from
            .heading_true_deg
            .zip(to.heading_true_deg)
            .map(|(from, to)| between([from, to], part)),
    })
}

/// A roll that was reported without the rest of the attitude, likewise.
pub(super) fn measured_roll_deg(seen: &[ArrivalFix], time_s: f64) -> Option<f64> {
    let ([before, after], part) = around(seen, time_s)?;
    let (from, to) = before.roll_deg.zip(after.roll_deg)?;
    Some(between([from, to], part))
}

/// Ground speed on final approach: as reported, else by the smoothed distances to go.
pub(super) fn final_speed_mps(arrival: &[ArrivalFix], to_go: &[Smoothed]) -> f64 {
    let is_final = |at: &&ArrivalFix| (FINAL_M.0..=FINAL_M.1).contains(&at.to_go_m);
    let speeds = arrival.iter().filter(is_final);
    let mut speeds: Vec<f64> = speeds
        .filter_map(|at| at.fix.ground_speed_mps)
        .filter(|speed_mps| speed_mps.is_finite())
        .collect();
    if speeds.is_empty() {
        let is_final = |at: &&Smoothed| (FINAL_M.0..=FINAL_M.1).contains(&at.place_m);
        speeds.extend(to_go.iter().filter(is_final).map(|at| -at.speed_mps));
    }
    if speeds.is_empty() {
        return USUAL_FINAL_MPS;
    }
    median(&mut speeds).clamp(FINAL_SPEEDS_MPS.0, FINAL_SPEEDS_MPS.1)
}

/// Density of the standard atmosphere at an altitude, in ratio to the one at sea level.
pub(super) fn density(altitude_msl_m: f64) -> f64 {
    (1.0 - 2.255_77e-5 * altitude_msl_m).powf(4.2559)
}

/// Pitch on a path that climbs at an angle, at an airspeed in ratio to the final one.
pub(super) fn pitch_deg(climb_deg: f64, faster: f64, flaps: f64, roll_deg: f64) -> f64 {
    let lift = FINAL_LIFT / faster.max(SLOWEST).powi(2) / roll_deg.to_radians().cos();
    let attack_deg = lift / LIFT_PER_DEG + NO_LIFT_DEG - FLAPS_LOWER_DEG * flaps;
    climb_deg + attack_deg.clamp(ATTACK_DEG.0, ATTACK_DEG.1)
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
        let on_glide_path_deg = pitch_deg(-3.0, 1.0, 1.0, 0.0);
        assert!(
            (1.0..4.0).contains(&on_glide_path_deg),
            "{on_glide_path_deg}"
        );
        let level_deg = pitch_deg(0.0, 1.35, 0.0, 0.0);
        assert!((3.0..8.0).contains(&level_deg), "{level_deg}");
        assert!(pitch_deg(0.0, 1.35, 0.0, 25.0) > level_deg);
    }

    #[test]
    fn air_is_thinner_by_a_quarter_at_10_000_ft() {
        assert!((density(3_048.0) - 0.7385).abs() < 1e-3);
        assert_eq!(density(0.0), 1.0);
    }
}
