//! The weather as seen by instruments and the image: read-only datarefs that follow the shown weather, not the written one.

use std::collections::BTreeMap;

use dataset::conditions::Weather;
use dataset::numbers::units::MPS_PER_KNOT;
use xplane_bridge::datarefs::{self as names, Generation, METERS_PER_STATUTE_MILE};

use crate::datarefs::Datarefs;

/// Rain of 0.8 was read at the aircraft as 0.796.
const RAIN_AT_AIRCRAFT: f64 = 0.995;

/// Datarefs of the aircraft with the values of the region's.
const LIKE_REGION: [(&str, &str); 6] = [
    (names::CLOUD_TYPE, "sim/weather/aircraft/cloud_type"),
    (
        names::CLOUD_COVER,
        "sim/weather/aircraft/cloud_coverage_percent",
    ),
    (names::CLOUD_BASE, "sim/weather/aircraft/cloud_base_msl_m"),
    (names::CLOUD_TOP, "sim/weather/aircraft/cloud_tops_msl_m"),
    (names::PRESSURE_PA, "sim/weather/aircraft/qnh_pas"),
    (
        names::TEMPERATURE_C,
        "sim/weather/aircraft/temperature_ambient_deg_c",
    ),
];

/// Publishes the effective weather.
pub(super) fn publish(
    generation: Generation,
    weather: &Weather,
    shown: &BTreeMap<String, Vec<f64>>,
    datarefs: &mut Datarefs,
) {
    let both = [
        (names::VISIBILITY_EFFECTIVE_M, weather.visibility_m),
        (
            "sim/cockpit2/gauges/indicators/wind_speed_kts",
            weather.wind_speed_mps / MPS_PER_KNOT,
        ),
    ];
    for (name, value) in both {
        datarefs.set(name, value);
    }
    if generation == Generation::XPlane11 {
        datarefs.set("sim/weather/visibility_effective_m", weather.visibility_m);
        return;
    }
    for (region, aircraft) in LIKE_REGION {
        if let Some(values) = shown.get(region) {
            datarefs.restore(aircraft, values);
        }
    }
    let temperature_c = shown
        .get(names::TEMPERATURE_C)
        .and_then(|values| values.first().copied())
        .unwrap_or_default();
    let [rain, snow] = if temperature_c > 0.0 {
        [weather.rain_ratio, 0.0]
    } else {
        [0.0, weather.rain_ratio]
    };
    for (name, value) in [
        (
            "sim/weather/aircraft/visibility_reported_sm",
            weather.visibility_m / METERS_PER_STATUTE_MILE,
        ),
        (names::WIND_SPEED_AT_AIRCRAFT, weather.wind_speed_mps),
        (
            names::WIND_DIRECTION_AT_AIRCRAFT,
            weather.wind_from_true_deg,
        ),
        (
            names::RAIN_AT_AIRCRAFT,
            weather.rain_ratio * RAIN_AT_AIRCRAFT,
        ),
        ("sim/weather/view/rain_ratio", rain),
        ("sim/weather/view/snow_ratio", snow),
        ("sim/weather/view/temperature_C", temperature_c),
    ] {
        datarefs.set(name, value);
    }
}
