//! Starting and changing a flight: X-Plane's "Flight Initialization API".
//!
//! Strict like X-Plane: exactly one start, no unknown key, no missing key of the weather. One trap is included as well: an integer
//! where X-Plane expects a float makes it ignore the request while it reports success.

use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};

use axum::Json;
use axum::body::{Body, Bytes};
use axum::extract::State;
use axum::response::{IntoResponse, Response};
use dataset::conditions::{Clock, CloudKind, CloudLayer, Conditions, Weather};
use dataset::geometry::pose::Pose;
use dataset::numbers::units::{METERS_PER_FOOT, MPS_PER_KNOT};
use hyper::body::Frame;
use serde_json::{Value, json};
use xplane_bridge::datarefs::{self as names, Generation};

use super::super::world::airport::{self, CODE, ON_THRESHOLD, RUNWAY};
use super::super::world::flight_start::{FlightStart, StartTime};
use super::WebApiService;
use super::flight_form::{
    CloudWord, Envelope, Flight, SetWeather, SpeedWord, TimeOfYear, WeatherChoice,
};
use super::refusal::Refusal;
use crate::quirks::Quirk;

/// Keys with integer values.
const WHOLE_NUMBERS: [&str; 2] = ["day_of_year", "index"];
const SECONDS_PER_HOUR: f64 = 3_600.0;
const PASCAL_PER_HECTOPASCAL: f64 = 100.0;
const METERS_PER_KILOMETER: f64 = 1_000.0;

/// Start or change of a flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Occasion {
    New,
    Update,
}

pub(super) async fn start(
    State(service): State<Arc<WebApiService>>,
    Json(body): Json<Value>,
) -> Result<Response, Refusal> {
    let answer = service.fly(&body, Occasion::New)?;
    if service.world.lock().quirks().has(Quirk::DroppedStart) {
        return Ok(Response::new(Body::new(BrokenOff)));
    }
    Ok(answer.into_response())
}

pub(super) async fn update(
    State(service): State<Arc<WebApiService>>,
    Json(body): Json<Value>,
) -> Result<Json<Value>, Refusal> {
    service.fly(&body, Occasion::Update)
}

/// An answer whose connection ends before it has begun.
struct BrokenOff;

impl hyper::body::Body for BrokenOff {
    type Data = Bytes;
    type Error = io::Error;

    fn poll_frame(
        self: Pin<&mut Self>,
        _: &mut Context<'_>,
    ) -> Poll<Option<io::Result<Frame<Bytes>>>> {
        Poll::Ready(Some(Err(io::ErrorKind::ConnectionReset.into())))
    }
}

impl WebApiService {
    fn fly(&self, body: &Value, occasion: Occasion) -> Result<Json<Value>, Refusal> {
        let success = Ok(Json(json!({ "error_code": "success" })));
        let start = flight_start(body, occasion)?;
        if let Some(key) = whole_number_for_float(body) {
            tracing::warn!(
                key,
                "flight ignored: a whole number where a float is expected"
            );
            return success;
        }
        let begun = self.world.lock().begin(&start);
        begun.map_err(|(path, reason)| invalid(format!("{path}: {reason}")))?;
        success
    }
}

fn invalid(message: impl Into<String>) -> Refusal {
    Refusal::bad_request("invalid_flight", message)
}

/// The first key with an integer in place of a float.
fn whole_number_for_float(value: &Value) -> Option<&str> {
    fn found<'a>(key: &'a str, value: &'a Value) -> Option<&'a str> {
        match value {
            Value::Number(number) => {
                (!number.is_f64() && !WHOLE_NUMBERS.contains(&key)).then_some(key)
            }
            Value::Array(list) => list.iter().find_map(|element| found(key, element)),
            Value::Object(map) => map.iter().find_map(|(key, value)| found(key, value)),
            _ => None,
        }
    }
    found("data", value)
}

