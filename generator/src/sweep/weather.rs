//! `[weather.NAME]`: physical values. Each number may be a spread to draw from per scenario.

use dataset::conditions::{CloudKind, CloudLayer, Weather};
use dataset::numbers::limits;
use schemars::JsonSchema;
use serde::Deserialize;

use super::check::fault::{Checked, Fault, fault, legal_name};
use super::check::limits::{check_spread, in_schema};
use crate::spread::Spread;

/// Unsupported quantities, and the reasons.
const UNSUPPORTED: [(&str, &str); 3] = [
    ("snow", SNOW),
    ("snow_ratio", SNOW),
    (
        "temperature_c",
        "temperature is not supported: X-Plane and the flight model always have the standard atmosphere, 15 degrees Celsius at sea level",
    ),
];
const SNOW: &str = "snow is not supported: X-Plane shows snow only below freezing, temperature cannot be set, and the bundled simulator does not draw it; rain_ratio and a lower visibility_m are the nearest";

/// Finds an unsupported quantity.
pub(super) fn unsupported(sweep: &toml::Table) -> Option<Fault> {
    let weathers = sweep.get("weather")?.as_table()?;
    weathers.iter().find_map(|(name, table)| {
        let table = table.as_table()?;
        let (key, missing) = UNSUPPORTED
            .iter()
            .find(|(key, _)| table.contains_key(*key))?;
        Some(Fault {
            key: format!("weather.{name}.{key}"),
            message: (*missing).to_owned(),
        })
    })
}

/// `[weather.NAME]`: constant in space and time within a scenario.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WeatherTable {
    /// Meteorological visibility (contrast of a black object falls to 2 %), metres.
    #[schemars(transform = in_schema(limits::VISIBILITY_M))]
    pub visibility_m: Spread,
    /// Cloud layers, at most three, lowest first.
    #[serde(default)]
    #[schemars(length(max = limits::MAX_CLOUD_LAYERS))]
    pub clouds: Vec<CloudTable>,
    /// Rain intensity, 0 none to 1 heavy; 0 by default.
    #[serde(default)]
    #[schemars(transform = in_schema(limits::RAIN_RATIO))]
    pub rain_ratio: Spread,
    /// Wind speed at 10 m above ground, metres per second; 0 by default.
    #[serde(default)]
    #[schemars(transform = in_schema(limits::WIND_SPEED_MPS))]
    pub wind_speed_mps: Spread,
    /// Direction that the wind comes from, degrees true; 0 by default.
    #[serde(default)]
    #[schemars(transform = in_schema(limits::WIND_FROM_TRUE_DEG))]
    pub wind_from_true_deg: Spread,
    /// Turbulence intensity, 0 none to 1 severe; 0 by default.
    #[serde(default)]
    #[schemars(transform = in_schema(limits::TURBULENCE_RATIO))]
    pub turbulence_ratio: Spread,
}

/// A cloud layer.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(extend("allOf" = [
    { "oneOf": [{ "required": ["base_msl_m"] }, { "required": ["base_above_runway_m"] }] },
    { "oneOf": [{ "required": ["top_msl_m"] }, { "required": ["top_above_runway_m"] }] },
]))]
pub struct CloudTable {
    /// Kind of cloud.
    pub kind: CloudKind,
    /// Covered part of the sky, 0 to 1.
    #[schemars(transform = in_schema(limits::COVER_RATIO))]
    pub cover_ratio: Spread,
    /// Base above mean sea level, metres. Either this or `base_above_runway_m`.
    #[schemars(transform = in_schema(limits::CLOUD_BASE_MSL_M))]
    pub base_msl_m: Option<Spread>,
    /// Base above the runway, metres.
    #[schemars(transform = in_schema(limits::CLOUD_BASE_MSL_M))]
    pub base_above_runway_m: Option<Spread>,
    /// Top above mean sea level, metres. Either this or `top_above_runway_m`.
    #[schemars(transform = in_schema(limits::CLOUD_TOP_MSL_M))]
    pub top_msl_m: Option<Spread>,
    /// Top above the runway, metres.
    #[schemars(transform = in_schema(limits::CLOUD_TOP_MSL_M))]
    pub top_above_runway_m: Option<Spread>,
}

