//! The simulated world: datarefs, the aircraft, the clock, the sky, and whether all of it is frozen.
//!
//! Each of them has its own file; here is what connects them, and what clients can do to them.

mod aircraft;
pub(super) mod airport;
mod autopilot;
mod clock;
mod data_output;
pub(super) mod flight_start;
pub(super) mod local_frame;
mod motion;
mod possible;
mod sky;

use std::collections::HashMap;

use dataset::conditions::{Clock, Weather};
use dataset::imaging::Imaging;
use dataset::pose::{Controls, FlightState, Pose};
use dataset::runway::Runway;
use xplane_bridge::datarefs::{self as names, Generation};
use xplane_bridge::packet::{PlaceAircraft, Position};

use self::aircraft::{Aircraft, POSITION, at_rest};
use self::airport::GROUND_MSL_M;
use self::sky::Sky;
use crate::datarefs::{Datarefs, Ignored};

const PAUSED: &str = "sim/time/paused";
const RUNNING_TIME_S: &str = "sim/time/total_running_time_sec";
const FLIGHT_TIME_S: &str = "sim/time/total_flight_time_sec";

/// Everything that has a state.
#[derive(Debug)]
pub(super) struct World {
    state: State,
    /// The runway of the scenario while frozen.
    frozen: Option<Runway>,
    /// Lens, air and sensor of each view while frozen; a view beyond is ideal.
    imaging: Vec<Imaging>,
    drawn_frames: u64,
    /// Code of the check pattern while it shows.
    check_pattern: Option<u32>,
    /// What clients saved, by path.
    situations: HashMap<String, State>,
    /// The main menu shows otherwise.
    flight_loaded: bool,
}

/// What a situation file holds.
#[derive(Debug, Clone)]
struct State {
    datarefs: Datarefs,
    aircraft: Aircraft,
    sky: Sky,
}

impl World {
    /// A fresh simulator, with the aircraft parked, or with the main menu in front of it.
    pub(super) fn new(generation: Generation, flight_loaded: bool) -> Self {
        let mut datarefs = Datarefs::new(generation);
        let aircraft = Aircraft::default();
        aircraft.publish(&mut datarefs);
        datarefs.set_text(aircraft::FILE, "Aircraft/Stand-in/airliner.acf");
        clock::follow_system(&mut datarefs);
        let sky = Sky::new(generation, &datarefs);
        Self {
            state: State {
                datarefs,
                aircraft,
                sky,
            },
            frozen: None,
            imaging: vec![],
            drawn_frames: 0,
            check_pattern: None,
            situations: HashMap::new(),
            flight_loaded,
        }
    }

    /// Makes the capture link known to clients.
    pub(super) fn publish_capture_port(&mut self, port: u16) {
        self.state
            .datarefs
            .set(names::CAPTURE_PORT, f64::from(port));
    }

    /// Sets what belongs to the simulator or to a plugin of it.
    pub(super) fn set_own(&mut self, path: &str, value: f64) {
        self.state.datarefs.set(path, value);
    }

    /// Which X-Plane this is like, 120400 for 12.4.0.
    pub(super) fn version(&self) -> i32 {
        self.state.datarefs.get(names::VERSION) as i32
    }

    /// The same as people write it.
    pub(super) fn version_text(&self) -> String {
        let version = self.version();
        match version / 10_000 {
            // 115501 is 11.55r1.
            11 => format!("11.{}", version / 100 % 100),
            major => format!("{major}.{}.{}", version / 100 % 100, version % 100),
        }
    }

    /// All datarefs.
    pub(super) fn datarefs(&self) -> &Datarefs {
        &self.state.datarefs
    }

    /// Whether a flight is loaded.
    pub(super) fn flight_loaded(&self) -> bool {
        self.flight_loaded
    }

    /// A dataref as RREF carries it.
    pub(super) fn read(&self, path: &str) -> f32 {
        self.state.datarefs.read(path)
    }

    /// A client's write over UDP.
    pub(super) fn write(&mut self, path: &str, value: f32) -> Result<(), Ignored> {
        self.write_exact(path, f64::from(value))
    }

