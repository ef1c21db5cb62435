//! The built-in flight model: flies an approach and a landing.
//!
//! Input: the start of the flight, its runway, its vertical profile, its seed, and the weather. Output: the states of the aircraft
//! at 30 Hz from the start to 6 s after touchdown (or to the time limit). A pure function: the same request in the same weather
//! gives the same bytes.
//!
//! A point mass with attitude under an ILS autopilot flies through a moving atmosphere, with a file per part. The model is compared with an
//! independent model's flights (`tests/recorded_flights.rs`).
//!
//! The stand-in flies with it, and so does `dtd generate` for sweeps whose flights are computed ahead instead of flown by X-Plane.

#![forbid(unsafe_code)]

mod aerodynamics;
mod air;
mod aircraft;
mod autopilot;
mod form;
mod gust;
mod landing_gear;
mod random;
mod technique;
mod time_step;
mod turbulence;
mod vertical_guidance;

#[cfg(test)]
mod tests;

use airframe::AircraftType;
use dataset::conditions::Weather;
use dataset::geometry::geodesy::Geodetic;
use dataset::geometry::pose::{Controls, FlightState};
use dataset::geometry::runway::{Runway, RunwayCoordinates};
use glam::DVec3;
use xplane_bridge::fly::FlyRequest;

use aerodynamics::GRAVITY_MPS2;
use air::{Air, SEA_LEVEL_DENSITY_KG_PER_M3, density_kg_per_m3};
use aircraft::{Aircraft, Commands};
use autopilot::Autopilot;
use form::Form;
use technique::Technique;
pub use time_step::OUTPUT_RATE_HZ;
use time_step::{STEP_S, STEPS_PER_STATE};
use vertical_guidance::Situation;

/// Version of the flights: changes with any flight's bytes. It is part of plans with computed flights.
pub const VERSION: u32 = 1;

/// A flight ends this long after the wheels first touch, seconds.
const ROLL_OUT_S: f64 = 6.0;

/// A flight that did not end on the runway.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error(
    "the flight has not landed within {limit_s:.0} s{}; does it begin high above the glide path, or far from it?",
    place_of(last.as_deref())
)]
pub struct NotLanded {
    /// Limit of the request, seconds.
    pub limit_s: f64,
    /// State of the aircraft at that time.
    pub last: Option<Box<FlightState>>,
}

fn place_of(last: Option<&FlightState>) -> String {
    last.map_or_else(String::new, |state| {
        let pose = state.pose;
        format!(
            ": it ended at {:.5}, {:.5}, {:.0} m above mean sea level",
            pose.latitude_deg, pose.longitude_deg, pose.altitude_msl_m
        )
    })
}

/// Flies `request` through `weather` with a type until it has landed.
///
/// # Errors
/// The flight is still in the air at `request.time_limit_s`.
pub fn land(
    request: &FlyRequest,
    aircraft: &AircraftType,
    weather: &Weather,
) -> Result<Vec<FlightState>, NotLanded> {
    let states = fly(request, aircraft, weather);
    match states.last() {
        Some(last) if last.on_ground => Ok(states),
        last => Err(NotLanded {
            limit_s: request.time_limit_s,
            last: last.copied().map(Box::new),
        }),
    }
}

/// Flies `request` through `weather` with a type. A flight that has not landed by `request.time_limit_s` ends there, in the air.
pub fn fly(request: &FlyRequest, aircraft: &AircraftType, weather: &Weather) -> Vec<FlightState> {
    let mut flight = Flight::begin(request, Form::of(aircraft), weather);
    let mut states = vec![flight.state()];
    let mut landed_at_s = None;
    let mut commands = flight.commands(false);
    for step in 1.. {
        let time_s = step as f64 * STEP_S;
        if time_s > request.time_limit_s {
            break;
        }
        flight.step(time_s, &commands);
        if flight.aircraft.on_ground && landed_at_s.is_none() {
            landed_at_s = Some(time_s);
        }
        if step % STEPS_PER_STATE == 0 {
            states.push(flight.state());
            commands = flight.commands(landed_at_s.is_some());
        }
        if landed_at_s.is_some_and(|landed_s| time_s >= landed_s + ROLL_OUT_S) {
            break;
        }
    }
    states
}

struct Flight<'a> {
    runway: &'a Runway,
    target: Geodetic,
    air: Air,
    aircraft: Aircraft,
    autopilot: Autopilot,
    time_s: f64,
    airspeed_mps: f64,
}

