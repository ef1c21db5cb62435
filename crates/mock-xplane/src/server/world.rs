//! The simulated world: datarefs, the aircraft, the clock, the sky, and whether everything is frozen.
//!
//! Each has its own file; this one connects them, and defines the actions of clients.

mod aircraft;
pub(super) mod airport;
mod autopilot;
mod clock;
pub(super) mod flight_start;
pub(super) mod motion;
mod possible;
pub(super) mod scenery;
mod sky;
mod throttle;
pub(super) mod traffic;
mod view;

use std::collections::BTreeSet;

use airframe::AircraftType;
use dataset::conditions::{Clock, Weather};
use dataset::geometry::geodesy::LatLon;
use dataset::geometry::imaging::Imaging;
use dataset::geometry::pose::{Controls, FlightState, Pose};
use dataset::geometry::runway::Runway;
use xplane_bridge::datarefs::{self as names, Generation, Version};
use xplane_bridge::packet::Position;

use self::aircraft::{Aircraft, POSITION, at_rest};
use self::airport::{ON_THRESHOLD, far_away};
use self::scenery::Scenery;
use self::scenery::local_frame::LocalFrame;
use self::sky::Sky;
use self::traffic::Traffic;
use crate::datarefs::{Complaint, Datarefs, FOREIGN_NAMES, Ignored};
use crate::quirks::{Quirk, Quirks};

const PAUSED: &str = "sim/time/paused";
const RUNNING_TIME_S: &str = "sim/time/total_running_time_sec";
const FLIGHT_TIME_S: &str = "sim/time/total_flight_time_sec";

/// Names that are remembered because a client looked them up: clients choose them.
const MAX_FOREIGN_NAMES: usize = 10_000;
const COMMAND_PAUSE_TOGGLE: &str = "sim/operation/pause_toggle";
const COMMAND_QUIT: &str = "sim/operation/quit";

/// All parts with a state.
#[derive(Debug)]
pub(super) struct World {
    state: State,
    /// The runway of the scenario while frozen.
    pub(super) frozen: Option<Runway>,
    /// Lens, air and sensor of each view while frozen; further views are ideal.
    pub(super) imaging: Vec<Imaging>,
    /// Other aircraft that images show while frozen.
    pub(super) traffic: Traffic,
    drawn_frames: u64,
    /// Code of the check pattern while it is shown.
    pub(super) check_pattern: Option<u32>,
    /// Otherwise the main menu is open.
    pub(super) flight_loaded: bool,
    pub(super) quirks: Quirks,
    /// A plugin's host flies the aircraft and reports its position.
    hosted: bool,
    /// Number of times it was placed by someone other than the host.
    pub(super) placements: u64,
    /// True if other aircraft fly next to the user's.
    pub(super) others_fly: bool,
    /// Names that clients looked up and that are not of this version.
    foreign_names: BTreeSet<String>,
    /// True if X-Plane's error about a deprecated dataref lies over the scene.
    pub(super) shows_alert: bool,
    /// True once the simulator was told to end.
    pub(super) quits: bool,
}

#[derive(Debug, Clone)]
struct State {
    datarefs: Datarefs,
    aircraft: Aircraft,
    sky: Sky,
    scenery: Scenery,
}

