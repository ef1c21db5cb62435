//! The autopilot: from the aircraft's situation to its controls.
//!
//! Input: the request, the situation, measured airspeed. Output: commands of bank, pitch, thrust, rudder, flaps, gear, brakes.
//! Three loops of any ILS autopilot: bank follows the localizer, pitch follows the climb rate of the vertical guidance, thrust
//! holds the speed. Measured speeds are filtered, as in an air data computer, or the loops would chase gusts.

use dataset::geometry::pose::Controls;
use xplane_bridge::fly::FlyRequest;

use super::aerodynamics::{self, GRAVITY_MPS2, MASS_KG};
use super::air::{SEA_LEVEL_DENSITY_KG_PER_M3, density_kg_per_m3};
use super::aircraft::{Aircraft, Commands, PITCH_FREQUENCY_RAD_PER_S};
use super::technique::Technique;
use super::time_step::AUTOPILOT_STEP_S;
use super::vertical_guidance::{Situation, VerticalGuidance};

/// Localizer: time constants for correcting the offset and the rate of offset, seconds.
const OFFSET_TIME_S: f64 = 10.0;
const OFFSET_RATE_TIME_S: f64 = 4.0;
/// Intercept angle of the localizer if the start does not converge with it, radians.
const INTERCEPT_RAD: f64 = 0.35;
/// A start that converges by at least this much keeps its angle until capture, radians.
const CONVERGING_RAD: f64 = 0.05;
const MAX_BANK_RAD: f64 = 0.436;
/// Bank near the ground: an engine pod must not touch.
const MAX_BANK_NEAR_GROUND_RAD: f64 = 0.12;
const NEAR_GROUND_M: f64 = 30.0;
const BANK_COMMAND_RATE_RAD_PER_S: f64 = 0.1;

/// Fastest change of the demanded climb rate, metres per second squared; more in the flare.
const CLIMB_CHANGE_MPS2: f64 = 0.6;
const FLARE_CHANGE_MPS2: f64 = 2.0;
/// Pitch for an error of the flight path angle, the same in the flare, and its integral, 1, 1 and 1/s.
const PITCH_GAIN: f64 = 0.3;
const FLARE_PITCH_GAIN: f64 = 1.2;
const PITCH_INTEGRAL_PER_S: f64 = 0.10;
const PITCH_LIMITS_RAD: (f64, f64) = (-0.07, 0.17);

/// Filters of measured airspeed: for the thrust, and for the pitch trim, seconds. Trim that followed every gust would use more information
/// than an autopilot has and hold the path better than the recorded ones.
const AIRSPEED_FILTER_S: f64 = 3.0;
const TRIM_FILTER_S: f64 = 8.0;
/// Acceleration per error of speed, 1/s, its integral, 1/s^2, and its limits, metres per second squared.
const SPEED_GAIN_PER_S: f64 = 0.16;
const SPEED_INTEGRAL_PER_S2: f64 = 0.008;
const ACCELERATION_LIMITS_MPS2: (f64, f64) = (-0.9, 0.9);
const THRUST_LIMITS_N: (f64, f64) = (4_000.0, 200_000.0);
/// Wheel height below which the thrust levers come back, metres.
const THRUST_BACK_BELOW_M: f64 = 8.0;
/// Wheel heights between which the nose is brought from crab towards the runway, metres, and how far.
const ALIGN_HEIGHTS_M: (f64, f64) = (9.0, 2.0);
const ALIGN_RATIO: f64 = 0.8;

/// Pitch on three wheels, radians, and how fast the nose comes down to it, radians per second.
const GROUND_PITCH_RAD: f64 = 0.006;
const NOSE_DOWN_RAD_PER_S: f64 = 0.03;
/// Steering: heading per metre off the centreline, radians, with a limit.
const STEERING_RAD_PER_M: f64 = 0.006;
const MAX_STEERING_RAD: f64 = 0.05;

#[derive(Debug)]
pub(crate) struct Autopilot {
    wing_area_m2: f64,
    technique: Technique,
    vertical: VerticalGuidance,
    past_threshold_m: f64,
    course_rad: f64,
    closing_limit: Option<f64>,
    climb_demand_mps: Option<f64>,
    pitch_integral_rad: f64,
    speed_integral_mps2: f64,
    airspeed_mps: Option<f64>,
    trim_airspeed_mps: Option<f64>,
    wanted_airspeed_mps: Option<f64>,
    bank_command_rad: f64,
    pitch_command_rad: f64,
}

