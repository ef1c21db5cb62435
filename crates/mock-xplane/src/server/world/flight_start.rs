//! Starting a flight: by the UDP packet `PREL`, or by X-Plane 12's Web API with weather and time.

use dataset::geometry::pose::Pose;
use xplane_bridge::datarefs as names;
use xplane_bridge::packet::PlaceAtStart;

use super::airport::{APPROACH_SPEED_MPS, CODE, ON_THRESHOLD, on_final};
use super::{FLIGHT_TIME_S, PAUSED, World, aircraft, clock};
use crate::datarefs::Ignored;

/// Kinds of `PREL` start that the stand-in supports.
const AT_POSITION: i32 = 6;
const RAMP: i32 = 10;
const TAKEOFF: i32 = 11;
const INSTRUMENT_APPROACH: i32 = 13;
/// Start of an instrument approach, nautical miles before the threshold.
const INSTRUMENT_APPROACH_NM: f64 = 10.0;

/// A new flight.
#[derive(Debug, Clone, PartialEq, Default)]
pub(in crate::server) struct FlightStart {
    /// The aircraft's file, if it is to change.
    pub(in crate::server) aircraft: Option<String>,
    /// Position and speed in metres per second, if they are to change.
    pub(in crate::server) place: Option<(Pose, f64)>,
    /// Time, if it is to change.
    pub(in crate::server) time: Option<StartTime>,
    /// Datarefs of the weather, if it is to change.
    pub(in crate::server) weather: Vec<(String, f64)>,
}

/// Start time of a flight. Days count from 0, which is 1 January.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::server) enum StartTime {
    /// The computer's clock, now and from now on.
    System,
    /// Local time at the aircraft.
    Local { day: u32, time_s: f64 },
    /// By UTC.
    Zulu { day: u32, time_s: f64 },
}

impl World {
    /// `PREL`: starts a flight; returns whether this kind of start is supported.
    pub(in crate::server) fn start(&mut self, start: &PlaceAtStart) -> bool {
        let here = start.airport == CODE;
        let place = match start.start_type {
            AT_POSITION => (
                Pose {
                    latitude_deg: start.latitude_deg,
                    longitude_deg: start.longitude_deg,
                    altitude_msl_m: start.elevation_msl_m,
                    heading_true_deg: start.heading_true_deg,
                    pitch_deg: 0.0,
                    roll_deg: 0.0,
                },
                start.speed_mps,
            ),
            RAMP | TAKEOFF if here => (ON_THRESHOLD, 0.0),
            INSTRUMENT_APPROACH if here => (on_final(INSTRUMENT_APPROACH_NM), APPROACH_SPEED_MPS),
            _ => return false,
        };
        let start = FlightStart {
            place: Some(place),
            ..FlightStart::default()
        };
        self.begin(&start).is_ok()
    }

    /// Starts or changes a flight.
    ///
    /// # Errors
    /// The dataref of the weather that could not be set; the flight is unchanged then.
    pub(in crate::server) fn begin(
        &mut self,
        start: &FlightStart,
    ) -> Result<(), (String, Ignored)> {
        let mut state = self.state.clone();
        if !start.weather.is_empty() {
            state.sky.open_for_flight();
        }
        for (path, value) in &start.weather {
            let before = state.datarefs.get(path);
            state
                .datarefs
                .write_exact(path, *value)
                .map_err(|reason| (path.clone(), reason))?;
            state.sky.written(path, before, &mut state.datarefs);
        }
        if !start.weather.is_empty() {
            state.sky.close_for_flight(&mut state.datarefs);
        }
        if let Some(file) = &start.aircraft {
            aircraft::load(file, &mut state.datarefs);
        }
        if let Some((pose, speed_mps)) = start.place {
            state.aircraft.start(pose, speed_mps);
            for (name, value) in [
                (names::OVERRIDE_FLIGHT_MODEL, 0.0),
                (names::AUTOPILOT_MODE, 0.0),
                (PAUSED, 0.0),
                (FLIGHT_TIME_S, 0.0),
            ] {
                state.datarefs.set(name, value);
            }
            state.aircraft.publish(&mut state.datarefs);
            self.flight_loaded = true;
            self.placements += 1;
        }
        let longitude_deg = state.aircraft.state().pose.longitude_deg;
        match start.time {
            None => {}
            Some(StartTime::System) => state.datarefs.set(names::USE_SYSTEM_TIME, 1.0),
            Some(StartTime::Zulu { day, time_s }) => {
                clock::set_zulu(&mut state.datarefs, day, time_s);
            }
            Some(StartTime::Local { day, time_s }) => {
                clock::set_local(&mut state.datarefs, day, time_s, longitude_deg);
            }
        }
        self.state = state;
        if let Some((pose, _)) = start.place {
            self.flight_began(pose.position().lat_lon());
        }
        Ok(())
    }
}
