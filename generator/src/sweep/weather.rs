//! `[weather.NAME]`: the physical values of a weather. Each number may be a spread, from which every scenario draws its own.

use dataset::conditions::{CloudKind, CloudLayer, Weather};
use dataset::numbers::limits;
use schemars::JsonSchema;
use serde::Deserialize;

use super::fault::{Checked, fault, legal_name};
use super::limits::Enforce;
use crate::seed;
use crate::spread::Spread;

/// `[weather.NAME]`: constant in space and time within a scenario.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WeatherTable {
    /// Meteorological visibility (contrast of a black object falls to 2 %), metres.
    #[schemars(transform = limits::VISIBILITY_M.in_schema())]
    pub visibility_m: Spread,
    /// At most three layers, lowest first.
    #[serde(default)]
    #[schemars(length(max = limits::MOST_CLOUD_LAYERS))]
    pub clouds: Vec<CloudTable>,
    /// Rain intensity, 0 none to 1 heavy; 0 by default.
    #[serde(default)]
    #[schemars(transform = limits::RAIN_RATIO.in_schema())]
    pub rain_ratio: Spread,
    /// Wind speed at 10 m above ground, metres per second; 0 by default.
    #[serde(default)]
    #[schemars(transform = limits::WIND_SPEED_MPS.in_schema())]
    pub wind_speed_mps: Spread,
    /// Direction that the wind comes from, degrees true; 0 by default.
    #[serde(default)]
    #[schemars(transform = limits::WIND_FROM_TRUE_DEG.in_schema())]
    pub wind_from_true_deg: Spread,
    /// Turbulence intensity, 0 none to 1 severe; 0 by default.
    #[serde(default)]
    #[schemars(transform = limits::TURBULENCE_RATIO.in_schema())]
    pub turbulence_ratio: Spread,
}

/// One layer of cloud.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CloudTable {
    /// Kind of cloud.
    pub kind: CloudKind,
    /// Part of the sky that it covers, 0 to 1.
    #[schemars(transform = limits::COVER_RATIO.in_schema())]
    pub cover_ratio: Spread,
    /// Height of its base above mean sea level, metres.
    #[schemars(transform = limits::CLOUD_BASE_MSL_M.in_schema())]
    pub base_msl_m: Spread,
    /// Height of its top above mean sea level, metres.
    #[schemars(transform = limits::CLOUD_TOP_MSL_M.in_schema())]
    pub top_msl_m: Spread,
}

impl WeatherTable {
    /// The weather of the scenario with this seed.
    pub(crate) fn draw(&self, scenario_seed: u64) -> Weather {
        let draw = |key: &str, spread: &Spread| {
            spread.draw(&mut seed::of_value(
                scenario_seed,
                &format!("weather.{key}"),
            ))
        };
        let layer = |(index, layer): (usize, &CloudTable)| {
            let draw = |key: &str, spread| draw(&format!("clouds.{index}.{key}"), spread);
            CloudLayer {
                kind: layer.kind,
                cover_ratio: draw("cover_ratio", &layer.cover_ratio),
                base_msl_m: draw("base_msl_m", &layer.base_msl_m),
                top_msl_m: draw("top_msl_m", &layer.top_msl_m),
            }
        };
        Weather {
            visibility_m: draw("visibility_m", &self.visibility_m),
            clouds: self.clouds.iter().enumerate().map(layer).collect(),
            rain_ratio: draw("rain_ratio", &self.rain_ratio),
            wind_speed_mps: draw("wind_speed_mps", &self.wind_speed_mps),
            wind_from_true_deg: draw("wind_from_true_deg", &self.wind_from_true_deg),
            turbulence_ratio: draw("turbulence_ratio", &self.turbulence_ratio),
        }
    }

    /// Rejects what no weather has, over a runway at `ground_msl_m`.
    pub(super) fn check(&self, name: &str, ground_msl_m: f64) -> Checked<()> {
        let key = |field: &str| format!("weather.{name}.{field}");
        legal_name(format!("weather.{name}"), name)?;
        for (field, limits, spread) in [
            ("visibility_m", limits::VISIBILITY_M, &self.visibility_m),
            ("rain_ratio", limits::RAIN_RATIO, &self.rain_ratio),
            (
                "wind_speed_mps",
                limits::WIND_SPEED_MPS,
                &self.wind_speed_mps,
            ),
            (
                "wind_from_true_deg",
                limits::WIND_FROM_TRUE_DEG,
                &self.wind_from_true_deg,
            ),
            (
                "turbulence_ratio",
                limits::TURBULENCE_RATIO,
                &self.turbulence_ratio,
            ),
        ] {
            limits.check_spread(key(field), spread)?;
        }
        if self.clouds.len() > limits::MOST_CLOUD_LAYERS {
            let found = self.clouds.len();
            return fault(
                key("clouds"),
                format!(
                    "{found} cloud layers; expected at most {}",
                    limits::MOST_CLOUD_LAYERS
                ),
            );
        }
        let mut below_msl_m = f64::NEG_INFINITY;
        for (index, layer) in self.clouds.iter().enumerate() {
            let (lowest_top_m, _) = layer.top_msl_m.range();
            if lowest_top_m <= ground_msl_m {
                return fault(
                    key(&format!("clouds.{index}.top_msl_m")),
                    format!(
                        "top at {lowest_top_m} m, but the runway is {ground_msl_m} m above mean sea level; expected clouds above it, \
                         whatever is drawn"
                    ),
                );
            }
            below_msl_m =
                layer.check(below_msl_m, |field| key(&format!("clouds.{index}.{field}")))?;
        }
        Ok(())
    }
}

impl CloudTable {
    /// Checks a layer that may start at `below_msl_m`; returns its maximum top.
    fn check(&self, below_msl_m: f64, key: impl Fn(&str) -> String) -> Checked<f64> {
        limits::COVER_RATIO.check_spread(key("cover_ratio"), &self.cover_ratio)?;
        limits::CLOUD_BASE_MSL_M.check_spread(key("base_msl_m"), &self.base_msl_m)?;
        limits::CLOUD_TOP_MSL_M.check_spread(key("top_msl_m"), &self.top_msl_m)?;
        let (lowest_base, highest_base) = self.base_msl_m.range();
        let (lowest_top, highest_top) = self.top_msl_m.range();
        if lowest_top < highest_base {
            return fault(
                key("top_msl_m"),
                format!(
                    "top at {lowest_top} m, but the base is at {highest_base} m; expected a top above the base, whatever is drawn"
                ),
            );
        }
        if lowest_base < below_msl_m {
            return fault(
                key("base_msl_m"),
                format!(
                    "base at {lowest_base} m, but the layer before reaches to {below_msl_m} m; expected lowest first, apart, whatever is drawn"
                ),
            );
        }
        Ok(highest_top)
    }
}
