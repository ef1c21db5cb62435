//! The vertical approach profile, as a sweep defines it, a plan fixes it and a simulator flies it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::numbers::units::{METERS_PER_FOOT, METERS_PER_NAUTICAL_MILE};

/// The vertical approach profile. Laterally all profiles follow the localizer.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum ApproachProfile {
    /// Level until the aircraft meets the glide path, then down the glide path.
    GlidePath {
        /// Altitude of the level segment above mean sea level, metres.
        level_altitude_msl_m: f64,
    },
    /// Level at the upper altitude until a fix, down to the lower altitude faster than the glide path, level there until the glide path is
    /// met. The defaults are the chart of WSSS 02L: 2500 ft until D7.6, 1500 ft until D4.4.
    StepDown {
        /// Upper level above mean sea level, metres.
        #[serde(default = "chart_upper_msl_m")]
        upper_altitude_msl_m: f64,
        /// Distance of the first fix before the threshold (Changi's DME reads zero there), metres.
        #[serde(default = "chart_step_from_threshold_m")]
        step_from_threshold_m: f64,
        /// Lower level above mean sea level, metres. It is left where the glide path crosses it.
        #[serde(default = "chart_lower_msl_m")]
        lower_altitude_msl_m: f64,
    },
    /// No level segment: from the start straight towards the glide path, and down it.
    ContinuousDescent {
        /// Altitude of the start above mean sea level, metres.
        start_altitude_msl_m: f64,
    },
}

fn chart_upper_msl_m() -> f64 {
    2_500.0 * METERS_PER_FOOT
}

fn chart_lower_msl_m() -> f64 {
    1_500.0 * METERS_PER_FOOT
}

fn chart_step_from_threshold_m() -> f64 {
    7.6 * METERS_PER_NAUTICAL_MILE
}

impl ApproachProfile {
    /// The step-down approach of the WSSS 02L chart, for a runway that is higher by this much.
    pub fn charted_step_down(higher_m: f64) -> Self {
        Self::StepDown {
            upper_altitude_msl_m: chart_upper_msl_m() + higher_m,
            step_from_threshold_m: chart_step_from_threshold_m(),
            lower_altitude_msl_m: chart_lower_msl_m() + higher_m,
        }
    }

    /// A step-down approach; omitted values are as in the chart of WSSS 02L.
    pub fn step_down(
        upper_altitude_msl_m: Option<f64>,
        step_from_threshold_m: Option<f64>,
        lower_altitude_msl_m: Option<f64>,
    ) -> Self {
        Self::StepDown {
            upper_altitude_msl_m: upper_altitude_msl_m.unwrap_or_else(chart_upper_msl_m),
            step_from_threshold_m: step_from_threshold_m
                .unwrap_or_else(chart_step_from_threshold_m),
            lower_altitude_msl_m: lower_altitude_msl_m.unwrap_or_else(chart_lower_msl_m),
        }
    }

    /// Altitude above mean sea level where flights of this profile begin, metres.
    pub fn start_altitude_msl_m(&self) -> f64 {
        match *self {
            Self::GlidePath {
                level_altitude_msl_m,
            } => level_altitude_msl_m,
            Self::StepDown {
                upper_altitude_msl_m,
                ..
            } => upper_altitude_msl_m,
            Self::ContinuousDescent {
                start_altitude_msl_m,
            } => start_altitude_msl_m,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_down_without_numbers_is_the_chart() {
        let parsed: ApproachProfile = serde_json::from_str(r#"{"kind":"step_down"}"#).unwrap();
        assert_eq!(parsed, ApproachProfile::charted_step_down(0.0));
        assert!((parsed.start_altitude_msl_m() - 762.0).abs() < 1e-9);
    }

    #[test]
    fn an_unknown_key_of_a_profile_is_refused() {
        let text = r#"{"kind":"glide_path","level_altitude_msl_m":762.0,"level_ft":2500}"#;
        assert!(serde_json::from_str::<ApproachProfile>(text).is_err());
    }
}