impl Autopilot {
    pub(crate) fn new(request: &FlyRequest, technique: Technique, wing_area_m2: f64) -> Self {
        Self {
            wing_area_m2,
            technique,
            vertical: VerticalGuidance::new(
                request.profile,
                &request.runway,
                technique.flare_height_m,
                technique.touchdown_sink_mps,
            ),
            past_threshold_m: request.runway.touchdown_past_threshold_m,
            course_rad: request.runway.course_true_deg.to_radians(),
            closing_limit: None,
            climb_demand_mps: None,
            pitch_integral_rad: 0.0,
            speed_integral_mps2: 0.0,
            airspeed_mps: None,
            trim_airspeed_mps: None,
            wanted_airspeed_mps: None,
            bank_command_rad: 0.0,
            pitch_command_rad: 0.0,
        }
    }

    /// Initial climb rate of the flight, metres per second: it is already on its plan.
    pub(crate) fn first_climb_mps(&mut self, now: &Situation) -> f64 {
        self.vertical.climb_mps(now)
    }

    /// Current commands. `airspeed_mps` is the true airspeed as a probe measures it, `landed` whether the wheels have touched.
    pub(crate) fn commands(
        &mut self,
        now: &Situation,
        aircraft: &Aircraft,
        airspeed_mps: f64,
        landed: bool,
    ) -> Commands {
        let trim_airspeed_mps = filtered(
            &mut self.trim_airspeed_mps,
            airspeed_mps,
            AUTOPILOT_STEP_S / TRIM_FILTER_S,
        );
        let airspeed_mps = filtered(
            &mut self.airspeed_mps,
            airspeed_mps,
            AUTOPILOT_STEP_S / AIRSPEED_FILTER_S,
        );
        let density = density_kg_per_m3(aircraft.position.altitude_msl_m);
        let equivalent = (density / SEA_LEVEL_DENSITY_KG_PER_M3).sqrt();
        let before_threshold_m = now.to_target_m - self.past_threshold_m;
        let controls = self.technique.controls(
            before_threshold_m,
            airspeed_mps * equivalent,
            aircraft.controls,
        );
        if landed {
            return self.roll_out(now, aircraft, controls);
        }
        let bank_rad = self.bank_rad(now);
        let pitch_rad = self.pitch_rad(now, aircraft.controls, trim_airspeed_mps, density);
        let wanted_mps = self.technique.speed_mps(before_threshold_m) / equivalent;
        let thrust_n = self.thrust_n(now, aircraft.controls, airspeed_mps, wanted_mps, density);
        let align_part =
            (ALIGN_HEIGHTS_M.0 - now.wheel_height_m) / (ALIGN_HEIGHTS_M.0 - ALIGN_HEIGHTS_M.1);
        Commands {
            bank_rad,
            pitch_rad,
            thrust_n,
            align_heading_rad: self.course_rad,
            align_ratio: ALIGN_RATIO * align_part.clamp(0.0, 1.0),
            controls,
            braking_mps2: 0.0,
        }
    }

    fn bank_rad(&mut self, now: &Situation) -> f64 {
        let limit = *self.closing_limit.get_or_insert_with(|| {
            let closing_rad =
                (-now.right_of_course_m.signum() * now.right_rate_mps).atan2(now.ground_speed_mps);
            let intercept_rad = if closing_rad > CONVERGING_RAD {
                closing_rad
            } else {
                INTERCEPT_RAD
            };
            intercept_rad.min(INTERCEPT_RAD).sin()
        });
        let largest_mps = limit * now.ground_speed_mps;
        let wanted_rate = (-now.right_of_course_m / OFFSET_TIME_S).clamp(-largest_mps, largest_mps);
        let wanted_mps2 = (wanted_rate - now.right_rate_mps) / OFFSET_RATE_TIME_S;
        let largest = if now.wheel_height_m < NEAR_GROUND_M {
            MAX_BANK_NEAR_GROUND_RAD
        } else {
            MAX_BANK_RAD
        };
        let wanted_rad = (wanted_mps2 / GRAVITY_MPS2).atan().clamp(-largest, largest);
        self.bank_command_rad = towards(
            self.bank_command_rad,
            wanted_rad,
            BANK_COMMAND_RATE_RAD_PER_S * AUTOPILOT_STEP_S,
        );
        self.bank_command_rad
    }