impl World {
    /// A fresh simulator, with the aircraft parked, or showing the main menu.
    pub(super) fn new(generation: Generation, flight_loaded: bool, quirks: Quirks) -> Self {
        let quirks = quirks.of(generation);
        let mut datarefs = Datarefs::new(generation);
        let parked = if quirks.has(Quirk::FarAway) {
            far_away()
        } else {
            ON_THRESHOLD
        };
        let aircraft = Aircraft::parked(parked);
        aircraft.publish(&mut datarefs);
        let file = if quirks.has(Quirk::LoadedC172) {
            aircraft::C172
        } else {
            aircraft::STAND_IN
        };
        aircraft::load(file, &mut datarefs);
        if quirks.has(Quirk::ElectricMasterOff) {
            datarefs.set(autopilot::ELECTRIC_MASTER, 0.0);
        }
        view::begin_flight(quirks, &mut datarefs);
        clock::follow_system(&mut datarefs);
        let sky = Sky::new(generation, quirks, &mut datarefs);
        let scenery = Scenery::around(parked.position().lat_lon(), quirks);
        Self {
            state: State {
                datarefs,
                aircraft,
                sky,
                scenery,
            },
            frozen: None,
            imaging: vec![],
            traffic: Traffic::default(),
            drawn_frames: 0,
            check_pattern: None,
            flight_loaded,
            quirks,
            hosted: false,
            placements: 0,
            others_fly: quirks.has(Quirk::AiAircraft),
            foreign_names: BTreeSet::new(),
            shows_alert: false,
            quits: false,
        }
    }

    /// Notes that a client looks up a dataref by its name, `name[3]` for an element. Returns X-Plane's complaint, if there is one, the
    /// first time.
    pub(super) fn looked_up(&mut self, path: &str) -> Option<String> {
        let name = path.split('[').next().unwrap_or(path);
        let found = self.state.datarefs.find(name);
        let complaint = found.map(|(dataref, _)| dataref.complaint);
        let is_foreign = complaint != Some(None) && self.foreign_names.len() < MAX_FOREIGN_NAMES;
        if !is_foreign || !self.foreign_names.insert(name.to_owned()) {
            return None;
        }
        let count = self.foreign_names.len() as f64;
        self.state.datarefs.set(FOREIGN_NAMES, count);
        let Some(complaint) = complaint.flatten() else {
            tracing::info!(name, "looked up, but unknown to this version");
            return None;
        };
        self.shows_alert |= complaint == Complaint::Shown;
        let text = complaint.text(name);
        tracing::warn!("{text}");
        Some(text)
    }

    /// Lets a plugin's host control the aircraft; returns its current local coordinates.
    pub(super) fn host(&mut self) -> LocalFrame {
        self.hosted = true;
        self.state.aircraft.frame()
    }

    /// The aircraft's local coordinates.
    pub(super) fn frame(&self) -> LocalFrame {
        self.state.aircraft.frame()
    }

    /// The host reports the aircraft's position, and its local coordinates.
    pub(super) fn show_hosted(&mut self, state: FlightState, frame: LocalFrame) {
        self.state.aircraft.set_frame(frame);
        self.show(state);
    }

    /// A flight has started somewhere: view, windows and other aircraft are reset.
    pub(super) fn flight_began(&mut self, at: LatLon) {
        view::begin_flight(self.quirks, &mut self.state.datarefs);
        if self.quirks.has(Quirk::RestartingStart) {
            self.state.scenery.load(at);
        }
        self.others_fly = self.quirks.has(Quirk::AiAircraft);
    }

    /// Position of the aircraft, and its speed when it starts to fly, metres per second.
    pub(super) fn aircraft(&self) -> (FlightState, f64) {
        let aircraft = &self.state.aircraft;
        (*aircraft.state(), aircraft.speed_to_come_mps())
    }

    /// Removes all other aircraft, or lets them fly.
    pub(super) fn let_others_fly(&mut self, fly: bool) {
        self.others_fly = fly && self.quirks.has(Quirk::AiAircraft);
    }

    /// The camera was taken from the plugin that controlled it.
    pub(super) fn lose_camera(&mut self) {
        view::lose_camera(self.quirks, &mut self.state.datarefs);
    }

    /// True if the view shows the cockpit's panel.
    pub(super) fn shows_panel(&self) -> bool {
        view::shows_panel(&self.state.datarefs)
    }

    /// True if a pop-up covers the image.
    pub(super) fn shows_pop_up(&self) -> bool {
        view::shows_pop_up(&self.state.datarefs)
    }