    /// A client's write with all its bits.
    pub(super) fn write_exact(&mut self, path: &str, value: f64) -> Result<(), Ignored> {
        let State {
            datarefs,
            aircraft,
            sky,
        } = &mut self.state;
        datarefs.write_exact(path, value)?;
        let name = path.split('[').next().unwrap_or(path);
        if let Some(name) = name.strip_prefix(POSITION) {
            aircraft.follow(name, datarefs);
        }
        let now_s = datarefs.get(RUNNING_TIME_S);
        sky.written(name, datarefs, now_s);
        Ok(())
    }

    /// A client's command; says whether it has any effect here.
    pub(super) fn command(&mut self, path: &str) -> bool {
        let State { datarefs, sky, .. } = &mut self.state;
        match path {
            names::COMMAND_PAUSE_ON => datarefs.set(PAUSED, 1.0),
            names::COMMAND_PAUSE_OFF => datarefs.set(PAUSED, 0.0),
            names::COMMAND_REGENERATE_WEATHER => {
                let now_s = datarefs.get(RUNNING_TIME_S);
                sky.regenerate(datarefs, now_s);
            }
            _ => {
                return autopilot::command(datarefs, path)
                    || COMMANDS_WITHOUT_EFFECT.contains(&path);
            }
        }
        true
    }

