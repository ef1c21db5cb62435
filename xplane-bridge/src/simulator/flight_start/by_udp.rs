//! Starting a flight without a plugin: `PREL` places the aircraft, and no other packet is sent until X-Plane has loaded the flight.

use std::time::Duration;

use tokio::time::Instant;

use super::{ATTEMPTS, READY_TIMEOUT, START_TIMEOUT, lat_lon, not_placed};
use crate::datarefs::SCENERY_LOADING;
use crate::error::BridgeError;
use crate::fly::FlightStart;
use crate::packet::{PlaceAtStart, Position, ToSimulator};
use crate::simulator::Simulator;

/// Kind of `PREL` that starts at latitude, longitude and elevation.
const START_AT_POSITION: i32 = 6;
/// Time for a position to follow a `PREL`.
const PLACE_TIMEOUT: Duration = Duration::from_millis(500);
/// A placed aircraft is found this close to its place: it flies on while the answer travels.
const PLACED_WITHIN_M: f64 = 2_000.0;
/// Number of consecutive readings without loading, and the time between them: the flag rises a moment after the flight has started.
const QUIET_READINGS: u32 = 3;
const QUIET_PAUSE: Duration = Duration::from_millis(500);

impl Simulator {
    /// Places the aircraft at a start.
    pub(super) async fn place_by_udp(&mut self, start: &FlightStart) -> Result<(), BridgeError> {
        let wanted = start.position.lat_lon();
        let is_there = |found: &Position| lat_lon(found).distance_m(wanted) < PLACED_WITHIN_M;
        let (mut found, mut attempts) = (None, 0);
        while attempts < ATTEMPTS {
            attempts += 1;
            self.udp
                .send(&ToSimulator::PlaceAtStart(at_position(start)))
                .await?;
            let deadline = Instant::now() + PLACE_TIMEOUT;
            found = self.udp.position_until(deadline, is_there).await?;
            if !found.as_ref().is_some_and(is_there) && !self.description.replayed {
                // X-Plane is silent while it loads, and a second request would make it load again.
                let deadline = Instant::now() + START_TIMEOUT;
                found = self.udp.position_until(deadline, |_| true).await?;
            }
            match &found {
                Some(found) if is_there(found) => return Ok(()),
                Some(_) => {}
                None => break,
            }
        }
        let found = found.as_ref().map(lat_lon);
        Err(not_placed(wanted, "PREL", attempts, found))
    }

    /// Waits until X-Plane has loaded the flight. While it loads it does not answer, and requests sent meanwhile are executed later, or not
    /// at all. A plugin waits itself before it answers.
    pub(super) async fn await_loading(&mut self) -> Result<(), BridgeError> {
        if self.description.replayed {
            return Ok(());
        }
        let began = Instant::now();
        let mut heard = began;
        let mut quiet = 0;
        while quiet < QUIET_READINGS {
            match self.read_soon(SCENERY_LOADING).await? {
                Some(loading) => {
                    heard = Instant::now();
                    quiet = if loading == 0.0 { quiet + 1 } else { 0 };
                }
                None => quiet = 0,
            }
            if quiet < QUIET_READINGS && began.elapsed() >= START_TIMEOUT {
                return Err(self.still_loading(began, heard));
            }
            self.pause_for_weather(QUIET_PAUSE).await;
        }
        Ok(())
    }

    fn still_loading(&self, began: Instant, heard: Instant) -> BridgeError {
        if heard.elapsed() < READY_TIMEOUT * 2 {
            BridgeError::Failed(format!(
                "X-Plane has been loading scenery for {:.0?} (dataref {SCENERY_LOADING} is not 0). Look for a message in X-Plane, start any \
                 flight, and run the same command again",
                began.elapsed()
            ))
        } else {
            self.silent(heard.elapsed())
        }
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