    /// Type of the drawn aircraft.
    pub(super) fn aircraft_type(&self) -> &'static AircraftType {
        aircraft::drawn_type(&self.state.datarefs)
    }

    /// Size of the drawn aircraft relative to its type: a Cessna is drawn as a small airliner.
    pub(super) fn aircraft_scale(&self) -> f64 {
        aircraft::scale(&self.state.datarefs)
    }

    /// Duration of the freeze that a request has caused, seconds; can be queried once.
    pub(super) fn take_freeze_s(&mut self) -> Option<f64> {
        self.state.sky.take_freeze_s()
    }

    /// Sets a dataref that belongs to the simulator or to a plugin.
    pub(super) fn set_own(&mut self, path: &str, value: f64) {
        self.state.datarefs.set(path, value);
    }

    /// The imitated X-Plane version in its log's notation: 124009 for 12.4.0-r2.
    pub(super) fn version(&self) -> i32 {
        self.state.datarefs.get(names::VERSION) as i32
    }

    /// The version in human notation.
    pub(super) fn version_text(&self) -> String {
        Version::of_number(self.version().unsigned_abs()).to_string()
    }

    pub(super) fn datarefs(&self) -> &Datarefs {
        &self.state.datarefs
    }

    /// A dataref as carried by RREF.
    pub(super) fn read(&self, path: &str) -> f32 {
        self.state.datarefs.read(path)
    }

    /// A client's write over UDP.
    pub(super) fn write(&mut self, path: &str, value: f32) -> Result<(), Ignored> {
        self.write_exact(path, f64::from(value))
    }

    /// A client's write with full precision.
    pub(super) fn write_exact(&mut self, path: &str, value: f64) -> Result<(), Ignored> {
        let State {
            datarefs,
            aircraft,
            sky,
            ..
        } = &mut self.state;
        let before = datarefs.get(path);
        datarefs.write_exact(path, value)?;
        let name = path.split('[').next().unwrap_or(path);
        if let Some(name) = name.strip_prefix(POSITION) {
            self.placements += u64::from(aircraft.follow(name, datarefs));
        }
        sky.written(path, before, datarefs);
        view::written(path, datarefs);
        aircraft::written(path, datarefs);
        throttle::written(path, datarefs);
        Ok(())
    }

    /// A client's command; returns whether it has any effect here.
    pub(super) fn command(&mut self, path: &str) -> bool {
        let State { datarefs, sky, .. } = &mut self.state;
        match path {
            names::COMMAND_PAUSE_ON => datarefs.set(PAUSED, 1.0),
            names::COMMAND_PAUSE_OFF => datarefs.set(PAUSED, 0.0),
            COMMAND_PAUSE_TOGGLE => {
                let paused = datarefs.get(PAUSED) != 0.0;
                datarefs.set(PAUSED, f64::from(u8::from(!paused)));
            }
            names::COMMAND_REGENERATE_WEATHER => sky.regenerate(datarefs),
            COMMAND_QUIT => self.quits = true,
            _ => {
                return autopilot::command(datarefs, path)
                    || view::command(datarefs, path)
                    || COMMANDS_WITHOUT_EFFECT.contains(&path);
            }
        }
        true
    }

    pub(super) fn commands() -> impl Iterator<Item = &'static str> {
        let own = [
            names::COMMAND_PAUSE_ON,
            names::COMMAND_PAUSE_OFF,
            COMMAND_PAUSE_TOGGLE,
            names::COMMAND_REGENERATE_WEATHER,
            COMMAND_QUIT,
        ];
        own.into_iter()
            .chain(autopilot::commands())
            .chain(view::commands())
            .chain(COMMANDS_WITHOUT_EFFECT.iter().copied())
    }

    /// Lets `elapsed_s` of time pass.
    pub(super) fn advance(&mut self, elapsed_s: f64) {
        let State {
            datarefs,
            aircraft,
            sky,
            scenery,
        } = &mut self.state;
        let running_s = datarefs.get(RUNNING_TIME_S) + elapsed_s;
        datarefs.set(RUNNING_TIME_S, running_s);
        let was_loading = scenery.is_loading();
        let place = aircraft.state().pose.position();
        scenery.advance(elapsed_s, place.lat_lon());
        let loading = scenery.is_loading();
        datarefs.set(names::SCENERY_LOADING, f64::from(u8::from(loading)));
        if was_loading != loading && self.quirks.has(Quirk::MovingOrigin) {
            aircraft.move_origin(loading);
            aircraft.publish(datarefs);
        }
        let stopped = self.frozen.is_some() || datarefs.get(PAUSED) != 0.0;
        sky.advance(datarefs, elapsed_s, stopped);
        if self.frozen.is_some() {
            return;
        }
        clock::run(datarefs, elapsed_s);
        if self.hosted {
            return;
        }
        // Behind the main menu time stands still, whatever the pause state.
        if !stopped && self.flight_loaded {
            let flight_s = datarefs.get(FLIGHT_TIME_S) + elapsed_s;
            datarefs.set(FLIGHT_TIME_S, flight_s);
        }
        if !stopped && datarefs.get(names::OVERRIDE_FLIGHT_MODEL) == 0.0 {
            aircraft.fly_on(elapsed_s);
            aircraft.publish(datarefs);
        }
    }

    /// `ACFN`: a new aircraft replaces the old one.
    pub(super) fn load_aircraft(&mut self, file: &str) {
        let State {
            datarefs, aircraft, ..
        } = &mut self.state;
        aircraft::load(file, datarefs);
        let pose = aircraft.state().pose;
        aircraft.start(pose, 0.0);
        aircraft.publish(datarefs);
        self.placements += 1;
    }

    /// The position in `RPOS`.
    pub(super) fn position(&self) -> Position {
        self.state.aircraft.position()
    }

    /// The weather that is flown and drawn.
    pub(super) fn weather(&self) -> Weather {
        possible::weather(self.state.sky.weather())
    }

    /// The clock from the datarefs.
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
        self.traffic.clear();
    }

    pub(super) fn imaging(&self, view: u32) -> Imaging {
        self.imaging.get(view as usize).copied().unwrap_or_default()
    }

    /// Lets everything run again.
    pub(super) fn release(&mut self) {
        self.state.datarefs.set(names::OVERRIDE_FLIGHT_MODEL, 0.0);
        self.frozen = None;
    }

    /// Shows the check pattern with a code, or removes it; returns the number of the first frame that shows it.
    pub(super) fn set_check_pattern(&mut self, code: Option<u32>) -> u64 {
        self.check_pattern = code;
        self.drawn_frames += 1;
        self.drawn_frames
    }

    /// Height of the ground at a place above its final height, metres; `None` where no scenery is loaded.
    pub(super) fn ground_off_m(&self, at: LatLon) -> Option<f64> {
        self.state.scenery.ground_off_m(at)
    }

    pub(super) fn show(&mut self, state: FlightState) {
        self.state.aircraft.show(state);
        self.state.aircraft.publish(&mut self.state.datarefs);
    }

    /// Poses the aircraft for an image and returns the number of the frame that shows it.
    pub(super) fn pose_for_frame(&mut self, pose: Pose, controls: Controls) -> u64 {
        self.show(FlightState {
            controls,
            ..at_rest(pose)
        });
        self.drawn_frames += 1;
        self.drawn_frames
    }
}

/// Commands of X-Plane that clients send and that have no effect on the stand-in.
const COMMANDS_WITHOUT_EFFECT: &[&str] = &[
    "sim/operation/fix_all_systems",
    "sim/operation/close_windows",
    "sim/operation/toggle_main_menu",
    "sim/flight_controls/flaps_down",
    "sim/flight_controls/flaps_up",
    "sim/none/none",
];

#[cfg(test)]
mod tests;
