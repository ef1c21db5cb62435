//! Tolerances for reading back a written dataref, in the unit of the dataref: the one table, for setting and for watching.
//!
//! X-Plane stores weather in its own units and grids, smooths it, and settles on values near the requested ones. The tolerances come from
//! clients of a live X-Plane 12.4 (`docs/x-plane-evidence.md` names them), none of which uses one in 10,000, mere rounding, for weather.

use dataset::numbers::units::{METERS_PER_FOOT, MPS_PER_KNOT};

use super::*;

/// Tolerance for a value that went through X-Plane's 32-bit floats, and for some datarefs through its own units.
const ROUNDING: f32 = 1e-4;
/// Wind, metres per second. Below it a direction is meaningless.
pub(super) const WIND_MPS: f64 = 1.5;
const WIND_FROM_DEG: f32 = 6.0;
const VISIBILITY_RATIO: f32 = 0.1;
/// Rain and turbulence.
const INTENSITY: f32 = 0.05;
const COVER: f32 = 0.02;
/// X-Plane may settle on a base some metres off the requested one: beyond 30 ft a client of X-Plane 12 warns its user. (A second client
/// holds X-Plane 12.4.3 to 5 m, which would reject such a sky.)
const CLOUD_HEIGHT_M: f32 = (30.0 * METERS_PER_FOOT) as f32;
/// Kinds are integers, between which X-Plane 12 may blend.
const CLOUD_TYPE_STEP: f32 = 0.25;
const PRESSURE_TOLERANCE_PA: f64 = 100.0;
const TEMPERATURE_TOLERANCE_C: f32 = 1.0;

/// Accepted difference between read and written values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Tolerance {
    /// This much, in the dataref's unit.
    Absolute(f32),
    /// This share of the value.
    Relative(f32),
    /// This many degrees around the circle.
    Degrees(f32),
    /// It is not read back: no image and no flight depends on it.
    Unread,
}

impl Tolerance {
    /// For a value that is only rounded.
    pub(super) fn rounding(value: f64) -> Self {
        Self::Absolute(value.abs().max(1.0) as f32 * ROUNDING)
    }

    /// True if `found` is acceptable after writing `written`.
    pub(crate) fn allows(self, written: f32, found: f32) -> bool {
        let off = (found - written).abs();
        match self {
            Self::Absolute(most) => off <= most,
            Self::Relative(part) => off <= written.abs() * part,
            Self::Degrees(most) => {
                let around = off.rem_euclid(360.0);
                around.min(360.0 - around) <= most
            }
            Self::Unread => true,
        }
    }

    /// Tolerance for a weather dataref, by its name with or without an index.
    pub(super) fn of_weather(name: &str, value: f64) -> Self {
        let array = name.split('[').next().unwrap_or(name);
        match array {
            VISIBILITY_SM | VISIBILITY_M_11 => Self::Relative(VISIBILITY_RATIO),
            RAIN | RAIN_11 | TURBULENCE | TURBULENCE_11 => Self::Absolute(INTENSITY),
            CLOUD_COVER => Self::Absolute(COVER),
            CLOUD_TYPE | CLOUD_TYPE_11 => Self::Absolute(CLOUD_TYPE_STEP),
            CLOUD_BASE | CLOUD_TOP | CLOUD_BASE_11 | CLOUD_TOP_11 => Self::Absolute(CLOUD_HEIGHT_M),
            WIND_SPEED | SHEAR_SPEED => Self::Absolute(WIND_MPS as f32),
            WIND_SPEED_KT_11 | SHEAR_SPEED_KT_11 => {
                Self::Absolute((WIND_MPS / MPS_PER_KNOT) as f32)
            }
            WIND_DIRECTION | WIND_DIRECTION_11 => Self::Degrees(WIND_FROM_DEG),
            PRESSURE_PA => Self::Absolute(PRESSURE_TOLERANCE_PA as f32),
            PRESSURE_INHG_11 => {
                Self::Absolute((PRESSURE_TOLERANCE_PA / PASCAL_PER_INCH_OF_MERCURY) as f32)
            }
            TEMPERATURE_C | TEMPERATURE_C_11 => Self::Absolute(TEMPERATURE_TOLERANCE_C),
            WIND_ALTITUDE | TEMPERATURE_ALTITUDE | TEMPERATURE_ALOFT_C | DEW_POINT_C
            | SHEAR_DIRECTION | SHEAR_DIRECTION_11 | THERMALS | VARIABILITY | RUNWAY_FRICTION => {
                Self::Unread
            }
            _ => Self::rounding(value),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn allows(name: &str, written: f64, found: f32) -> bool {
        Tolerance::of_weather(name, written).allows(written as f32, found)
    }

    #[test]
    fn what_x_plane_makes_of_a_value_is_that_value_and_another_weather_is_not() {
        for (name, written, near, other) in [
            (VISIBILITY_SM, 10.0, 10.9, 11.2),
            (RAIN, 0.8, 0.796, 0.7),
            (CLOUD_COVER, 0.75, 0.76, 0.8),
            (
                "sim/weather/region/cloud_base_msl_m[1]",
                600.0,
                607.0,
                620.0,
            ),
            (CLOUD_TYPE, 1.0, 1.0, 2.0),
            (WIND_SPEED, 5.0, 6.4, 6.6),
            (WIND_DIRECTION, 358.0, 3.0, 5.0),
            (PRESSURE_PA, 101_325.0, 101_400.0, 101_500.0),
            (TEMPERATURE_C, 15.0, 14.2, 13.9),
            (WIND_SPEED_KT_11, 10.0, 12.5, 13.0),
            (PRESSURE_INHG_11, 29.92, 29.94, 29.96),
            (CHANGE_MODE, 3.0, 3.0, 2.0),
        ] {
            assert!(allows(name, written, near), "{name}: {near}");
            assert!(!allows(name, written, other), "{name}: {other}");
        }
        assert!(!allows(VISIBILITY_SM, 10.0, f32::NAN));
        assert!(allows(WIND_ALTITUDE, 540.0, 0.0));
    }
}
