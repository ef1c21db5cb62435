//! How a flight begins: who puts the aircraft where it starts, decided and logged here alone.
//!
//! The best way is X-Plane 12.4's Web API, which takes aircraft, place, speed, time and weather together and answers. Where it
//! is not, our plugin puts the aircraft there as part of the flight. Where no plugin serves the capture link, the UDP packet
//! `PREL` does, and `RPOS` shows whether it did.

use std::time::Duration;

use dataset::geodesy::Geodetic;
use tokio::time::Instant;

use super::Simulator;
use crate::datarefs::{
    self, AIRCRAFT_ICAO, AircraftFile, Generation, INDICATED_AIRSPEED_KT, aircraft_file,
};
use crate::error::BridgeError;
use crate::fly::FlightStart;
use crate::packet::{LoadAircraft, PlaceAtStart, Position};
use crate::web_api::{AirStart, WebApi, flight_body};

/// Kind of `PREL` that starts at latitude, longitude and elevation.
const START_AT_POSITION: i32 = 6;
/// Tries of `PREL` and `ACFN`.
const ATTEMPTS: u32 = 8;
/// How long a position may take to follow a `PREL`.
const PLACE_TIMEOUT: Duration = Duration::from_millis(500);
/// An aircraft that was put somewhere is found this close to it: it flies on while the answer travels.
const PLACED_WITHIN_M: f64 = 2_000.0;
/// How long X-Plane takes at most to load an aircraft.
const LOAD_TIMEOUT: Duration = Duration::from_secs(60);
/// How long a flight may take from its beginning to flying speed.
const FLYING_TIMEOUT: Duration = Duration::from_secs(60);
/// Velocities read zero just after a start: only above this speed does the aircraft fly.
const FLYING_KT: f32 = 50.0;
/// Who begins flights.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Starter {
    /// X-Plane 12.4's Web API.
    WebApi,
    /// Our plugin, as part of the flight.
    Plugin,
    /// `PREL`.
    Udp,
}

impl Simulator {
    /// Who begins flights here.
    pub(super) fn starter(&self) -> Starter {
        let has_flights = self.web_api.as_ref().is_some_and(WebApi::has_flights);
        if has_flights && self.aircraft_file().is_some() && self.conditions.is_some() {
            Starter::WebApi
        } else if self.description.plugin.is_some() {
            Starter::Plugin
        } else {
            Starter::Udp
        }
    }

    /// Begins a flight; says whether the aircraft is in the air then, or still to be put there by whoever flies it.
    pub(super) async fn start_flight(&mut self, start: &FlightStart) -> Result<bool, BridgeError> {
        let starter = self.starter();
        tracing::info!(?starter, "a flight begins");
        if starter == Starter::WebApi {
            match self.start_by_web_api(start).await {
                Ok(()) => return Ok(true),
                Err(BridgeError::WebApi(error)) => {
                    tracing::warn!(%error, "the flight is begun without the Web API");
                }
                Err(error) => return Err(error),
            }
        }
        self.load_aircraft().await?;
        if self.description.plugin.is_none() {
            self.place_by_udp(start).await?;
        }
        Ok(false)
    }

    async fn start_by_web_api(&mut self, start: &FlightStart) -> Result<(), BridgeError> {
        let (Some(api), Some(file), Some(conditions)) =
            (&self.web_api, self.aircraft_file(), &self.conditions)
        else {
            return Ok(());
        };
        let start = AirStart {
            start: *start,
            pitch_deg: 0.0,
        };
        api.start_flight(&flight_body(file.path, &start, conditions)?)
            .await?;
        let flying = |values: &[Option<f32>]| values[0].is_some_and(|speed| speed > FLYING_KT);
        let deadline = Instant::now() + FLYING_TIMEOUT;
        let found = self
            .udp
            .read_until(&[INDICATED_AIRSPEED_KT], deadline, flying)
            .await?;
        if !flying(&found) {
            return Err(BridgeError::NotTaken {
                name: INDICATED_AIRSPEED_KT.into(),
                attempts: 1,
                wanted: FLYING_KT,
                found: found[0],
            });
        }
        // The flight brought weather with it; whether it is the scenario's is seen as always.
        let writes = datarefs::weather_writes(&conditions.weather, self.generation)?;
        let clock = datarefs::running_clock_writes(&conditions.clock);
        self.await_weather(&writes).await?;
        self.write_until_read_back(&clock).await
    }

