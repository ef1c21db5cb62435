//! Starting a flight: by the UDP packet `PREL`, or by X-Plane 12's Web API with weather and time.

use dataset::geometry::pose::Pose;
use xplane_bridge::datarefs as names;
use xplane_bridge::packet::PlaceAtStart;

use super::{FLIGHT_TIME_S, PAUSED, World, aircraft, clock};
use crate::datarefs::Ignored;

/// The kind of `PREL` start that the stand-in supports.
const AT_POSITION: i32 = 6;

/// A new flight.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::server) struct FlightStart {
    /// The aircraft's file, if it is to change.
    pub(in crate::server) aircraft: Option<String>,
    /// Position and attitude.
    pub(in crate::server) pose: Pose,
    /// Speed, metres per second.
    pub(in crate::server) speed_mps: f64,
    /// Day, counted from 0, which is 1 January, and seconds of UTC, if they are to change.
    pub(in crate::server) zulu: Option<(u32, f64)>,
    /// Datarefs of the weather, if it is to change.
    pub(in crate::server) weather: Vec<(String, f64)>,
}

impl World {
    /// `PREL`: starts a flight; returns whether this kind of start is supported.
    pub(in crate::server) fn start(&mut self, start: &PlaceAtStart) -> bool {
        if start.start_type != AT_POSITION {
            return false;
        }
        let start = FlightStart {
            pose: Pose {
                latitude_deg: start.latitude_deg,
                longitude_deg: start.longitude_deg,
                altitude_msl_m: start.elevation_msl_m,
                heading_true_deg: start.heading_true_deg,
                pitch_deg: 0.0,
                roll_deg: 0.0,
            },
            speed_mps: start.speed_mps,
            aircraft: None,
            zulu: None,
            weather: Vec::new(),
        };
        self.begin(&start).is_ok()
    }

    /// Starts a flight.
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
        state.aircraft.start(start.pose, start.speed_mps);
        for (name, value) in [
            (names::OVERRIDE_FLIGHT_MODEL, 0.0),
            (names::AUTOPILOT_MODE, 0.0),
            (PAUSED, 0.0),
            (FLIGHT_TIME_S, 0.0),
        ] {
            state.datarefs.set(name, value);
        }
        state.aircraft.publish(&mut state.datarefs);
        if let Some((day, time_s)) = start.zulu {
            clock::set_zulu(&mut state.datarefs, day, time_s);
        }
        self.state = state;
        self.flight_loaded = true;
        self.placements += 1;
        self.flight_began(start.pose.position().lat_lon());
        Ok(())
    }
}