    fn pitch_rad(
        &mut self,
        now: &Situation,
        controls: Controls,
        airspeed_mps: f64,
        density: f64,
    ) -> f64 {
        let wanted = self.vertical.climb_mps(now);
        let change = if self.vertical.is_flaring() {
            FLARE_CHANGE_MPS2
        } else {
            CLIMB_CHANGE_MPS2
        };
        let before = *self.climb_demand_mps.get_or_insert(wanted);
        let demand = towards(before, wanted, change * AUTOPILOT_STEP_S);
        self.climb_demand_mps = Some(demand);
        let demand_mps2 = (demand - before) / AUTOPILOT_STEP_S;

        let error_rad = (demand - now.climb_mps) / airspeed_mps;
        self.pitch_integral_rad = (self.pitch_integral_rad
            + PITCH_INTEGRAL_PER_S * error_rad * AUTOPILOT_STEP_S)
            .clamp(-0.05, 0.05);
        let trim_rad = aerodynamics::level_trim(self.wing_area_m2, airspeed_mps, density, controls)
            .angle_of_attack_rad;
        // The flare is a known manoeuvre and is led by its lag. On the path there is no lead: it would hold the path better than
        // the recorded autopilot, whose path mode is lightly damped.
        let (lead_s, gain) = if self.vertical.is_flaring() {
            (
                aerodynamics::path_lag_s(self.wing_area_m2, airspeed_mps, density)
                    + 1.0 / PITCH_FREQUENCY_RAD_PER_S,
                FLARE_PITCH_GAIN,
            )
        } else {
            (0.0, PITCH_GAIN)
        };
        let pitch_rad = trim_rad
            + (demand + lead_s * demand_mps2) / airspeed_mps
            + gain * error_rad
            + self.pitch_integral_rad;
        self.pitch_command_rad = pitch_rad.clamp(PITCH_LIMITS_RAD.0, PITCH_LIMITS_RAD.1);
        self.pitch_command_rad
    }

    fn thrust_n(
        &mut self,
        now: &Situation,
        controls: Controls,
        airspeed_mps: f64,
        wanted_mps: f64,
        density: f64,
    ) -> f64 {
        if self.vertical.is_flaring() && now.wheel_height_m < THRUST_BACK_BELOW_M {
            return THRUST_LIMITS_N.0;
        }
        let error_mps = wanted_mps - airspeed_mps;
        // The schedule decelerates as a function of distance: follow its slope, or the speed would lag by many seconds.
        let before_mps = self
            .wanted_airspeed_mps
            .replace(wanted_mps)
            .unwrap_or(wanted_mps);
        let scheduled_mps2 = (wanted_mps - before_mps) / AUTOPILOT_STEP_S;
        let acceleration =
            (scheduled_mps2 + SPEED_GAIN_PER_S * error_mps + self.speed_integral_mps2)
                .clamp(ACCELERATION_LIMITS_MPS2.0, ACCELERATION_LIMITS_MPS2.1);
        let level_n =
            aerodynamics::level_trim(self.wing_area_m2, airspeed_mps, density, controls).drag_n;
        let slope_n = MASS_KG * GRAVITY_MPS2 * now.climb_mps / airspeed_mps;
        let thrust_n = level_n + slope_n + MASS_KG * acceleration;
        // The integral pauses while the levers are at a stop, or it would overshoot when they leave it.
        if (THRUST_LIMITS_N.0..THRUST_LIMITS_N.1).contains(&thrust_n) {
            self.speed_integral_mps2 = (self.speed_integral_mps2
                + SPEED_INTEGRAL_PER_S2 * error_mps * AUTOPILOT_STEP_S)
                .clamp(-0.3, 0.3);
        }
        thrust_n.clamp(THRUST_LIMITS_N.0, THRUST_LIMITS_N.1)
    }

    fn roll_out(&mut self, now: &Situation, aircraft: &Aircraft, controls: Controls) -> Commands {
        self.pitch_command_rad = towards(
            self.pitch_command_rad,
            GROUND_PITCH_RAD,
            NOSE_DOWN_RAD_PER_S * AUTOPILOT_STEP_S,
        );
        let steering_rad = (-STEERING_RAD_PER_M
            * (now.right_of_course_m + 2.0 * now.right_rate_mps))
            .clamp(-MAX_STEERING_RAD, MAX_STEERING_RAD);
        let nose_is_down = aircraft.pitch_rad < 0.035;
        Commands {
            bank_rad: 0.0,
            pitch_rad: self.pitch_command_rad,
            thrust_n: THRUST_LIMITS_N.0,
            align_heading_rad: self.course_rad + steering_rad,
            align_ratio: 0.95,
            controls,
            braking_mps2: if nose_is_down {
                self.technique.braking_mps2
            } else {
                0.3
            },
        }
    }
}

/// Advances a first-order filter by `part` time constants.
fn filtered(value: &mut Option<f64>, measured: f64, part: f64) -> f64 {
    let before = value.unwrap_or(measured);
    *value.insert(before + (measured - before) * part)
}

fn towards(now: f64, wanted: f64, largest_change: f64) -> f64 {
    now + (wanted - now).clamp(-largest_change, largest_change)
}
