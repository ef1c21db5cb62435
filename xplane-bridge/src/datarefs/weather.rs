//! Conversion of the weather to the datarefs of X-Plane 11 and 12, and back.
//!
//! Weather outlives flights in the simulator, so every parameter is always written, in the order that X-Plane 12 handles best
//! (`docs/x-plane-evidence.md`): unused cloud layers as empty, the same wind at every height, since leftovers would remain as shear.

use dataset::conditions::{CloudKind, CloudLayer, Weather};
use dataset::numbers::units::MPS_PER_KNOT;

use super::*;

/// The weather. A simulator that shows it reads these values, within their tolerances.
///
/// # Errors
/// For more layers than X-Plane has.
pub(crate) fn weather_writes(
    weather: &Weather,
    generation: Generation,
) -> Result<Vec<DatarefWrite>, BadConditions> {
    check_cloud_layers(weather)?;
    Ok(match generation {
        Generation::XPlane11 => weather_writes_11(weather),
        Generation::XPlane12 => weather_writes_12(weather),
    })
}

/// Rejects more layers than X-Plane has.
pub(crate) fn check_cloud_layers(weather: &Weather) -> Result<(), BadConditions> {
    match weather.clouds.len() {
        0..=CLOUD_LAYERS => Ok(()),
        layers => Err(BadConditions(format!(
            "{layers} cloud layers, X-Plane has {CLOUD_LAYERS}"
        ))),
    }
}

fn weather_writes_12(weather: &Weather) -> Vec<DatarefWrite> {
    let mut writes = vec![write(CHANGE_MODE, 3.0), write(VARIABILITY, 0.0)];
    for (layer, altitude_msl_m) in WIND_ALTITUDES_MSL_M.into_iter().enumerate() {
        writes.extend([
            element(WIND_ALTITUDE, layer, altitude_msl_m),
            element(WIND_SPEED, layer, weather.wind_speed_mps),
            wind_direction(WIND_DIRECTION, layer, weather),
            element(TURBULENCE, layer, weather.turbulence_ratio),
            element(SHEAR_SPEED, layer, 0.0),
            element(SHEAR_DIRECTION, layer, 0.0),
        ]);
    }
    writes.extend([
        write(
            VISIBILITY_SM,
            weather.visibility_m / METERS_PER_STATUTE_MILE,
        ),
        write(RAIN, weather.rain_ratio),
        write(PRESSURE_PA, STANDARD_PRESSURE_PA),
        write(THERMALS, 0.0),
        write(TEMPERATURE_C, STANDARD_TEMPERATURE_C),
    ]);
    for (layer, altitude_msl_m) in WIND_ALTITUDES_MSL_M.into_iter().enumerate() {
        let temperature_c = standard_temperature_c(altitude_msl_m);
        writes.extend([
            element(TEMPERATURE_ALTITUDE, layer, altitude_msl_m),
            element(TEMPERATURE_ALOFT_C, layer, temperature_c),
            element(DEW_POINT_C, layer, temperature_c - DEW_POINT_BELOW_C),
        ]);
    }
    for layer in 0..CLOUD_LAYERS {
        let cloud = weather.clouds.get(layer).unwrap_or(&NO_CLOUD);
        writes.extend(cloud_writes(
            cloud,
            [
                element(CLOUD_TYPE, layer, cloud_type_12(cloud)),
                element(CLOUD_BASE, layer, cloud.base_msl_m),
                element(CLOUD_TOP, layer, cloud.top_msl_m),
            ],
        ));
        writes.push(element(CLOUD_COVER, layer, cloud.cover_ratio));
    }
    // Rain of the scenario falls, but the runway of all scenarios is the same.
    writes.push(write(RUNWAY_FRICTION, DRY));
    writes
}