impl<'a> Flight<'a> {
    fn begin(request: &'a FlyRequest, form: Form, weather: &Weather) -> Self {
        let runway = &request.runway;
        let start = &request.start;
        let ground_msl_m = runway.threshold.altitude_msl_m;
        let air = Air::new(weather, request.seed, form.span_m);
        let heading_rad = start.heading_true_deg.to_radians();
        let wind = air.mean_wind_ned_mps(start.position.altitude_msl_m - ground_msl_m);
        let velocity_ned_mps =
            DVec3::new(heading_rad.cos(), heading_rad.sin(), 0.0) * start.speed_mps + wind;

        let density = density_kg_per_m3(start.position.altitude_msl_m);
        let start_speed_mps = start.speed_mps * (density / SEA_LEVEL_DENSITY_KG_PER_M3).sqrt();
        let wind_angle_rad = (weather.wind_from_true_deg - runway.course_true_deg).to_radians();
        let technique = Technique::of(
            request.seed,
            form.approach_speed_mps,
            start_speed_mps,
            weather.wind_speed_mps * wind_angle_rad.cos(),
        );
        let mut flight = Self {
            runway,
            target: runway.touchdown_target(),
            air,
            aircraft: Aircraft {
                form,
                position: start.position,
                velocity_ned_mps,
                heading_rad,
                pitch_rad: 0.0,
                bank_rad: 0.0,
                heading_rate_rad_per_s: 0.0,
                pitch_rate_rad_per_s: 0.0,
                bank_rate_rad_per_s: 0.0,
                thrust_n: 0.0,
                controls: Controls::default(),
                spoiler_ratio: 0.0,
                on_ground: false,
            },
            autopilot: Autopilot::new(request, technique, form.wing_area_m2),
            time_s: 0.0,
            airspeed_mps: start.speed_mps,
        };
        flight.trim(&technique, start_speed_mps);
        flight
    }

    /// Trims the aircraft for steady flight at the start: no jolt in the first seconds.
    fn trim(&mut self, technique: &Technique, start_speed_mps: f64) {
        let situation = self.situation();
        let before_threshold_m = situation.to_target_m - self.runway.touchdown_past_threshold_m;
        let aircraft = &mut self.aircraft;
        aircraft.controls =
            technique.controls(before_threshold_m, start_speed_mps, aircraft.controls);
        let climb_mps = self.autopilot.first_climb_mps(&situation);
        let density = density_kg_per_m3(aircraft.position.altitude_msl_m);
        let trim = aerodynamics::level_trim(
            aircraft.form.wing_area_m2,
            self.airspeed_mps,
            density,
            aircraft.controls,
        );
        let climb_rad = climb_mps / self.airspeed_mps;
        aircraft.velocity_ned_mps.z = -climb_mps;
        aircraft.pitch_rad = trim.angle_of_attack_rad + climb_rad;
        aircraft.thrust_n = trim.drag_n + aerodynamics::MASS_KG * GRAVITY_MPS2 * climb_rad;
    }

    fn commands(&mut self, landed: bool) -> Commands {
        let situation = self.situation();
        self.autopilot
            .commands(&situation, &self.aircraft, self.airspeed_mps, landed)
    }

    fn step(&mut self, time_s: f64, commands: &Commands) {
        self.time_s = time_s;
        let ground_msl_m = self.runway.threshold.altitude_msl_m;
        let air = self.air.step(
            time_s,
            self.aircraft.position.altitude_msl_m - ground_msl_m,
            self.aircraft.heading_rad,
            self.airspeed_mps,
        );
        self.airspeed_mps = self.aircraft.airspeed_mps(air.velocity_ned_mps);
        self.aircraft.step(commands, &air, ground_msl_m);
    }

    fn situation(&self) -> Situation {
        let position = self.aircraft.position;
        let relative = RunwayCoordinates::of(position, self.target, self.runway.course_true_deg);
        let course_rad = self.runway.course_true_deg.to_radians();
        let velocity = self.aircraft.velocity_ned_mps;
        Situation {
            to_target_m: relative.along_track_m,
            right_of_course_m: relative.cross_track_m,
            right_rate_mps: velocity.y * course_rad.cos() - velocity.x * course_rad.sin(),
            height_m: relative.height_over_target_m,
            wheel_height_m: position.altitude_msl_m
                - self.runway.threshold.altitude_msl_m
                - self.aircraft.form.wheel_height_below_cg_m,
            ground_speed_mps: velocity.x.hypot(velocity.y),
            climb_mps: -velocity.z,
        }
    }

    fn state(&self) -> FlightState {
        let velocity = self.aircraft.velocity_ned_mps;
        FlightState {
            time_s: self.time_s,
            pose: self.aircraft.pose(),
            velocity_north_mps: velocity.x,
            velocity_east_mps: velocity.y,
            velocity_down_mps: velocity.z,
            true_airspeed_mps: self.airspeed_mps,
            controls: self.aircraft.controls,
            on_ground: self.aircraft.on_ground,
        }
    }
}
