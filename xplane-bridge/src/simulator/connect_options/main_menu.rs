//! An X-Plane that is in its main menu, where no plugin runs: a flight is started through its Web API (12.4).

use std::net::SocketAddr;

use dataset::conditions::{Clock, Conditions, Weather};
use dataset::geometry::geodesy::Geodetic;

use super::find_web_api::{self, NotUsed};
use crate::datarefs::{Generation, aircraft_file};
use crate::fly::FlightStart;
use crate::web_api::{AirStart, WebApi, WebApiError, flight_body};

/// The aircraft that every X-Plane has.
const AIRCRAFT: &str = "B737-800";
/// Any place in the air, by day: the first scenario moves the aircraft, and sets time and weather.
const ANYWHERE: FlightStart = FlightStart {
    position: Geodetic {
        latitude_deg: 1.3,
        longitude_deg: 104.0,
        altitude_msl_m: 2_000.0,
    },
    heading_true_deg: 23.0,
    speed_mps: 120.0,
};

/// Outcome of an attempt to leave the main menu.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Left {
    /// A flight may begin now.
    Begun,
    /// X-Plane refused to start one.
    Refused,
    /// Nothing there says that the menu shows.
    NoMenu,
}

/// Starts a flight if the Web API there says that none is loaded.
pub(crate) async fn leave(web_api: SocketAddr) -> Left {
    // No port: in the menu there is no plugin that could have reported one.
    match find_web_api::find(web_api, 0).await {
        Err(NotUsed::NoFlight { .. }) => {}
        _ => return Left::NoMenu,
    }
    tracing::info!(%web_api, "X-Plane shows its main menu, in which no plugin runs: starting a flight");
    match start(web_api).await {
        Ok(()) => Left::Begun,
        // X-Plane closes the connection of a flight that it starts.
        Err(WebApiError::NotReached { .. }) => Left::Begun,
        Err(error) => {
            tracing::warn!(%error, "no flight could be started from X-Plane's main menu: start any flight there");
            Left::Refused
        }
    }
}

async fn start(web_api: SocketAddr) -> Result<(), WebApiError> {
    let api = WebApi::connect(web_api, find_web_api::TIMEOUT).await?;
    let conditions = Conditions {
        time_of_day: "12:00".into(),
        clock: Clock {
            day_of_year: 172,
            zulu_time_s: 4.0 * 3_600.0,
        },
        weather_name: "clear".into(),
        weather: Weather {
            visibility_m: 30_000.0,
            clouds: Vec::new(),
            rain_ratio: 0.0,
            wind_speed_mps: 0.0,
            wind_from_true_deg: 0.0,
            turbulence_ratio: 0.0,
        },
    };
    let air_start = AirStart {
        start: ANYWHERE,
        pitch_deg: 0.0,
    };
    let path = aircraft_file(AIRCRAFT, Generation::XPlane12, false).map(|file| file.path);
    let body = flight_body(&path.unwrap_or_default(), &air_start, &conditions);
    let body = body.map_err(|error| WebApiError::WrongAnswer(error.to_string()))?;
    api.start_flight(&body).await
}