/// Content of a request.
fn flight_start(body: &Value, occasion: Occasion) -> Result<FlightStart, Refusal> {
    let Envelope { data } =
        serde_json::from_value(body.clone()).map_err(|error| invalid(error.to_string()))?;
    let place = place(&data)?;
    match occasion {
        Occasion::New if place.is_none() || data.aircraft.is_none() => {
            return Err(invalid("a new flight needs an aircraft and a start"));
        }
        Occasion::Update if place.is_some() || data.aircraft.is_some() => {
            return Err(invalid("an update cannot change aircraft or start"));
        }
        _ => {}
    }
    Ok(FlightStart {
        aircraft: data.aircraft.as_ref().map(|aircraft| aircraft.path.clone()),
        place,
        time: time(&data)?,
        weather: data.weather.as_ref().map_or(Ok(Vec::new()), weather)?,
    })
}

fn place(flight: &Flight) -> Result<Option<(Pose, f64)>, Refusal> {
    let starts = [
        flight.runway_start.is_some(),
        flight.ramp_start.is_some(),
        flight.lle_ground_start.is_some(),
        flight.lle_air_start.is_some(),
        flight.boat_start.is_some(),
    ];
    if starts.into_iter().filter(|&given| given).count() > 1 {
        return Err(invalid("more than one start is given"));
    }
    let unknown = |airport: &str| invalid(format!("airport {airport} is not known, only {CODE}"));
    if let Some(start) = &flight.runway_start {
        if start.airport_id != CODE {
            return Err(unknown(&start.airport_id));
        }
        if start.runway != RUNWAY {
            let message = format!("{CODE} has no runway {}, only {RUNWAY}", start.runway);
            return Err(invalid(message));
        }
        return Ok(Some(match start.final_distance_in_nautical_miles {
            None => (ON_THRESHOLD, 0.0),
            Some(distance_nm) => (airport::on_final(distance_nm), airport::APPROACH_SPEED_MPS),
        }));
    }
    if let Some(start) = &flight.ramp_start {
        if start.airport_id != CODE {
            return Err(unknown(&start.airport_id));
        }
        return Ok(Some((ON_THRESHOLD, 0.0)));
    }
    if let Some(start) = &flight.lle_ground_start {
        let pose = Pose {
            latitude_deg: start.latitude,
            longitude_deg: start.longitude,
            heading_true_deg: start.heading_true,
            ..ON_THRESHOLD
        };
        return Ok(Some((pose, 0.0)));
    }
    if flight.boat_start.is_some() {
        return Err(invalid("there are no boats here"));
    }
    let Some(start) = &flight.lle_air_start else {
        return Ok(None);
    };
    let speed_mps = match (start.speed_in_meters_per_second, start.speed_enum) {
        (Some(speed_mps), None) => speed_mps,
        (None, Some(SpeedWord::ShortFieldApproach)) => 65.0,
        (None, Some(SpeedWord::NormalApproach)) => airport::APPROACH_SPEED_MPS,
        (None, Some(SpeedWord::Cruise)) => 230.0,
        _ => return Err(invalid("an air start needs exactly one of the two speeds")),
    };
    let pose = Pose {
        latitude_deg: start.latitude,
        longitude_deg: start.longitude,
        altitude_msl_m: start.elevation_in_meters,
        heading_true_deg: start.heading_true,
        pitch_deg: start.pitch_in_degrees,
        roll_deg: 0.0,
    };
    Ok(Some((pose, speed_mps)))
}

