//! Request structure of the "Flight Initialization API": the keys that the stand-in's clients need.
//!
//! Keys with an underscore are parsed, because unknown keys are rejected, and have no effect on the stand-in's aircraft.

use serde::Deserialize;
use serde_json::Value;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Envelope {
    pub(super) data: Flight,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Flight {
    pub(super) aircraft: Aircraft,
    pub(super) lle_air_start: AirStart,
    pub(super) gmt_time: TimeOfYear,
    pub(super) weather: SetWeather,
    #[serde(rename = "engine_status")]
    pub(super) _engine_status: Option<Value>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Aircraft {
    pub(super) path: String,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AirStart {
    pub(super) latitude: f64,
    pub(super) longitude: f64,
    pub(super) elevation_in_meters: f64,
    pub(super) heading_true: f64,
    pub(super) speed_in_meters_per_second: f64,
    pub(super) pitch_in_degrees: f64,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TimeOfYear {
    /// 0 is 1 January.
    pub(super) day_of_year: u32,
    pub(super) time_in_24_hours: f64,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SetWeather {
    pub(super) definition: WeatherDefinition,
    pub(super) vertical_speed_in_thermal_in_feet_per_minute: f64,
    #[serde(rename = "wave_height_in_meters")]
    pub(super) _wave_height_m: f64,
    #[serde(rename = "wave_direction_in_degrees")]
    pub(super) _wave_direction_deg: f64,
    #[serde(rename = "terrain_state")]
    pub(super) _terrain_state: String,
    pub(super) variation_across_region_percentage: f64,
    #[serde(rename = "evolution_over_time_enum")]
    pub(super) _evolution: String,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct WeatherDefinition {
    #[serde(rename = "latitude_in_degrees")]
    pub(super) _latitude_deg: f64,
    #[serde(rename = "longitude_in_degrees")]
    pub(super) _longitude_deg: f64,
    #[serde(rename = "elevation_in_meters")]
    pub(super) _elevation_m: f64,
    pub(super) visibility_in_kilometers: f64,
    pub(super) temperature_in_degrees_celsius: Option<f64>,
    pub(super) altimeter_setting_in_hpa: Option<f64>,
    #[serde(default)]
    pub(super) precipitation_ratio: f64,
    #[serde(default)]
    pub(super) clouds: Vec<Cloud>,
    #[serde(default)]
    pub(super) wind: Vec<Wind>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Cloud {
    #[serde(rename = "type")]
    pub(super) kind: CloudWord,
    pub(super) cover_ratio: f64,
    pub(super) bases_in_feet_msl: f64,
    pub(super) tops_in_feet_msl: f64,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum CloudWord {
    Cirrus,
    Stratus,
    Cumulus,
    /// Misspelt as in X-Plane's documentation; the correct spelling is accepted as well.
    #[serde(rename = "cumulunimbus", alias = "cumulonimbus")]
    Cumulonimbus,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Wind {
    pub(super) altitude_in_feet_msl: f64,
    pub(super) speed_in_knots: f64,
    pub(super) direction_in_degrees_true: f64,
    #[serde(rename = "gust_increase_in_knots")]
    pub(super) _gust_kt: Option<f64>,
    #[serde(rename = "shear_in_degrees")]
    pub(super) _shear_deg: Option<f64>,
    #[serde(default)]
    pub(super) turbulence_ratio: f64,
}
