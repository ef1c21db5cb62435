//! A scenario's physical conditions: air, clouds, wind, rain, and the time that sets the sun.
//!
//! All SI. The bridge converts them to X-Plane's units in one place.

pub mod sight;

use crate::numbers::limits::{self, Check, Limits, check_fields};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Cloud kind, in X-Plane 12's order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum CloudKind {
    /// High thin ice cloud.
    Cirrus,
    /// Grey sheet.
    Stratus,
    /// Heaps.
    Cumulus,
    /// Thunderstorm clouds.
    Cumulonimbus,
}

/// Cloud layer.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CloudLayer {
    /// Kind of cloud.
    pub kind: CloudKind,
    /// Part of the sky that it covers, 0 to 1.
    pub cover_ratio: f64,
    /// Height of the base above mean sea level, metres.
    pub base_msl_m: f64,
    /// Height of the top above mean sea level, metres.
    pub top_msl_m: f64,
}

/// Koschmieder's constant: contrast falls to 2 % over the visibility, and `-ln 0.02` is 3.912.
const KOSCHMIEDER: f64 = 3.912;

/// Extinction coefficient of air, 1/m, for a meteorological visibility. Contrast falls with the distance r as `exp(-beta r)`.
pub fn extinction_per_m(visibility_m: f64) -> f64 {
    KOSCHMIEDER / visibility_m
}

/// Share of contrast that remains over a distance, 0 to 1.
pub fn transmission(range_m: f64, visibility_m: f64) -> f64 {
    (-KOSCHMIEDER * range_m / visibility_m).exp()
}

/// A scenario's weather, constant in space and time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Weather {
    /// Meteorological visibility (a black object's contrast falls to 2 %), metres.
    pub visibility_m: f64,
    /// At most three layers, lowest first.
    #[serde(default)]
    pub clouds: Vec<CloudLayer>,
    /// Rain intensity, 0 to 1.
    #[serde(default)]
    pub rain_ratio: f64,
    /// Wind speed at 10 m above ground, metres per second.
    #[serde(default)]
    pub wind_speed_mps: f64,
    /// Direction that the wind comes from, degrees true.
    #[serde(default)]
    pub wind_from_true_deg: f64,
    /// Turbulence intensity, 0 none to 1 severe.
    #[serde(default)]
    pub turbulence_ratio: f64,
}

/// Scenario date and time. The simulator's clock is stopped during a scenario.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Clock {
    /// Day of the year, 1 to 365. X-Plane has no year.
    pub day_of_year: u32,
    /// Coordinated universal time, seconds since midnight, 0 to 86 400.
    pub zulu_time_s: f64,
}

impl Weather {
    /// Checks for numbers outside their limits.
    pub fn check(&self, check: &mut Check) {
        check_fields!(check, self, {
            visibility_m: limits::VISIBILITY_M,
            rain_ratio: limits::RAIN_RATIO,
            wind_speed_mps: limits::WIND_SPEED_MPS,
            wind_from_true_deg: limits::WIND_FROM_TRUE_DEG,
            turbulence_ratio: limits::TURBULENCE_RATIO,
        });
        for (index, layer) in self.clouds.iter().enumerate() {
            check.part(format_args!("clouds[{index}]"), |check| {
                check.number("cover_ratio", layer.cover_ratio, limits::COVER_RATIO);
                check.number("base_msl_m", layer.base_msl_m, limits::CLOUD_BASE_MSL_M);
                let above_base = Limits {
                    least: layer.base_msl_m,
                    ..limits::CLOUD_TOP_MSL_M
                };
                check.number("top_msl_m", layer.top_msl_m, above_base);
            });
        }
    }
}

impl Conditions {
    /// Checks for numbers outside their limits.
    pub fn check(&self, check: &mut Check) {
        check.part("clock", |check| {
            check.number("day_of_year", self.clock.day_of_year, limits::DAY_OF_YEAR);
            check.number("zulu_time_s", self.clock.zulu_time_s, limits::ZULU_TIME_S);
        });
        check.part("weather", |check| self.weather.check(check));
    }
}

/// Weather and time, with their names in the sweep.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Conditions {
    /// Local time as the sweep names it, e.g. `06:00`.
    pub time_of_day: String,
    /// Date and time of the scenario.
    pub clock: Clock,
    /// Name of the weather in the sweep, e.g. `foggy`.
    pub weather_name: String,
    /// The definition of that weather.
    pub weather: Weather,
}