fn time(flight: &Flight) -> Result<Option<StartTime>, Refusal> {
    let checked = |time: &TimeOfYear| {
        let hours = time.time_in_24_hours;
        if time.day_of_year > 365 || !(0.0..24.0).contains(&hours) {
            return Err(invalid(format!("there is no such time: {time:?}")));
        }
        // X-Plane has no leap day.
        Ok((time.day_of_year.min(364), hours * SECONDS_PER_HOUR))
    };
    match (
        &flight.use_system_time,
        &flight.local_time,
        &flight.gmt_time,
    ) {
        (None | Some(false), None, None) => Ok(None),
        (Some(true), None, None) => Ok(Some(StartTime::System)),
        (None, Some(time), None) => {
            let (day, time_s) = checked(time)?;
            Ok(Some(StartTime::Local { day, time_s }))
        }
        (None, None, Some(time)) => {
            let (day, time_s) = checked(time)?;
            Ok(Some(StartTime::Zulu { day, time_s }))
        }
        _ => Err(invalid("more than one time is given")),
    }
}

/// The datarefs that this weather sets.
fn weather(choice: &WeatherChoice) -> Result<Vec<(String, f64)>, Refusal> {
    let value = match choice {
        WeatherChoice::Real(word) if word == "use_real_weather" => {
            return Err(invalid("the stand-in has no real weather"));
        }
        WeatherChoice::Real(word) => return Err(invalid(format!("there is no weather {word:?}"))),
        WeatherChoice::Set(value) => value,
    };
    let set: SetWeather = serde_json::from_value(value.clone())
        .map_err(|error| invalid(format!("weather: {error}")))?;
    let SetWeather { definition, .. } = &set;
    let lowest = definition
        .wind
        .iter()
        .min_by(|a, b| a.altitude_in_feet_msl.total_cmp(&b.altitude_in_feet_msl));
    let clouds = definition.clouds.iter().map(|cloud| CloudLayer {
        kind: match cloud.kind {
            CloudWord::Cirrus => CloudKind::Cirrus,
            CloudWord::Stratus => CloudKind::Stratus,
            CloudWord::Cumulus => CloudKind::Cumulus,
            CloudWord::Cumulonimbus => CloudKind::Cumulonimbus,
        },
        cover_ratio: cloud.cover_ratio,
        base_msl_m: cloud.bases_in_feet_msl * METERS_PER_FOOT,
        top_msl_m: cloud.tops_in_feet_msl * METERS_PER_FOOT,
    });
    let conditions = Conditions {
        time_of_day: String::new(),
        clock: Clock {
            day_of_year: 1,
            zulu_time_s: 0.0,
        },
        weather_name: String::new(),
        weather: Weather {
            visibility_m: definition.visibility_in_kilometers * METERS_PER_KILOMETER,
            clouds: clouds.collect(),
            rain_ratio: definition.precipitation_ratio,
            wind_speed_mps: lowest.map_or(0.0, |wind| wind.speed_in_knots * MPS_PER_KNOT),
            wind_from_true_deg: lowest.map_or(0.0, |wind| wind.direction_in_degrees_true),
            turbulence_ratio: lowest.map_or(0.0, |wind| wind.turbulence_ratio),
        },
    };
    let writes = names::condition_writes(&conditions, Generation::XPlane12)
        .map_err(|error| invalid(format!("weather: {error}")))?;
    let of_weather = writes
        .into_iter()
        .filter(|write| write.name.starts_with("sim/weather/"))
        .map(|write| (write.name, f64::from(write.value)));
    let mut writes: Vec<_> = of_weather.collect();
    let feet_per_minute = METERS_PER_FOOT / 60.0;
    let thermals = set.vertical_speed_in_thermal_in_feet_per_minute * feet_per_minute;
    writes.push((names::THERMALS.into(), thermals));
    let variability = set.variation_across_region_percentage / 100.0;
    writes.push((names::VARIABILITY.into(), variability));
    if let Some(temperature_c) = definition.temperature_in_degrees_celsius {
        writes.push((names::TEMPERATURE_C.into(), temperature_c));
    }
    if let Some(pressure_hpa) = definition.altimeter_setting_in_hpa {
        let pressure_pa = pressure_hpa * PASCAL_PER_HECTOPASCAL;
        writes.push((names::PRESSURE_PA.into(), pressure_pa));
    }
    Ok(writes)
}
