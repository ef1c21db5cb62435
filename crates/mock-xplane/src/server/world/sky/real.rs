//! Real weather: overwrites whatever clients write as long as it is switched on.

use xplane_bridge::datarefs::{self as names, Generation};

use crate::datarefs::Datarefs;

/// [`names::CHANGE_MODE`] of real weather.
const MODE: f64 = 7.0;

/// An afternoon with heaps below a layer, and a shower.
const REAL_12: &[(&str, f64)] = &[
    (names::VISIBILITY_SM, 6.0),
    (names::RAIN, 0.2),
    (names::TEMPERATURE_C, 29.0),
    (names::PRESSURE_PA, 100_900.0),
    ("sim/weather/region/cloud_type[0]", 2.0),
    ("sim/weather/region/cloud_type[1]", 1.0),
    ("sim/weather/region/cloud_type[2]", 0.0),
    ("sim/weather/region/cloud_coverage_percent[0]", 0.4),
    ("sim/weather/region/cloud_coverage_percent[1]", 0.8),
    ("sim/weather/region/cloud_coverage_percent[2]", 0.3),
    ("sim/weather/region/cloud_base_msl_m[0]", 550.0),
    ("sim/weather/region/cloud_base_msl_m[1]", 2_400.0),
    ("sim/weather/region/cloud_base_msl_m[2]", 8_000.0),
    ("sim/weather/region/cloud_tops_msl_m[0]", 1_700.0),
    ("sim/weather/region/cloud_tops_msl_m[1]", 2_900.0),
    ("sim/weather/region/cloud_tops_msl_m[2]", 8_400.0),
    ("sim/weather/region/wind_speed_msc[0]", 6.0),
    ("sim/weather/region/wind_direction_degt[0]", 210.0),
];

const REAL_11: &[(&str, f64)] = &[
    ("sim/weather/visibility_reported_m", 9_700.0),
    ("sim/weather/rain_percent", 0.2),
    ("sim/weather/cloud_type[0]", 2.0),
    ("sim/weather/cloud_type[1]", 4.0),
    ("sim/weather/cloud_base_msl_m[0]", 550.0),
    ("sim/weather/cloud_base_msl_m[1]", 2_400.0),
    ("sim/weather/cloud_tops_msl_m[0]", 1_700.0),
    ("sim/weather/cloud_tops_msl_m[1]", 2_900.0),
    ("sim/weather/wind_speed_kt[0]", 12.0),
    ("sim/weather/wind_direction_degt[0]", 210.0),
];

/// The dataref that switches it.
pub(super) fn switch(generation: Generation) -> &'static str {
    match generation {
        Generation::XPlane11 => names::USE_REAL_WEATHER_11,
        Generation::XPlane12 => names::CHANGE_MODE,
    }
}

/// True if the switch is on.
pub(super) fn is_on(generation: Generation, datarefs: &Datarefs) -> bool {
    let position = datarefs.get(switch(generation));
    match generation {
        Generation::XPlane11 => position != 0.0,
        Generation::XPlane12 => position == MODE,
    }
}

pub(super) fn switch_on(generation: Generation, datarefs: &mut Datarefs) {
    let position = match generation {
        Generation::XPlane11 => 1.0,
        Generation::XPlane12 => MODE,
    };
    datarefs.set(switch(generation), position);
    publish(generation, datarefs, true);
}

/// Returns whether it is active.
pub(super) fn publish(generation: Generation, datarefs: &mut Datarefs, rules: bool) {
    if generation == Generation::XPlane12 {
        datarefs.set(names::WEATHER_SOURCE, f64::from(u8::from(rules)));
    }
}

/// Overwrites the written weather.
pub(super) fn overwrite(generation: Generation, datarefs: &mut Datarefs) {
    let values = match generation {
        Generation::XPlane11 => REAL_11,
        Generation::XPlane12 => REAL_12,
    };
    for (path, value) in values {
        datarefs.set(path, *value);
    }
}
