//! Starting a flight: this module alone decides, and logs, how the aircraft is placed.
//!
//! The best way is X-Plane 12.4's Web API, which takes aircraft, place, speed, time and weather together and answers. Without it,
//! our plugin places the aircraft. If no plugin serves the capture link, the UDP packet `PREL` does, and `RPOS` shows whether it worked; no
//! other packet is sent until X-Plane has loaded the flight. A start is requested once: X-Plane closes the connection of starts that
//! succeed, and a second one would restart the flight.

mod by_udp;

use std::time::Duration;

use airframe::AircraftType;
use dataset::conditions::Conditions;
use dataset::geometry::geodesy::LatLon;
use futures_util::future::LocalBoxFuture;
use tokio::time::{Instant, sleep};

use super::Simulator;
use crate::datarefs::{
    AIRCRAFT_ICAO, AIRCRAFT_LENGTH_M, AIRCRAFT_WIDTH_M, AircraftFile, COMMAND_TOGGLE_MAIN_MENU,
    FLIGHT_TIME_S, aircraft_file, icao_of,
};
use crate::error::BridgeError;
use crate::fly::FlightStart;
use crate::link::{Answer, Request};
use crate::packet::{LoadAircraft, Position, ToSimulator};
use crate::web_api::{AirStart, WebApi, WebApiError, flight_body};

/// The bundled simulator's name for itself.
const STAND_IN: &str = "mock-xplane";
/// Attempts of `PREL` and `ACFN`.
const ATTEMPTS: u32 = 8;
/// Maximum distance from its start at which an aircraft counts as started: X-Plane does not answer for a minute or two while it starts the
/// flight.
const BEGUN_WITHIN_M: f64 = 12_000.0;
/// Distance from the place of the images beyond which the aircraft must travel: scenery and weather follow it.
const NEAR_M: f64 = 30_000.0;
/// Maximum time for X-Plane to load an aircraft.
const LOAD_TIMEOUT: Duration = Duration::from_secs(60);
/// Timeout for a flight to begin.
const START_TIMEOUT: Duration = Duration::from_secs(180);
/// Timeout of the plugin's travel: to start, and for the scenery to load.
const TRAVEL_TIMEOUT: Duration = Duration::from_secs(150);
/// Timeout for simulated time to move, and for a position to arrive.
const READY_TIMEOUT: Duration = Duration::from_secs(5);
/// Accepted ratio of X-Plane's approximate aircraft size to the type's.
const SIZE_RATIOS: std::ops::RangeInclusive<f64> = 0.4..=1.6;

