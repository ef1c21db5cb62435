//! The flying aircraft: a point mass with attitude.
//!
//! Input: the autopilot's commands and the motion of the air. Output: position, velocity and attitude a time step later, over the WGS-84
//! ellipsoid. Lift, drag and side force act on the mass; the attitude follows the commands with a transport aircraft's lags and limits and
//! turns into gusts like a weathercock. This determines the distant view: path, speed, crab, pitch. Other 737 dynamics (moments of elevator
//! and aileron, engine spool curves) are not modelled.

use dataset::geometry::geodesy::{Geodetic, WGS84_FLATTENING, WGS84_SEMI_MAJOR_M};
use dataset::geometry::pose::{Controls, Pose};
use glam::{DMat3, DVec3};

use super::aerodynamics::{self, GRAVITY_MPS2, MASS_KG};
use super::air::{AirMotion, density_kg_per_m3};
use super::form::Form;
use super::landing_gear;
use super::time_step::STEP_S;

/// Pitch under attitude control: natural frequency, radians per second, and damping ratio.
pub(crate) const PITCH_FREQUENCY_RAD_PER_S: f64 = 1.0;
const PITCH_DAMPING: f64 = 0.6;
/// Weathercock stiffness in pitch: nose-down acceleration for each radian of gust angle, 1/s^2.
const PITCH_WEATHERCOCK_PER_S2: f64 = 1.2;
/// Weathercock stiffness in yaw and damping with yaw damper, 1/s^2 and 1/s.
const YAW_WEATHERCOCK_PER_S2: f64 = 1.8;
const YAW_DAMPING_PER_S: f64 = 1.4;
/// Rudder against the weathercock when the crew aligns with the runway, 1/s^2.
const RUDDER_STIFFNESS_PER_S2: f64 = 1.5;
/// Bank: demanded rate per radian of error, its limit, and the lag of the rate.
const BANK_GAIN_PER_S: f64 = 0.8;
const MAX_BANK_RATE_RAD_PER_S: f64 = 0.12;
const BANK_RATE_LAG_S: f64 = 0.5;
/// Swept wings roll away from a sideslip: roll rate for each radian, 1/s.
const ROLL_PER_SIDESLIP_PER_S: f64 = 1.4;
const THRUST_LAG_S: f64 = 1.5;
/// Travel of flaps and gear, part of full travel per second.
const FLAP_RATE_PER_S: f64 = 0.04;
const GEAR_RATE_PER_S: f64 = 0.08;
/// Spoilers rise in this time after touchdown, seconds.
const SPOILER_TIME_S: f64 = 1.5;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Commands {
    /// Bank, radians, right wing down positive.
    pub(crate) bank_rad: f64,
    /// Pitch, radians, nose up positive.
    pub(crate) pitch_rad: f64,
    /// Thrust of both engines, newtons.
    pub(crate) thrust_n: f64,
    /// Heading that the rudder should hold, radians true, and how hard, 0 (feet off: the nose turns into the wind) to 1.
    pub(crate) align_heading_rad: f64,
    pub(crate) align_ratio: f64,
    /// Flaps and gear.
    pub(crate) controls: Controls,
    /// Deceleration by wheel brakes and reversers on the ground, metres per second squared.
    pub(crate) braking_mps2: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Aircraft {
    pub(crate) form: Form,
    pub(crate) position: Geodetic,
    pub(crate) velocity_ned_mps: DVec3,
    pub(crate) heading_rad: f64,
    pub(crate) pitch_rad: f64,
    pub(crate) bank_rad: f64,
    pub(crate) heading_rate_rad_per_s: f64,
    pub(crate) pitch_rate_rad_per_s: f64,
    pub(crate) bank_rate_rad_per_s: f64,
    pub(crate) thrust_n: f64,
    pub(crate) controls: Controls,
    pub(crate) spoiler_ratio: f64,
    /// True if a wheel touches the ground.
    pub(crate) on_ground: bool,
}

impl Aircraft {
    /// Position and attitude in degrees.
    pub(crate) fn pose(&self) -> Pose {
        Pose {
            latitude_deg: self.position.latitude_deg,
            longitude_deg: self.position.longitude_deg,
            altitude_msl_m: self.position.altitude_msl_m,
            heading_true_deg: self.heading_rad.to_degrees().rem_euclid(360.0),
            pitch_deg: self.pitch_rad.to_degrees(),
            roll_deg: self.bank_rad.to_degrees(),
        }
    }

    /// Speed through the air, metres per second.
    pub(crate) fn airspeed_mps(&self, air_velocity_ned_mps: DVec3) -> f64 {
        (self.velocity_ned_mps - air_velocity_ned_mps).length()
    }

    /// Advances by one step. The ground is level at `ground_msl_m`.
    pub(crate) fn step(&mut self, commands: &Commands, air: &AirMotion, ground_msl_m: f64) {
        self.move_controls(commands);
        let ned_from_body = DMat3::from_rotation_z(self.heading_rad)
            * DMat3::from_rotation_y(self.pitch_rad)
            * DMat3::from_rotation_x(self.bank_rad);
        let through_air =
            ned_from_body.transpose() * (self.velocity_ned_mps - air.velocity_ned_mps);

        let aerodynamic = aerodynamics::force_body_n(
            self.form.wing_area_m2,
            through_air,
            density_kg_per_m3(self.position.altitude_msl_m),
            self.controls,
            self.spoiler_ratio,
        );
        let flying = ned_from_body * (aerodynamic + DVec3::X * self.thrust_n) / MASS_KG
            + DVec3::Z * GRAVITY_MPS2;
        let wheel_height_m =
            self.position.altitude_msl_m - ground_msl_m - self.form.wheel_height_below_cg_m;
        let contact = landing_gear::push(
            wheel_height_m,
            self.velocity_ned_mps,
            self.heading_rad,
            commands.braking_mps2,
        );
        self.on_ground = contact.is_some();
        let acceleration = flying + contact.unwrap_or(DVec3::ZERO) - self.transport_acceleration();

        self.turn(commands, air, through_air);
        // Semi-implicit Euler: the stiff landing gear stays stable at 120 Hz.
        self.velocity_ned_mps += acceleration * STEP_S;
        self.move_over_ellipsoid();
    }

    fn move_controls(&mut self, commands: &Commands) {
        let towards = |now: f64, wanted: f64, rate_per_s: f64| {
            now + (wanted - now).clamp(-rate_per_s * STEP_S, rate_per_s * STEP_S)
        };
        let controls = &mut self.controls;
        controls.flap_ratio = towards(
            controls.flap_ratio,
            commands.controls.flap_ratio,
            FLAP_RATE_PER_S,
        );
        controls.gear_ratio = towards(
            controls.gear_ratio,
            commands.controls.gear_ratio,
            GEAR_RATE_PER_S,
        );
        // Armed spoilers rise with the first wheel on the ground, and stay after a bounce.
        if self.on_ground || self.spoiler_ratio > 0.0 {
            self.spoiler_ratio = towards(self.spoiler_ratio, 1.0, 1.0 / SPOILER_TIME_S);
        }
        self.thrust_n += (commands.thrust_n - self.thrust_n) * STEP_S / THRUST_LAG_S;
    }

    fn turn(&mut self, commands: &Commands, air: &AirMotion, through_air: DVec3) {
        let airspeed = through_air.length().max(20.0);
        let sideslip = (through_air.y / airspeed).clamp(-1.0, 1.0).asin();

        let gust_angle = -air.turbulence_ned_mps.z / airspeed;
        let pitch_acceleration = PITCH_FREQUENCY_RAD_PER_S.powi(2)
            * (commands.pitch_rad - self.pitch_rad)
            - 2.0 * PITCH_DAMPING * PITCH_FREQUENCY_RAD_PER_S * self.pitch_rate_rad_per_s
            - PITCH_WEATHERCOCK_PER_S2 * gust_angle;
        self.pitch_rate_rad_per_s += pitch_acceleration * STEP_S;
        self.pitch_rad += self.pitch_rate_rad_per_s * STEP_S;

        let wanted_rate = (BANK_GAIN_PER_S * (commands.bank_rad - self.bank_rad))
            .clamp(-MAX_BANK_RATE_RAD_PER_S, MAX_BANK_RATE_RAD_PER_S);
        // The wing follows the rotating air before the ailerons answer. In a deliberate sideslip the crew holds it with aileron.
        let disturbed_rate = wanted_rate + air.roll_rad_per_s
            - (1.0 - commands.align_ratio) * ROLL_PER_SIDESLIP_PER_S * sideslip;
        self.bank_rate_rad_per_s +=
            (disturbed_rate - self.bank_rate_rad_per_s) * STEP_S / BANK_RATE_LAG_S;
        if self.on_ground {
            // The main wheels hold the wings level.
            self.bank_rate_rad_per_s = -self.bank_rad / 0.5;
        }
        self.bank_rad += self.bank_rate_rad_per_s * STEP_S;

        let coordinated_rate = GRAVITY_MPS2 * self.bank_rad.tan() / airspeed;
        let off_alignment = wrapped_rad(commands.align_heading_rad - self.heading_rad);
        let heading_acceleration = (1.0 - commands.align_ratio) * YAW_WEATHERCOCK_PER_S2 * sideslip
            + commands.align_ratio * RUDDER_STIFFNESS_PER_S2 * off_alignment
            - YAW_DAMPING_PER_S
                * (self.heading_rate_rad_per_s - (1.0 - commands.align_ratio) * coordinated_rate);
        self.heading_rate_rad_per_s += heading_acceleration * STEP_S;
        self.heading_rad = wrapped_rad(self.heading_rad + self.heading_rate_rad_per_s * STEP_S);
    }

    /// Rate of turn of the north-east-down axes crossed with the velocity: the local axes move with the aircraft around the earth.
    /// (The earth's own rotation, 0.01 m/s^2 at most, is left to the autopilot's trim.)
    fn transport_acceleration(&self) -> DVec3 {
        let (meridian_m, parallel_m) = self.curvature_radii_m();
        let north_rate = self.velocity_ned_mps.x / meridian_m;
        let east_rate = self.velocity_ned_mps.y / parallel_m;
        let latitude_rad = self.position.latitude_deg.to_radians();
        let rate = DVec3::new(east_rate, -north_rate, -east_rate * latitude_rad.tan());
        rate.cross(self.velocity_ned_mps)
    }

    fn move_over_ellipsoid(&mut self) {
        let (meridian_m, parallel_m) = self.curvature_radii_m();
        let cos_latitude = self.position.latitude_deg.to_radians().cos();
        let step = self.velocity_ned_mps * STEP_S;
        self.position.latitude_deg += (step.x / meridian_m).to_degrees();
        self.position.longitude_deg += (step.y / (parallel_m * cos_latitude)).to_degrees();
        self.position.altitude_msl_m -= step.z;
    }

    /// Radii of curvature of the meridian and of the prime vertical at the aircraft's height, metres.
    fn curvature_radii_m(&self) -> (f64, f64) {
        let eccentricity_squared = WGS84_FLATTENING * (2.0 - WGS84_FLATTENING);
        let sin_latitude = self.position.latitude_deg.to_radians().sin();
        let w = 1.0 - eccentricity_squared * sin_latitude * sin_latitude;
        let height_m = self.position.altitude_msl_m;
        (
            WGS84_SEMI_MAJOR_M * (1.0 - eccentricity_squared) / (w * w.sqrt()) + height_m,
            WGS84_SEMI_MAJOR_M / w.sqrt() + height_m,
        )
    }
}

/// Wraps an angle to [-pi, pi).
pub(crate) fn wrapped_rad(angle_rad: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    (angle_rad + PI).rem_euclid(TAU) - PI
}

#[cfg(test)]
mod tests {
    use super::*;

    const STILL: AirMotion = AirMotion {
        velocity_ned_mps: DVec3::ZERO,
        turbulence_ned_mps: DVec3::ZERO,
        roll_rad_per_s: 0.0,
    };

    fn level_north() -> (Aircraft, Commands) {
        let controls = Controls {
            flap_ratio: 0.25,
            gear_ratio: 0.0,
        };
        let trim = aerodynamics::level_trim(
            aerodynamics::WING_AREA_M2,
            90.0,
            density_kg_per_m3(700.0),
            controls,
        );
        let aircraft = Aircraft {
            form: Form::of(airframe::AircraftType::boeing_737_800()),
            position: Geodetic {
                latitude_deg: 1.2,
                longitude_deg: 103.9,
                altitude_msl_m: 700.0,
            },
            velocity_ned_mps: DVec3::X * 90.0,
            heading_rad: 0.0,
            pitch_rad: trim.angle_of_attack_rad,
            bank_rad: 0.0,
            heading_rate_rad_per_s: 0.0,
            pitch_rate_rad_per_s: 0.0,
            bank_rate_rad_per_s: 0.0,
            thrust_n: trim.drag_n,
            controls,
            spoiler_ratio: 0.0,
            on_ground: false,
        };
        let commands = Commands {
            bank_rad: 0.0,
            pitch_rad: trim.angle_of_attack_rad,
            thrust_n: trim.drag_n,
            align_heading_rad: 0.0,
            align_ratio: 0.0,
            controls,
            braking_mps2: 0.0,
        };
        (aircraft, commands)
    }

    fn fly(aircraft: &mut Aircraft, commands: &Commands, air: &AirMotion, seconds: f64) {
        for _ in 0..(seconds / STEP_S).round() as usize {
            aircraft.step(commands, air, 0.0);
        }
    }

    #[test]
    fn trimmed_aircraft_flies_on_level_and_as_far_as_its_speed_says() {
        let (mut aircraft, commands) = level_north();
        let from = aircraft.position;
        fly(&mut aircraft, &commands, &STILL, 20.0);
        let flown = from.lat_lon().distance_m(aircraft.position.lat_lon());
        // Over ground at sea level: the circle is larger at 700 m.
        let expected = 90.0 * 20.0 * (1.0 - 700.0 / WGS84_SEMI_MAJOR_M);
        assert!((flown - expected).abs() < 4.0, "flown {flown} m");
        assert!((aircraft.position.altitude_msl_m - 700.0).abs() < 2.0);
    }

    #[test]
    fn a_bank_to_the_right_turns_right_at_the_coordinated_rate() {
        let (mut aircraft, mut commands) = level_north();
        commands.bank_rad = 15_f64.to_radians();
        fly(&mut aircraft, &commands, &STILL, 6.0);
        let rate = aircraft.heading_rate_rad_per_s;
        let coordinated = GRAVITY_MPS2 * aircraft.bank_rad.tan() / 90.0;
        assert!(
            aircraft.velocity_ned_mps.y > 5.0,
            "{:?}",
            aircraft.velocity_ned_mps
        );
        assert!(
            (rate / coordinated - 1.0).abs() < 0.25,
            "{rate} {coordinated}"
        );
    }

    #[test]
    fn a_wind_from_the_right_turns_the_nose_right() {
        let (mut aircraft, commands) = level_north();
        let air = AirMotion {
            velocity_ned_mps: DVec3::new(0.0, -10.0, 0.0),
            ..STILL
        };
        fly(&mut aircraft, &commands, &air, 8.0);
        assert!(
            aircraft.heading_rad.to_degrees() > 3.0,
            "{}",
            aircraft.heading_rad.to_degrees()
        );
    }

    #[test]
    fn an_updraught_lifts_the_aircraft() {
        let (mut aircraft, commands) = level_north();
        let upwards = DVec3::Z * -3.0;
        let air = AirMotion {
            velocity_ned_mps: upwards,
            turbulence_ned_mps: upwards,
            ..STILL
        };
        fly(&mut aircraft, &commands, &air, 2.0);
        assert!(
            aircraft.velocity_ned_mps.z < -0.5,
            "{}",
            aircraft.velocity_ned_mps.z
        );
    }
}
