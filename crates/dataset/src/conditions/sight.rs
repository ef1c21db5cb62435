//! Visibility of a ground-truth box's aircraft, as far as the corpus's data determine it.
//!
//! Haze leaves `exp(-3.912 r / V)` of the contrast at the distance r (`transmission` in `boxes_truth.parquet`). Below 2 %, the contrast
//! that defines the visibility V, it is invisible. Clouds hide it where it flies in or above them: their exact shape is not stored, so
//! everything from the base of the lowest layer upwards is classified separately.

use serde::{Deserialize, Serialize};

use crate::conditions::Weather;

/// Contrast that remains over the visibility.
pub const MIN_TRANSMISSION: f64 = 0.02;

/// Medium between the camera and the aircraft.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sight {
    /// Air that one can see through.
    #[serde(rename = "in_sight")]
    Open,
    /// Haze or fog: the aircraft is beyond the visibility.
    Haze,
    /// Perhaps a cloud: the aircraft is not below all clouds.
    Cloud,
}

/// A weather's lowest clouds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CloudBase {
    msl_m: Option<f64>,
}

impl CloudBase {
    /// Only layers that cover something count; an unknown weather has none.
    pub fn of(weather: Option<&Weather>) -> Self {
        let layers = weather.into_iter().flat_map(|weather| &weather.clouds);
        let covering = layers.filter(|layer| layer.cover_ratio > 0.0);
        Self {
            msl_m: covering.map(|layer| layer.base_msl_m).reduce(f64::min),
        }
    }

    /// The medium between a camera and an aircraft at this altitude, given the contrast that arrives.
    pub fn sight(&self, altitude_msl_m: f64, transmission: f64) -> Sight {
        if transmission < MIN_TRANSMISSION {
            Sight::Haze
        } else if self.msl_m.is_none_or(|base_m| altitude_msl_m < base_m) {
            Sight::Open
        } else {
            Sight::Cloud
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn haze_hides_first_and_clouds_may_hide_from_their_base_upwards() {
        let base = CloudBase {
            msl_m: Some(1000.0),
        };
        assert_eq!(base.sight(999.0, 0.5), Sight::Open);
        assert_eq!(base.sight(1000.0, 0.5), Sight::Cloud);
        assert_eq!(base.sight(1000.0, 0.019), Sight::Haze);
        let clear = CloudBase { msl_m: None };
        assert_eq!(clear.sight(9000.0, 0.021), Sight::Open);
    }
}
