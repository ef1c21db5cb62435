//! Starting a flight: X-Plane's "Flight Initialization API", limited to starts in the air.
//!
//! Strict like X-Plane: no unknown key, no missing key of the weather. One trap is included as well: an integer
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

use super::super::world::flight_start::FlightStart;
use super::WebApiService;
use super::flight_form::{AirStart, CloudWord, Envelope, SetWeather, TimeOfYear};
use super::refusal::Refusal;
use crate::quirks::Quirk;

/// Keys with integer values.
const WHOLE_NUMBERS: [&str; 2] = ["day_of_year", "index"];
const SECONDS_PER_HOUR: f64 = 3_600.0;
const PASCAL_PER_HECTOPASCAL: f64 = 100.0;
const METERS_PER_KILOMETER: f64 = 1_000.0;

pub(super) async fn start(
    State(service): State<Arc<WebApiService>>,
    Json(body): Json<Value>,
) -> Result<Response, Refusal> {
    let answer = service.fly(&body)?;
    if service.world.lock().quirks.has(Quirk::DroppedStart) {
        return Ok(Response::new(Body::new(BrokenOff)));
    }
    Ok(answer.into_response())
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
    fn fly(&self, body: &Value) -> Result<Json<Value>, Refusal> {
        let success = Ok(Json(json!({ "error_code": "success" })));
        let start = flight_start(body)?;
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

/// Finds the first key with an integer in place of a float.
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

fn flight_start(body: &Value) -> Result<FlightStart, Refusal> {
    let Envelope { data } =
        serde_json::from_value(body.clone()).map_err(|error| invalid(error.to_string()))?;
    let AirStart {
        latitude,
        longitude,
        elevation_in_meters,
        heading_true,
        speed_in_meters_per_second,
        pitch_in_degrees,
    } = data.lle_air_start;
    let TimeOfYear {
        day_of_year,
        time_in_24_hours,
    } = data.gmt_time;
    if day_of_year > 365 || !(0.0..24.0).contains(&time_in_24_hours) {
        return Err(invalid(format!(
            "there is no such time: day {day_of_year}, {time_in_24_hours} h"
        )));
    }
    Ok(FlightStart {
        aircraft: Some(data.aircraft.path),
        pose: Pose {
            latitude_deg: latitude,
            longitude_deg: longitude,
            altitude_msl_m: elevation_in_meters,
            heading_true_deg: heading_true,
            pitch_deg: pitch_in_degrees,
            roll_deg: 0.0,
        },
        speed_mps: speed_in_meters_per_second,
        // X-Plane has no leap day.
        zulu: Some((day_of_year.min(364), time_in_24_hours * SECONDS_PER_HOUR)),
        weather: weather(&data.weather)?,
    })
}

/// The datarefs that this weather sets.
fn weather(set: &SetWeather) -> Result<Vec<(String, f64)>, Refusal> {
    let SetWeather { definition, .. } = set;
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