impl WeatherTable {
    /// The weather of the scenario with this seed, over a runway at `ground_msl_m`.
    pub(crate) fn draw(&self, scenario_seed: u64, ground_msl_m: f64) -> Weather {
        let draw =
            |key: &str, spread: &Spread| spread.value(scenario_seed, &format!("weather.{key}"));
        let layer = |(index, layer): (usize, &CloudTable)| {
            let draw = |key: &str, spread| draw(&format!("clouds.{index}.{key}"), spread);
            // A checked layer has both.
            let [base, top] = layer.heights(ground_msl_m)?;
            Some(CloudLayer {
                kind: layer.kind,
                cover_ratio: draw("cover_ratio", &layer.cover_ratio),
                base_msl_m: draw("base_msl_m", &base),
                top_msl_m: draw("top_msl_m", &top),
            })
        };
        Weather {
            visibility_m: draw("visibility_m", &self.visibility_m),
            clouds: self.clouds.iter().enumerate().filter_map(layer).collect(),
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
        if self.clouds.len() > limits::MAX_CLOUD_LAYERS {
            let found = self.clouds.len();
            return fault(
                key("clouds"),
                format!(
                    "{found} cloud layers; expected at most {}",
                    limits::MAX_CLOUD_LAYERS
                ),
            );
        }
        let mut below_msl_m = f64::NEG_INFINITY;
        for (index, layer) in self.clouds.iter().enumerate() {
            let heights = layer.heights(ground_msl_m).ok_or_else(|| Fault {
                key: key(&format!("clouds.{index}")),
                message: "expected one of base_msl_m and base_above_runway_m, and one of top_msl_m and top_above_runway_m".into(),
            })?;
            let (lowest_top_m, _) = heights[1].range();
            if lowest_top_m <= ground_msl_m {
                return fault(
                    key(&format!("clouds.{index}.top_msl_m")),
                    format!(
                        "top at {lowest_top_m} m, but the runway is {ground_msl_m} m above mean sea level; expected clouds above it, \
                         whatever is drawn"
                    ),
                );
            }
            below_msl_m = layer.check(&heights, below_msl_m, |field| {
                key(&format!("clouds.{index}.{field}"))
            })?;
        }
        Ok(())
    }
}

impl CloudTable {
    /// Base and top above mean sea level, metres; `None` unless each is given once.
    fn heights(&self, ground_msl_m: f64) -> Option<[Spread; 2]> {
        let above_sea = |msl_m: &Option<Spread>, above_m: &Option<Spread>| match (msl_m, above_m) {
            (Some(msl_m), None) => Some(msl_m.clone()),
            (None, Some(above_m)) => Some(above_m.higher_by(ground_msl_m)),
            _ => None,
        };
        Some([
            above_sea(&self.base_msl_m, &self.base_above_runway_m)?,
            above_sea(&self.top_msl_m, &self.top_above_runway_m)?,
        ])
    }

    /// Checks a layer with this base and top that may start at `below_msl_m`; returns its maximum top.
    fn check(
        &self,
        [base, top]: &[Spread; 2],
        below_msl_m: f64,
        key: impl Fn(&str) -> String,
    ) -> Checked<f64> {
        // Above a high runway, a height within its own limits may be out of range above mean sea level.
        check_spread(key("base_above_runway_m"), base, limits::CLOUD_BASE_MSL_M)?;
        check_spread(key("top_above_runway_m"), top, limits::CLOUD_TOP_MSL_M)?;
        let (lowest_base, highest_base) = base.range();
        let (lowest_top, highest_top) = top.range();
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
