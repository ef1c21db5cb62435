//! Lift, drag and side force: a 737-800 in approach configurations. Other types have its polar and its mass, on a wing of the area with
//! which they fly at their own approach speed as the 737 at its own: wing loadings go with the square of the speed.
//!
//! Input: motion through the air in body axes, density, flaps, gear, spoilers. Output: force in body axes, and the trim for level
//! flight. The lift line goes through the pitch angles of the recorded flights (96 m/s with flaps 0.25: 5.2 degrees level; 71.6 m/s
//! with flaps 0.75: 3.4 degrees on the glide path); drag is a parabola with typical transport figures.

use dataset::geometry::pose::Controls;
use glam::DVec3;

/// Standard gravity, metres per second squared.
pub(crate) const GRAVITY_MPS2: f64 = 9.806_65;
/// Landing mass, kilograms.
pub(crate) const MASS_KG: f64 = 55_000.0;
/// Wing area of the 737, square metres.
pub(crate) const WING_AREA_M2: f64 = 124.6;
const LIFT_AT_ZERO_ANGLE: f64 = 0.136;
const LIFT_PER_FLAP_RATIO: f64 = 0.932;
const LIFT_PER_RAD: f64 = 5.0;
/// Maximum lift: the wing stalls.
const MAX_LIFT: f64 = 2.6;
const DRAG_CLEAN: f64 = 0.020;
const DRAG_PER_LIFT_SQUARED: f64 = 0.045;
const DRAG_PER_FLAP_RATIO_SQUARED: f64 = 0.060;
const DRAG_GEAR: f64 = 0.045;
const DRAG_SPOILERS: f64 = 0.080;
/// Share of the lift lost to raised spoilers.
const LIFT_LOST_TO_SPOILERS: f64 = 0.75;
const SIDE_FORCE_PER_RAD: f64 = -0.9;

/// Trim for level flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Trim {
    pub(crate) angle_of_attack_rad: f64,
    /// Drag, newtons: the thrust of level flight.
    pub(crate) drag_n: f64,
}

pub(crate) fn level_trim(
    wing_area_m2: f64,
    airspeed_mps: f64,
    density_kg_per_m3: f64,
    controls: Controls,
) -> Trim {
    let pressure_n = dynamic_force_n(wing_area_m2, airspeed_mps, density_kg_per_m3);
    let lift = MASS_KG * GRAVITY_MPS2 / pressure_n;
    Trim {
        angle_of_attack_rad: (lift - lift_at_zero_angle(controls)) / LIFT_PER_RAD,
        drag_n: pressure_n * drag_coefficient(lift, controls, 0.0),
    }
}

/// Time constant with which the flight path follows the pitch, seconds.
pub(crate) fn path_lag_s(wing_area_m2: f64, airspeed_mps: f64, density_kg_per_m3: f64) -> f64 {
    let pressure_n = dynamic_force_n(wing_area_m2, airspeed_mps, density_kg_per_m3);
    MASS_KG * airspeed_mps / (pressure_n * LIFT_PER_RAD)
}

/// Aerodynamic force in body axes, newtons, for a motion through the air in body axes.
pub(crate) fn force_body_n(
    wing_area_m2: f64,
    through_air_mps: DVec3,
    density_kg_per_m3: f64,
    controls: Controls,
    spoiler_ratio: f64,
) -> DVec3 {
    let airspeed = through_air_mps.length().max(1.0);
    let angle_of_attack = through_air_mps.z.atan2(through_air_mps.x.max(1.0));
    let sideslip = (through_air_mps.y / airspeed).clamp(-1.0, 1.0).asin();
    let pressure_n = dynamic_force_n(wing_area_m2, airspeed, density_kg_per_m3);
    let attached =
        (lift_at_zero_angle(controls) + LIFT_PER_RAD * angle_of_attack).clamp(-MAX_LIFT, MAX_LIFT);
    let lift = attached * (1.0 - LIFT_LOST_TO_SPOILERS * spoiler_ratio);
    let drag = drag_coefficient(lift, controls, spoiler_ratio);
    let (sin, cos) = angle_of_attack.sin_cos();
    pressure_n
        * DVec3::new(
            lift * sin - drag * cos,
            SIDE_FORCE_PER_RAD * sideslip,
            -lift * cos - drag * sin,
        )
}

fn dynamic_force_n(wing_area_m2: f64, airspeed_mps: f64, density_kg_per_m3: f64) -> f64 {
    0.5 * density_kg_per_m3 * airspeed_mps * airspeed_mps * wing_area_m2
}

fn lift_at_zero_angle(controls: Controls) -> f64 {
    LIFT_AT_ZERO_ANGLE + LIFT_PER_FLAP_RATIO * controls.flap_ratio
}

fn drag_coefficient(lift: f64, controls: Controls, spoiler_ratio: f64) -> f64 {
    DRAG_CLEAN
        + DRAG_PER_LIFT_SQUARED * lift * lift
        + DRAG_PER_FLAP_RATIO_SQUARED * controls.flap_ratio * controls.flap_ratio
        + DRAG_GEAR * controls.gear_ratio
        + DRAG_SPOILERS * spoiler_ratio
}

#[cfg(test)]
mod tests {
    use super::*;

    const LANDING: Controls = Controls {
        flap_ratio: 0.75,
        gear_ratio: 1.0,
    };

    #[test]
    fn trim_meets_the_pitch_of_the_recorded_flights() {
        let clean = Controls {
            flap_ratio: 0.25,
            gear_ratio: 0.0,
        };
        let level = level_trim(WING_AREA_M2, 96.0, 1.138, clean)
            .angle_of_attack_rad
            .to_degrees();
        assert!((level - 5.23).abs() < 0.3, "level {level}");
        let glide = level_trim(WING_AREA_M2, 71.6, 1.213, LANDING)
            .angle_of_attack_rad
            .to_degrees()
            - 3.0;
        assert!((glide - 3.4).abs() < 0.3, "glide path {glide}");
    }

    #[test]
    fn at_trim_lift_carries_the_weight_and_drag_is_as_told() {
        let trim = level_trim(WING_AREA_M2, 72.0, 1.2, LANDING);
        let (sin, cos) = trim.angle_of_attack_rad.sin_cos();
        let force = force_body_n(
            WING_AREA_M2,
            DVec3::new(72.0 * cos, 0.0, 72.0 * sin),
            1.2,
            LANDING,
            0.0,
        );
        let up_n = -(force.z * cos - force.x * sin);
        let back_n = -(force.x * cos + force.z * sin);
        assert!((up_n / (MASS_KG * GRAVITY_MPS2) - 1.0).abs() < 1e-9);
        assert!((back_n / trim.drag_n - 1.0).abs() < 1e-9);
    }

    #[test]
    fn spoilers_put_the_weight_on_the_wheels() {
        let motion = DVec3::new(70.0, 0.0, 5.0);
        let flying = force_body_n(WING_AREA_M2, motion, 1.2, LANDING, 0.0);
        let dumped = force_body_n(WING_AREA_M2, motion, 1.2, LANDING, 1.0);
        assert!(dumped.z.abs() < 0.4 * flying.z.abs());
        assert!(dumped.x < flying.x, "spoilers brake");
    }
}