fn weather_writes_11(weather: &Weather) -> Vec<DatarefWrite> {
    let has_storm = weather
        .clouds
        .iter()
        .any(|cloud| cloud.kind == CloudKind::Cumulonimbus);
    let thunderstorm = if has_storm { weather.rain_ratio } else { 0.0 };
    // Real weather overwrites all settings while it is on.
    let mut writes = vec![write(USE_REAL_WEATHER_11, 0.0)];
    for (layer, altitude_msl_m) in WIND_ALTITUDES_11_MSL_M.into_iter().enumerate() {
        let speed_kt = weather.wind_speed_mps / MPS_PER_KNOT;
        writes.extend([
            element(WIND_ALTITUDE_11, layer, altitude_msl_m),
            element(WIND_SPEED_KT_11, layer, speed_kt),
            wind_direction(WIND_DIRECTION_11, layer, weather),
            element(TURBULENCE_11, layer, weather.turbulence_ratio),
            element(SHEAR_SPEED_KT_11, layer, 0.0),
            element(SHEAR_DIRECTION_11, layer, 0.0),
        ]);
    }
    writes.extend([
        write(VISIBILITY_M_11, weather.visibility_m),
        write(RAIN_11, weather.rain_ratio),
        write(THUNDERSTORM_11, thunderstorm),
        write(THERMAL_PERCENT_11, 0.0),
        write(THERMAL_RATE_11, 0.0),
        write(TEMPERATURE_C_11, STANDARD_TEMPERATURE_C),
        write(
            PRESSURE_INHG_11,
            STANDARD_PRESSURE_PA / PASCAL_PER_INCH_OF_MERCURY,
        ),
    ]);
    for layer in 0..CLOUD_LAYERS {
        let cloud = weather.clouds.get(layer).unwrap_or(&NO_CLOUD);
        writes.extend(cloud_writes(
            cloud,
            [
                element(CLOUD_BASE_11, layer, cloud.base_msl_m),
                element(CLOUD_TOP_11, layer, cloud.top_msl_m),
            ],
        ));
        // Kind and cover in one number.
        writes.push(element(CLOUD_TYPE_11, layer, cloud_type_11(cloud)));
    }
    writes
}

/// Layer without clouds.
const NO_CLOUD: CloudLayer = CloudLayer {
    kind: CloudKind::Cirrus,
    cover_ratio: 0.0,
    base_msl_m: 0.0,
    top_msl_m: 0.0,
};

/// Cloud layer details; an empty layer does not show them.
fn cloud_writes<const N: usize>(
    cloud: &CloudLayer,
    writes: [DatarefWrite; N],
) -> [DatarefWrite; N] {
    if cloud.cover_ratio > 0.0 {
        writes
    } else {
        writes.map(DatarefWrite::unread)
    }
}

/// Wind direction; a calm has none.
fn wind_direction(name: &str, layer: usize, weather: &Weather) -> DatarefWrite {
    let direction = element(name, layer, weather.wind_from_true_deg);
    if weather.wind_speed_mps < tolerance::WIND_MPS {
        direction.unread()
    } else {
        direction
    }
}

/// Temperature of the international standard atmosphere, degrees Celsius.
fn standard_temperature_c(altitude_msl_m: f64) -> f64 {
    const LAPSE_C_PER_M: f64 = 0.0065;
    const TROPOPAUSE_MSL_M: f64 = 11_000.0;
    STANDARD_TEMPERATURE_C - LAPSE_C_PER_M * altitude_msl_m.min(TROPOPAUSE_MSL_M)
}

fn write(name: &str, value: f64) -> DatarefWrite {
    DatarefWrite {
        tolerance: Tolerance::of_weather(name, value),
        ..DatarefWrite::new(name, value)
    }
}

fn element(name: &str, index: usize, value: f64) -> DatarefWrite {
    write(&format!("{name}[{index}]"), value)
}

fn cloud_type_12(cloud: &CloudLayer) -> f64 {
    match cloud.kind {
        CloudKind::Cirrus => 0.0,
        CloudKind::Stratus => 1.0,
        CloudKind::Cumulus => 2.0,
        CloudKind::Cumulonimbus => 3.0,
    }
}

