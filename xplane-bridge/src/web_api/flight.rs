//! Request body that starts a flight in X-Plane 12.4: aircraft, start in the air, time, weather.
//!
//! Pure. Handles X-Plane's traps: every key of the weather is present, since a flight does not start otherwise; every number that X-Plane
//! reads as a float is written as one (`10.0`, never `10`), since an integer is silently rejected; units are feet, knots and kilometres.

use dataset::conditions::{Clock, CloudKind, CloudLayer, Conditions, Weather};
use dataset::numbers::units::{METERS_PER_FOOT, MPS_PER_KNOT};
use serde_json::{Value, json};

use crate::datarefs::{
    BadConditions, STANDARD_PRESSURE_PA, STANDARD_TEMPERATURE_C, WIND_ALTITUDES_MSL_M,
    check_cloud_layers,
};
use crate::fly::FlightStart;

/// A start in the air.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AirStart {
    /// Position and speed.
    pub start: FlightStart,
    /// Pitch, degrees, nose up positive.
    pub pitch_deg: f64,
}

/// Flight body for the aircraft in the file `aircraft_path` (below X-Plane's folder), in these conditions.
///
/// # Errors
/// For more cloud layers than X-Plane has, or a NaN.
pub(crate) fn flight_body(
    aircraft_path: &str,
    AirStart { start, pitch_deg }: &AirStart,
    conditions: &Conditions,
) -> Result<Value, BadConditions> {
    let position = &start.position;
    let body = json!({
        "aircraft": { "path": aircraft_path },
        "lle_air_start": {
            "latitude": position.latitude_deg,
            "longitude": position.longitude_deg,
            "elevation_in_meters": position.altitude_msl_m,
            "heading_true": start.heading_true_deg,
            "speed_in_meters_per_second": start.speed_mps,
            "pitch_in_degrees": pitch_deg,
        },
        "engine_status": { "all_engines": { "running": true } },
        "gmt_time": time(&conditions.clock),
        "weather": weather(&conditions.weather, start)?,
    });
    match without_number(&body, "flight") {
        // JSON has no NaN: it became null.
        Some(path) => Err(BadConditions(format!("{path} is not a finite number"))),
        None => Ok(body),
    }
}

/// Universal time, which needs no time zone. The day is the only integer of the body, 0 on 1 January.
fn time(clock: &Clock) -> Value {
    json!({
        "day_of_year": clock.day_of_year.saturating_sub(1),
        "time_in_24_hours": clock.zulu_time_s / 3_600.0,
    })
}

fn weather(weather: &Weather, start: &FlightStart) -> Result<Value, BadConditions> {
    check_cloud_layers(weather)?;
    let clouds: Vec<Value> = weather.clouds.iter().map(cloud).collect();
    // All layers alike: a scenario's wind is the same at all heights.
    let wind: Vec<Value> = WIND_ALTITUDES_MSL_M
        .into_iter()
        .map(|altitude_msl_m| {
            json!({
                "altitude_in_feet_msl": altitude_msl_m / METERS_PER_FOOT,
                "speed_in_knots": weather.wind_speed_mps / MPS_PER_KNOT,
                "direction_in_degrees_true": weather.wind_from_true_deg,
                "gust_increase_in_knots": 0.0,
                "shear_in_degrees": 0.0,
                "turbulence_ratio": weather.turbulence_ratio,
            })
        })
        .collect();
    Ok(json!({
        "definition": {
            "latitude_in_degrees": start.position.latitude_deg,
            "longitude_in_degrees": start.position.longitude_deg,
            "elevation_in_meters": 0.0,
            "visibility_in_kilometers": weather.visibility_m / 1_000.0,
            "temperature_in_degrees_celsius": STANDARD_TEMPERATURE_C,
            "altimeter_setting_in_hpa": STANDARD_PRESSURE_PA / 100.0,
            "precipitation_ratio": weather.rain_ratio,
            "clouds": clouds,
            "wind": wind,
        },
        "vertical_speed_in_thermal_in_feet_per_minute": 0.0,
        "wave_height_in_meters": 0.0,
        "wave_direction_in_degrees": 0.0,
        // Rain of the scenario falls, but the runway of all scenarios is the same.
        "terrain_state": "dry",
        "variation_across_region_percentage": 0.0,
        "evolution_over_time_enum": "static",
    }))
}

fn cloud(cloud: &CloudLayer) -> Value {
    let kind = match cloud.kind {
        CloudKind::Cirrus => "cirrus",
        CloudKind::Stratus => "stratus",
        CloudKind::Cumulus => "cumulus",
        // X-Plane's own spelling.
        CloudKind::Cumulonimbus => "cumulunimbus",
    };
    json!({
        "type": kind,
        "cover_ratio": cloud.cover_ratio,
        "bases_in_feet_msl": cloud.base_msl_m / METERS_PER_FOOT,
        "tops_in_feet_msl": cloud.top_msl_m / METERS_PER_FOOT,
    })
}

