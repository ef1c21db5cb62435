//! Clamps the weather and the clock that clients have written. They may write any number, as into X-Plane; flights and images stay within
//! what exists on earth.

use dataset::conditions::{Clock, CloudLayer, Weather};
use dataset::numbers::units::SECONDS_PER_DAY;

use super::clock::DAYS_PER_YEAR;

/// Densest fog to air without any haze, metres.
const VISIBILITY_M: [f64; 2] = [1.0, 300_000.0];
/// Bases and tops of clouds, metres.
const CLOUDS_M: [f64; 2] = [-500.0, 30_000.0];
/// Up to more than any measured wind, metres per second.
const WIND_MPS: [f64; 2] = [0.0, 150.0];
const RATIO: [f64; 2] = [0.0, 1.0];

/// The nearest possible weather.
pub(super) fn weather(written: Weather) -> Weather {
    let clouds = written.clouds.into_iter().map(|layer| CloudLayer {
        cover_ratio: within(layer.cover_ratio, RATIO),
        base_msl_m: within(layer.base_msl_m, CLOUDS_M),
        top_msl_m: within(layer.top_msl_m, CLOUDS_M),
        ..layer
    });
    Weather {
        visibility_m: within(written.visibility_m, VISIBILITY_M),
        clouds: clouds.collect(),
        rain_ratio: within(written.rain_ratio, RATIO),
        wind_speed_mps: within(written.wind_speed_mps, WIND_MPS),
        wind_from_true_deg: wrapped(written.wind_from_true_deg, 360.0),
        turbulence_ratio: within(written.turbulence_ratio, RATIO),
    }
}

/// Clamps the clock to a valid day of the year and second of the day.
pub(super) fn clock(written: Clock) -> Clock {
    Clock {
        day_of_year: written.day_of_year.saturating_sub(1) % DAYS_PER_YEAR + 1,
        zulu_time_s: wrapped(written.zulu_time_s, SECONDS_PER_DAY),
    }
}

/// The nearest number between two; for NaN, the first.
fn within(value: f64, [low, high]: [f64; 2]) -> f64 {
    if value.is_nan() {
        low
    } else {
        value.clamp(low, high)
    }
}

/// A number on a circle; unchanged if it is on it already, and 0 for NaN.
fn wrapped(value: f64, round: f64) -> f64 {
    if (0.0..=round).contains(&value) {
        value
    } else if value.is_finite() {
        value.rem_euclid(round)
    } else {
        0.0
    }
}