/// X-Plane 11 has kind and cover in one number: 0 clear, 1 cirrus, 2 scattered, 3 broken, 4 overcast, 5 stratus.
fn cloud_type_11(cloud: &CloudLayer) -> f64 {
    match cloud.kind {
        _ if cloud.cover_ratio <= 0.0 => 0.0,
        CloudKind::Cirrus => 1.0,
        CloudKind::Stratus => 5.0,
        // Oktas in weather reports: scattered up to 4/8, broken up to 7/8, overcast above.
        CloudKind::Cumulus | CloudKind::Cumulonimbus => match cloud.cover_ratio {
            cover if cover <= 0.5 => 2.0,
            cover if cover <= 0.875 => 3.0,
            _ => 4.0,
        },
    }
}

/// Weather from a simulator's datarefs: the inverse of [`condition_writes`], for the stand-in. The wind is taken from the lowest layer.
/// X-Plane 11 has no number for cloud cover; this returns the middle of its kind's range.
pub fn weather_from_datarefs(generation: Generation, read: impl Fn(&str) -> f32) -> Weather {
    match generation {
        Generation::XPlane11 => weather_11(read),
        Generation::XPlane12 => weather_12(read),
    }
}

fn weather_11(read: impl Fn(&str) -> f32) -> Weather {
    let layer = |name: &str, layer: usize| f64::from(read(&format!("{name}[{layer}]")));
    let stormy = read(THUNDERSTORM_11) > 0.0;
    let heaps = if stormy {
        CloudKind::Cumulonimbus
    } else {
        CloudKind::Cumulus
    };
    let clouds = (0..CLOUD_LAYERS).filter_map(|i| {
        let (kind, cover_ratio) = match layer(CLOUD_TYPE_11, i).round() as i64 {
            i64::MIN..=0 => return None,
            1 => (CloudKind::Cirrus, 0.25),
            2 => (heaps, 0.375),
            3 => (heaps, 0.75),
            4 => (heaps, 1.0),
            _ => (CloudKind::Stratus, 1.0),
        };
        Some(CloudLayer {
            kind,
            cover_ratio,
            base_msl_m: layer(CLOUD_BASE_11, i),
            top_msl_m: layer(CLOUD_TOP_11, i),
        })
    });
    Weather {
        visibility_m: f64::from(read(VISIBILITY_M_11)),
        clouds: clouds.collect(),
        rain_ratio: f64::from(read(RAIN_11)),
        wind_speed_mps: layer(WIND_SPEED_KT_11, 0) * MPS_PER_KNOT,
        wind_from_true_deg: layer(WIND_DIRECTION_11, 0),
        turbulence_ratio: layer(TURBULENCE_11, 0),
    }
}

fn weather_12(read: impl Fn(&str) -> f32) -> Weather {
    let number = |name: &str| f64::from(read(name));
    let layer = |name: &str, layer: usize| f64::from(read(&format!("{name}[{layer}]")));
    let clouds = (0..CLOUD_LAYERS).map(|i| CloudLayer {
        kind: match layer(CLOUD_TYPE, i).round() as i64 {
            i64::MIN..=0 => CloudKind::Cirrus,
            1 => CloudKind::Stratus,
            2 => CloudKind::Cumulus,
            _ => CloudKind::Cumulonimbus,
        },
        cover_ratio: layer(CLOUD_COVER, i),
        base_msl_m: layer(CLOUD_BASE, i),
        top_msl_m: layer(CLOUD_TOP, i),
    });
    Weather {
        visibility_m: number(VISIBILITY_SM) * METERS_PER_STATUTE_MILE,
        clouds: clouds.filter(|cloud| cloud.cover_ratio > 0.0).collect(),
        rain_ratio: number(RAIN),
        wind_speed_mps: layer(WIND_SPEED, 0),
        wind_from_true_deg: layer(WIND_DIRECTION, 0),
        turbulence_ratio: layer(TURBULENCE, 0),
    }
}