impl Simulator {
    /// Ensures that a flight is loaded, with the scenario's aircraft, where its images are taken or its approach starts, with the scenery
    /// there. A live flight begins there; for a recorded one the aircraft only travels if it is far away or of the wrong type.
    ///
    /// # Errors
    /// [`BridgeError::NotReady`] if a menu is open, [`BridgeError::Setup`] if another aircraft is loaded, or any other reason that prevents
    /// the flight from starting.
    pub fn prepare<'a>(
        &'a mut self,
        conditions: &'a Conditions,
        start: &'a FlightStart,
        live: bool,
    ) -> LocalBoxFuture<'a, Result<(), BridgeError>> {
        Box::pin(async move {
            self.await_flight().await?;
            let near = match self.position().await? {
                Some(here) => here.distance_m(start.position.lat_lon()) < NEAR_M,
                None => false,
            };
            if live || !near || self.other_aircraft().await?.is_some() {
                let in_the_air = self.begin_flight(start, Some(conditions)).await?;
                self.begun = Some((*start, in_the_air));
            }
            self.check_aircraft().await
        })
    }

    /// Waits until simulated time moves: in a menu it does not, whatever X-Plane answers.
    async fn await_flight(&mut self) -> Result<(), BridgeError> {
        if self.description.replayed {
            // A tape has no menu, and its times stand still after the last record.
            return Ok(());
        }
        for menu_was_toggled in [false, true] {
            self.resume().await?;
            let first_s = self.read_soon(FLIGHT_TIME_S).await?;
            let moves = |now_s: f32| first_s.is_some_and(|first_s| now_s > first_s);
            let read = self.udp.read_one(FLIGHT_TIME_S, READY_TIMEOUT, moves);
            let now_s = read.await?;
            if now_s.is_some_and(moves) {
                return Ok(());
            }
            // Silence does not mean a menu: X-Plane hangs for seconds while it loads.
            if first_s.is_none() || now_s.is_none() {
                return Err(self.silent(READY_TIMEOUT * 2));
            }
            if !menu_was_toggled {
                tracing::warn!("simulated time stands still: leaving the menu, if it is one");
                self.command_once(COMMAND_TOGGLE_MAIN_MENU).await?;
            }
        }
        Err(BridgeError::NotReady(format!(
            "no flight is on at {}: simulated time did not move for {:.1} s, twice, and toggling the main menu did not help. Is Flight \
             Configuration, a menu or a question open in X-Plane? Start any flight, and run the same command again",
            self.address,
            READY_TIMEOUT.as_secs_f64()
        )))
    }

    async fn read_soon(&self, name: &str) -> Result<Option<f32>, BridgeError> {
        self.udp.read_one(name, READY_TIMEOUT, |_| true).await
    }

    /// Position of the aircraft; `None` if X-Plane does not report a plausible one.
    async fn position(&mut self) -> Result<Option<LatLon>, BridgeError> {
        let plausible = |found: &Position| found.latitude_deg != 0.0 || found.longitude_deg != 0.0;
        let deadline = Instant::now() + READY_TIMEOUT;
        let found = self.udp.position_until(deadline, plausible).await?;
        Ok(found.filter(plausible).as_ref().map(lat_lon))
    }

    /// Starts a flight, once. Returns true if the aircraft is then in the air, false if it must be placed there before it is flown. A
    /// plugin holds it there afterwards.
    pub(super) async fn begin_flight(
        &mut self,
        start: &FlightStart,
        conditions: Option<&Conditions>,
    ) -> Result<bool, BridgeError> {
        let has_flights = self.web_api.as_ref().is_some_and(WebApi::has_flights);
        let by_web_api = conditions.filter(|_| has_flights && self.aircraft_file().is_some());
        tracing::info!(
            by_web_api = by_web_api.is_some(),
            plugin = self.description.plugin,
            "a flight begins"
        );
        let mut already_started = false;
        if let Some(conditions) = by_web_api {
            match self.start_by_web_api(start, conditions).await {
                Ok(()) => already_started = true,
                // Rejected: no flight has started.
                Err(BridgeError::WebApi(error)) => {
                    tracing::warn!(%error, "the flight is begun without the Web API");
                }
                Err(error) => return Err(error),
            }
        }
        if !already_started {
            self.load_aircraft().await?;
        }
        if self.description.plugin.is_some() {
            self.travel(start, already_started).await?;
            return Ok(true);
        }
        if !already_started {
            self.place_by_udp(start).await?;
        }
        self.await_loading().await?;
        Ok(already_started)
    }

    async fn travel(
        &mut self,
        start: &FlightStart,
        already_started: bool,
    ) -> Result<(), BridgeError> {
        let request = Request::Travel {
            start: *start,
            already_started,
        };
        self.link
            .tell("travelling", &request, TRAVEL_TIMEOUT, &Answer::Arrived)
            .await
    }

    async fn start_by_web_api(
        &mut self,
        start: &FlightStart,
        conditions: &Conditions,
    ) -> Result<(), BridgeError> {
        let (Some(api), Some(file)) = (&self.web_api, self.aircraft_file()) else {
            return Ok(());
        };
        let air_start = AirStart {
            start: *start,
            pitch_deg: 0.0,
        };
        let body = flight_body(&file.path, &air_start, conditions)?;
        let before_s = self.read_soon(FLIGHT_TIME_S).await?.unwrap_or(f32::MAX);
        let asked = Instant::now();
        match api.start_flight(&body).await {
            Ok(()) => {}
            Err(error @ WebApiError::NotReached { .. }) => {
                tracing::warn!(%error, "whether the flight begins is seen by where the aircraft is");
            }
            Err(error) => return Err(error.into()),
        }
        let wanted = start.position.lat_lon();
        loop {
            let here = self.position().await?;
            let flight_s = self.read_soon(FLIGHT_TIME_S).await?;
            let is_there = here.is_some_and(|here| here.distance_m(wanted) < BEGUN_WITHIN_M);
            let has_begun = flight_s
                .is_some_and(|now_s| now_s < before_s || now_s <= asked.elapsed().as_secs_f32());
            if is_there && has_begun {
                return self.hold_aircraft().await;
            }
            if asked.elapsed() >= START_TIMEOUT {
                return Err(not_placed(wanted, "the Web API", 1, here));
            }
            sleep(Duration::from_millis(500)).await;
        }
    }

    /// The scenario's aircraft, and the type that is loaded instead of it. An unknown one, or a simulator that does not report it, is
    /// accepted.
    async fn other_aircraft(&mut self) -> Result<Option<(AircraftFile, String)>, BridgeError> {
        let Some(file) = self.aircraft_file() else {
            return Ok(None);
        };
        let found = self.loaded_icao().await?;
        Ok((!found.is_empty() && found != file.icao).then_some((file, found)))
    }

    async fn check_aircraft(&mut self) -> Result<(), BridgeError> {
        let Some(file) = self.aircraft_file() else {
            return Ok(());
        };
        if let Some((file, found)) = self.other_aircraft().await? {
            return Err(wrong_aircraft(&file, &found));
        }
        for (name, size_m) in [
            (AIRCRAFT_WIDTH_M, file.size_m.0),
            (AIRCRAFT_LENGTH_M, file.size_m.1),
        ] {
            let found_m = self.read_soon(name).await?.map_or(0.0, f64::from);
            // X-Plane reads 0 for an unknown name.
            if found_m != 0.0 && !SIZE_RATIOS.contains(&(found_m / size_m)) {
                return Err(BridgeError::Setup(format!(
                    "the aircraft that is loaded says that it is a {}, but is {found_m:.1} m large ({name}), expected about {size_m:.1} m: \
                     ground-truth boxes would not fit it. Load {} in X-Plane, and run the same command again",
                    file.icao, file.path
                )));
            }
        }
        Ok(())
    }

    /// Loads the scenario's aircraft if the simulator has a different one. A simulator that does not report its aircraft is left alone.
    async fn load_aircraft(&mut self) -> Result<(), BridgeError> {
        let Some((file, found)) = self.other_aircraft().await? else {
            return Ok(());
        };
        tracing::info!(
            found,
            path = file.path.as_str(),
            "another aircraft is loaded"
        );
        let deadline = Instant::now() + LOAD_TIMEOUT;
        for _ in 0..ATTEMPTS {
            self.udp
                .send(&ToSimulator::LoadAircraft(LoadAircraft {
                    plane: 0,
                    path: file.path.clone(),
                    livery: 0,
                }))
                .await?;
            let until = Instant::now() + LOAD_TIMEOUT / ATTEMPTS;
            let mut now_loaded = found.clone();
            // X-Plane is silent while it loads, and a second request would make it load again.
            while Instant::now() < deadline && (Instant::now() < until || now_loaded.is_empty()) {
                now_loaded = self.loaded_icao().await?;
                if now_loaded == file.icao {
                    return Ok(());
                }
            }
        }
        Err(wrong_aircraft(&file, &found))
    }

    /// Type of the loaded aircraft; empty if the simulator does not report it.
    async fn loaded_icao(&mut self) -> Result<String, BridgeError> {
        let names = [0, 1, 2, 3].map(|at| format!("{AIRCRAFT_ICAO}[{at}]"));
        let names = names.each_ref().map(String::as_str);
        let values = self.udp.read_all(&names, Duration::from_secs(1)).await?;
        Ok(icao_of(&values))
    }

    /// Checks that types can be drawn here, before anything is flown: X-Plane brings few of them along.
    ///
    /// # Errors
    /// [`BridgeError::Setup`] with the first type that cannot.
    pub fn check_aircraft_types<'a>(
        &self,
        mut names: impl Iterator<Item = &'a str>,
    ) -> Result<(), BridgeError> {
        if self.description.replayed {
            return Ok(());
        }
        let has = |name: &str| self.file_of(name).is_some();
        match names.find(|name| !has(name)) {
            None => Ok(()),
            Some(lacking) => {
                let all = AircraftType::all().iter().map(|of| of.name.as_str());
                let there: Vec<&str> = all.filter(|name| has(name)).collect();
                Err(BridgeError::Setup(format!(
                    "the sweep's aircraft {lacking} does not come with this X-Plane, which has {}: choose one of these in the sweep, or \
                     record with the bundled simulator",
                    there.join(", ")
                )))
            }
        }
    }

    /// The file of an aircraft, by its name in sweeps.
    fn file_of(&self, name: &str) -> Option<AircraftFile> {
        let is_stand_in = self.description.name == STAND_IN;
        aircraft_file(name, self.generation, is_stand_in)
    }

    fn aircraft_file(&self) -> Option<AircraftFile> {
        self.file_of(self.aircraft.as_deref()?)
    }
}

fn lat_lon(position: &Position) -> LatLon {
    LatLon {
        latitude_deg: position.latitude_deg,
        longitude_deg: position.longitude_deg,
    }
}

/// An aircraft that is not where a flight should begin.
fn not_placed(wanted: LatLon, by: &str, attempts: u32, found: Option<LatLon>) -> BridgeError {
    let text = |place: LatLon| format!("{:.4}, {:.4}", place.latitude_deg, place.longitude_deg);
    let found = match found {
        Some(place) => format!("is at {}", text(place)),
        None => "its position never came (RPOS)".to_owned(),
    };
    BridgeError::NotReady(format!(
        "the aircraft was put to {} {attempts} times ({by}), but {found}",
        text(wanted)
    ))
}

fn wrong_aircraft(file: &AircraftFile, found: &str) -> BridgeError {
    BridgeError::Setup(format!(
        "the aircraft that is loaded is {found}, expected {} ({}): load it in X-Plane, and run the same command again",
        file.icao, file.path
    ))
}