    /// Loads the scenario's aircraft if the simulator has another one. One that does not say which it has is left alone.
    async fn load_aircraft(&mut self) -> Result<(), BridgeError> {
        let Some(file) = self.aircraft_file() else {
            return Ok(());
        };
        let found = self.loaded_icao(Duration::from_secs(1)).await?;
        if found.is_empty() || found == file.icao {
            return Ok(());
        }
        tracing::info!(found, path = file.path, "another aircraft is loaded");
        let deadline = Instant::now() + LOAD_TIMEOUT;
        for _ in 0..ATTEMPTS {
            self.udp
                .load_aircraft(LoadAircraft {
                    plane: 0,
                    path: file.path.into(),
                    livery: 0,
                })
                .await?;
            let share = LOAD_TIMEOUT / ATTEMPTS;
            let until = deadline.min(Instant::now() + share);
            while Instant::now() < until {
                if self.loaded_icao(Duration::from_secs(1)).await? == file.icao {
                    return Ok(());
                }
            }
        }
        Err(BridgeError::Refused {
            doing: "another aircraft (ACFN)",
            text: format!(
                "{} is not loaded, but {found}; load it in X-Plane",
                file.path
            ),
        })
    }

    /// Type of the aircraft that is loaded; empty if the simulator does not say.
    async fn loaded_icao(&mut self, timeout: Duration) -> Result<String, BridgeError> {
        let names: Vec<String> = (0..4).map(|i| format!("{AIRCRAFT_ICAO}[{i}]")).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let all = |values: &[Option<f32>]| values.iter().all(Option::is_some);
        let values = self
            .udp
            .read_until(&names, Instant::now() + timeout, all)
            .await?;
        Ok(values
            .into_iter()
            .flatten()
            .map(|value| value as u8)
            .filter(u8::is_ascii_alphanumeric)
            .map(char::from)
            .collect())
    }

    async fn place_by_udp(&mut self, start: &FlightStart) -> Result<(), BridgeError> {
        let wanted = start.position.lat_lon();
        let is_there = |found: &Position| {
            let found = Geodetic {
                latitude_deg: found.latitude_deg,
                longitude_deg: found.longitude_deg,
                altitude_msl_m: found.elevation_msl_m,
            };
            found.lat_lon().distance_m(wanted) < PLACED_WITHIN_M
        };
        let mut found = None;
        for _ in 0..ATTEMPTS {
            self.udp.place_at_start(at_position(start)).await?;
            let deadline = Instant::now() + PLACE_TIMEOUT;
            found = self.udp.position_until(deadline, is_there).await?;
            if found.as_ref().is_some_and(is_there) {
                return Ok(());
            }
        }
        Err(BridgeError::NotPlaced {
            attempts: ATTEMPTS,
            wanted_latitude_deg: wanted.latitude_deg,
            wanted_longitude_deg: wanted.longitude_deg,
            found: found.map(|found| (found.latitude_deg, found.longitude_deg)),
        })
    }

    fn aircraft_file(&self) -> Option<AircraftFile> {
        let generation: Generation = self.generation;
        self.aircraft
            .as_deref()
            .and_then(|name| aircraft_file(name, generation))
    }
}

fn at_position(start: &FlightStart) -> PlaceAtStart {
    PlaceAtStart {
        start_type: START_AT_POSITION,
        plane: 0,
        airport: String::new(),
        runway: 0,
        runway_end: 0,
        latitude_deg: start.position.latitude_deg,
        longitude_deg: start.position.longitude_deg,
        elevation_msl_m: start.position.altitude_msl_m,
        heading_true_deg: start.heading_true_deg,
        speed_mps: start.speed_mps,
    }
}