/// The path of the first null.
fn without_number(value: &Value, path: &str) -> Option<String> {
    match value {
        Value::Null => Some(path.to_owned()),
        Value::Object(fields) => fields
            .iter()
            .find_map(|(key, value)| without_number(value, &format!("{path}.{key}"))),
        Value::Array(items) => items
            .iter()
            .enumerate()
            .find_map(|(at, value)| without_number(value, &format!("{path}[{at}]"))),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use dataset::geometry::geodesy::Geodetic;

    use super::*;

    fn conditions() -> Conditions {
        Conditions {
            time_of_day: "18:00".into(),
            clock: Clock {
                day_of_year: 172,
                zulu_time_s: 36_000.0,
            },
            weather_name: "stormy".into(),
            weather: Weather {
                visibility_m: 35_000.0,
                clouds: vec![CloudLayer {
                    kind: CloudKind::Cumulonimbus,
                    cover_ratio: 1.0,
                    base_msl_m: 609.6,
                    top_msl_m: 9_144.0,
                }],
                rain_ratio: 1.0,
                wind_speed_mps: 0.0,
                wind_from_true_deg: 340.0,
                turbulence_ratio: 0.0,
            },
        }
    }

    fn start() -> AirStart {
        AirStart {
            start: FlightStart {
                position: Geodetic {
                    latitude_deg: 1.0,
                    longitude_deg: 104.0,
                    altitude_msl_m: 762.0,
                },
                heading_true_deg: 23.0,
                speed_mps: 80.0,
            },
            pitch_deg: 0.0,
        }
    }

    fn body() -> Value {
        flight_body("Aircraft/b738.acf", &start(), &conditions()).unwrap()
    }

    /// Integers written without a decimal point, by path.
    fn integers(value: &Value, path: &str) -> Vec<String> {
        match value {
            Value::Number(number) if !number.is_f64() => vec![path.to_owned()],
            Value::Object(fields) => fields
                .iter()
                .flat_map(|(key, value)| integers(value, &format!("{path}/{key}")))
                .collect(),
            Value::Array(items) => items.iter().flat_map(|item| integers(item, path)).collect(),
            _ => vec![],
        }
    }

    #[test]
    fn no_number_but_the_day_is_written_as_an_integer() {
        // These conditions have only integers, which is the trap.
        assert_eq!(integers(&body(), ""), ["/gmt_time/day_of_year"]);
        let text = body().to_string();
        assert!(
            text.contains(r#""visibility_in_kilometers":35.0"#),
            "{text}"
        );
        assert!(text.contains(r#""time_in_24_hours":10.0"#), "{text}");
    }

    #[test]
    fn every_key_of_the_weather_is_there_in_x_planes_units() {
        let body = body();
        let weather = &body["weather"];
        for key in [
            "definition",
            "vertical_speed_in_thermal_in_feet_per_minute",
            "wave_height_in_meters",
            "wave_direction_in_degrees",
            "terrain_state",
            "variation_across_region_percentage",
            "evolution_over_time_enum",
        ] {
            assert!(!weather[key].is_null(), "{key}");
        }
        let definition = &weather["definition"];
        for key in [
            "latitude_in_degrees",
            "longitude_in_degrees",
            "elevation_in_meters",
            "visibility_in_kilometers",
            "altimeter_setting_in_hpa",
            "precipitation_ratio",
            "clouds",
            "wind",
        ] {
            assert!(!definition[key].is_null(), "{key}");
        }
        assert_eq!(definition["clouds"][0]["type"], "cumulunimbus");
        assert!(
            (definition["clouds"][0]["bases_in_feet_msl"]
                .as_f64()
                .unwrap()
                - 2_000.0)
                .abs()
                < 1e-9
        );
        assert_eq!(definition["wind"].as_array().unwrap().len(), 13);
        assert_eq!(body["gmt_time"]["day_of_year"], 171);
    }

    #[test]
    fn four_layers_of_cloud_and_numbers_that_are_none_are_refused_with_their_name() {
        let mut many = conditions();
        many.weather.clouds = vec![many.weather.clouds[0]; 4];
        let error = flight_body("a.acf", &start(), &many).unwrap_err();
        assert!(error.to_string().contains("4 cloud layers"), "{error}");
        let mut none = conditions();
        none.weather.wind_speed_mps = f64::NAN;
        let error = flight_body("a.acf", &start(), &none)
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("flight.weather.definition.wind[0].speed_in_knots"),
            "{error}"
        );
    }
}