    /// All commands that [`World::command`] knows.
    pub(super) fn commands() -> impl Iterator<Item = &'static str> {
        let own = [
            names::COMMAND_PAUSE_ON,
            names::COMMAND_PAUSE_OFF,
            names::COMMAND_REGENERATE_WEATHER,
        ];
        own.into_iter()
            .chain(autopilot::commands())
            .chain(COMMANDS_WITHOUT_EFFECT.iter().copied())
    }

    /// Lets `elapsed_s` of time pass.
    pub(super) fn advance(&mut self, elapsed_s: f64) {
        let State {
            datarefs, aircraft, ..
        } = &mut self.state;
        let running_s = datarefs.get(RUNNING_TIME_S) + elapsed_s;
        datarefs.set(RUNNING_TIME_S, running_s);
        if self.frozen.is_some() {
            return;
        }
        clock::run(datarefs, elapsed_s);
        let stopped = datarefs.get(PAUSED) != 0.0;
        if !stopped {
            let flight_s = datarefs.get(FLIGHT_TIME_S) + elapsed_s;
            datarefs.set(FLIGHT_TIME_S, flight_s);
        }
        if !stopped && datarefs.get(names::OVERRIDE_FLIGHT_MODEL) == 0.0 {
            aircraft.fly_on(elapsed_s);
            aircraft.publish(datarefs);
        }
    }

    /// `VEHX`, `VEHS`: moves the aircraft, and stops the flight model for the first of them. A place with a number that is none is ignored.
    pub(super) fn place(&mut self, place: &PlaceAircraft) {
        let State {
            datarefs, aircraft, ..
        } = &mut self.state;
        let angles = [place.heading_true_deg, place.pitch_deg, place.roll_deg].map(f64::from);
        let position = [
            place.latitude_deg,
            place.longitude_deg,
            place.elevation_msl_m,
        ];
        if !angles
            .iter()
            .chain(&position)
            .all(|number| number.is_finite())
        {
            tracing::warn!(?place, "place ignored: expected finite numbers");
            return;
        }
        if place.freeze {
            datarefs.set(names::OVERRIDE_FLIGHT_MODEL, 1.0);
        }
        aircraft.place(Pose {
            latitude_deg: place.latitude_deg,
            longitude_deg: place.longitude_deg,
            altitude_msl_m: place.elevation_msl_m,
            heading_true_deg: f64::from(place.heading_true_deg),
            pitch_deg: f64::from(place.pitch_deg),
            roll_deg: f64::from(place.roll_deg),
        });
        aircraft.publish(datarefs);
    }

    /// `ACFN`: another aircraft stands where the old one did.
    pub(super) fn load_aircraft(&mut self, file: &str) {
        let State {
            datarefs, aircraft, ..
        } = &mut self.state;
        datarefs.set_text(aircraft::FILE, file);
        let pose = aircraft.state().pose;
        aircraft.start(pose, 0.0);
        aircraft.publish(datarefs);
    }

    /// `SIMO`: keeps everything under a name.
    pub(super) fn save_situation(&mut self, path: &str) {
        self.situations.insert(path.into(), self.state.clone());
    }

    /// `SIMO`: brings everything back; says whether there is such a situation.
    pub(super) fn load_situation(&mut self, path: &str) -> bool {
        let Some(state) = self.situations.get(path) else {
            return false;
        };
        let running_s = self.state.datarefs.get(RUNNING_TIME_S);
        self.state = state.clone();
        self.state.datarefs.set(RUNNING_TIME_S, running_s);
        self.flight_loaded = true;
        true
    }

    /// What `RPOS` says.
    pub(super) fn position(&self) -> Position {
        self.state.aircraft.position()
    }

    /// The weather that is flown and drawn.
    pub(super) fn weather(&self) -> Weather {
        possible::weather(self.state.sky.weather())
    }

    /// The clock as the datarefs have it.
    pub(super) fn clock(&self) -> Clock {
        possible::clock(names::clock_from_datarefs(|path| {
            self.state.datarefs.read(path)
        }))
    }

    /// Stops flight model, clock and clouds.
    pub(super) fn freeze(&mut self, runway: Runway) {
        self.state.datarefs.set(names::OVERRIDE_FLIGHT_MODEL, 1.0);
        self.frozen = Some(runway);
        self.imaging.clear();
    }

    /// Sets through what the views are seen until the next freeze.
    pub(super) fn set_imaging(&mut self, imaging: Vec<Imaging>) {
        self.imaging = imaging;
    }

    /// Through what a view is seen.
    pub(super) fn imaging(&self, view: u32) -> Imaging {
        self.imaging.get(view as usize).copied().unwrap_or_default()
    }

    /// Lets everything run again.
    pub(super) fn release(&mut self) {
        self.state.datarefs.set(names::OVERRIDE_FLIGHT_MODEL, 0.0);
        self.frozen = None;
    }

    /// Shows the check pattern with a code, or takes it away; the number of the first frame that is so.
    pub(super) fn set_check_pattern(&mut self, code: Option<u32>) -> u64 {
        self.check_pattern = code;
        self.drawn_frames += 1;
        self.drawn_frames
    }

    /// Whether the check pattern shows.
    pub(super) fn check_pattern(&self) -> Option<u32> {
        self.check_pattern
    }

    /// Height of the ground above mean sea level, metres: everywhere that of the runway.
    pub(super) fn terrain_msl_m(&self) -> f64 {
        let runway = self.frozen.as_ref();
        runway.map_or(GROUND_MSL_M, |runway| runway.threshold.altitude_msl_m)
    }

    /// The runway while frozen.
    pub(super) fn frozen_runway(&self) -> Option<&Runway> {
        self.frozen.as_ref()
    }

    /// Shows the aircraft in a state of a flight.
    pub(super) fn show(&mut self, state: FlightState) {
        self.state.aircraft.show(state);
        self.state.aircraft.publish(&mut self.state.datarefs);
    }

    /// Poses the aircraft for a picture and returns the number of the frame that shows it.
    pub(super) fn pose_for_frame(&mut self, pose: Pose, controls: Controls) -> u64 {
        self.show(FlightState {
            controls,
            ..at_rest(pose)
        });
        self.drawn_frames += 1;
        self.drawn_frames
    }
}

/// Commands that X-Plane has and clients send, which change nothing that the stand-in has.
const COMMANDS_WITHOUT_EFFECT: &[&str] = &[
    "sim/operation/fix_all_systems",
    "sim/operation/screenshot",
    "sim/flight_controls/flaps_down",
    "sim/flight_controls/flaps_up",
    "sim/none/none",
];

#[cfg(test)]
mod tests;
