//! The effective weather: the simulator's report at the aircraft once the written weather had had time to show.
//!
//! Input: the planned [`Weather`] and the reported values. Output: the quantities that differ from the plan. A simulator may store written
//! values, return them on reading, and draw something else; only its report at the aircraft states the drawn weather. X-Plane 12 reports
//! these quantities; no tolerance is zero, because haze, gusts and a cloud's edge contribute to the report.
//!
//! If a quantity that was measured to follow the written value differs, the attempt fails; any other marks the scenario, because it may
//! mean something else than its name says.

mod reported;

use std::collections::BTreeSet;
use std::fmt;

use serde::{Deserialize, Serialize};

use crate::conditions::Weather;
use crate::numbers::limits::{self, Check, Limits, check_fields};

pub use reported::{Range, ReportedWeather};

/// Haze, share of the planned visibility.
const VISIBILITY_RATIO: f64 = 0.1;
/// Gusts and the boundary layer, share of the planned wind speed ...
const WIND_RATIO: f64 = 0.25;
/// ... and at least this much. A lighter wind has no direction worth comparing.
const MIN_WIND_MPS: f64 = 2.5;
const WIND_FROM_DEG: f64 = 20.0;
/// Tolerance of rain and of cover, which changes at a cloud's edge.
const RATIO_TOLERANCE: f64 = 0.15;

/// A quantity that a simulator reports at the aircraft.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EffectiveQuantity {
    /// Meteorological visibility.
    Visibility,
    /// Speed of the wind.
    WindSpeed,
    /// The direction that the wind comes from.
    WindDirection,
    /// Intensity of rain.
    Rain,
    /// Cover of the cloud layers.
    CloudCover,
}

impl EffectiveQuantity {
    /// All quantities.
    pub const ALL: [Self; 5] = [
        Self::Visibility,
        Self::WindSpeed,
        Self::WindDirection,
        Self::Rain,
        Self::CloudCover,
    ];

    /// True if a reported value agrees with the planned one; false for NaN.
    pub fn is_met(self, planned: f64, found: f64) -> bool {
        let off = (found - planned).abs();
        match self {
            Self::Visibility => off <= planned.abs() * VISIBILITY_RATIO,
            Self::WindSpeed => off <= (planned * WIND_RATIO).max(MIN_WIND_MPS),
            Self::WindDirection => {
                let around = off.rem_euclid(360.0);
                around.min(360.0 - around) <= WIND_FROM_DEG
            }
            Self::Rain | Self::CloudCover => off <= RATIO_TOLERANCE,
        }
    }

    /// True if a reported value is plausible: a number within limits that are far wider than a plan's.
    pub fn can_be(self, value: f64) -> bool {
        self.limits().hold(value)
    }

    fn limits(self) -> Limits {
        match self {
            Self::Visibility => limits::REPORTED_VISIBILITY_M,
            Self::WindSpeed => limits::REPORTED_WIND_SPEED_MPS,
            Self::WindDirection => limits::REPORTED_WIND_FROM_DEG,
            Self::Rain | Self::CloudCover => limits::REPORTED_RATIO,
        }
    }

    /// A value of this quantity as text, with its unit.
    fn with_unit(self, value: f64) -> String {
        match self {
            Self::Visibility => format!("{value:.0} m"),
            Self::WindSpeed => format!("{value:.1} m/s"),
            Self::WindDirection => format!("{value:.0} degrees"),
            Self::Rain | Self::CloudCover => format!("{value:.2}"),
        }
    }
}

impl fmt::Display for EffectiveQuantity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Visibility => "visibility",
            Self::WindSpeed => "wind speed",
            Self::WindDirection => "wind direction",
            Self::Rain => "rain",
            Self::CloudCover => "cloud cover",
        })
    }
}

/// The weather that a simulator reported at the aircraft, and the quantities that are not as planned.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct EffectiveWeather {
    /// Meteorological visibility, metres; null if it was not reported, as everywhere here.
    pub visibility_m: Option<f64>,
    /// Wind speed, metres per second. Null where its unit is unknown.
    pub wind_speed_mps: Option<f64>,
    /// Direction that the wind comes from, degrees true. Null for a light wind, which has no direction worth comparing.
    pub wind_from_true_deg: Option<f64>,
    /// Rain intensity, 0 to 1.
    pub rain_ratio: Option<f64>,
    /// Part of the sky that each layer covers, 0 to 1, the lowest layer first.
    pub cloud_cover_ratios: [Option<f64>; limits::MAX_CLOUD_LAYERS],
    /// The quantities that differ from the planned weather beyond their tolerances. A scenario with any is *marked*.
    pub differing: BTreeSet<EffectiveQuantity>,
}

/// A quantity that is not as planned.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct WeatherDifference {
    /// The quantity that differs.
    pub quantity: EffectiveQuantity,
    /// The planned value, in the unit of the record.
    pub planned: f64,
    /// The reported value; missing if none was reported, or one that cannot be.
    pub found: Option<f64>,
}

impl fmt::Display for WeatherDifference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            quantity,
            planned,
            found,
        } = *self;
        match found {
            Some(found) => write!(f, "{quantity} is {}", quantity.with_unit(found))?,
            None => write!(f, "{quantity} is not reported")?,
        }
        write!(f, ", planned was {}", quantity.with_unit(planned))
    }
}

impl EffectiveWeather {
    /// The quantities that are worth comparing under a planned weather, with their planned and reported values: cloud cover layer by layer.
    fn compared(&self, planned: &Weather) -> Vec<(EffectiveQuantity, f64, Option<f64>)> {
        use EffectiveQuantity as Quantity;
        let mut compared = Vec::new();
        let mut compare = |quantity, planned, found| compared.push((quantity, planned, found));
        compare(
            Quantity::Visibility,
            planned.visibility_m,
            self.visibility_m,
        );
        compare(
            Quantity::WindSpeed,
            planned.wind_speed_mps,
            self.wind_speed_mps,
        );
        if has_direction(planned) {
            compare(
                Quantity::WindDirection,
                planned.wind_from_true_deg,
                self.wind_from_true_deg,
            );
        }
        compare(Quantity::Rain, planned.rain_ratio, self.rain_ratio);
        for (layer, found) in self.cloud_cover_ratios.into_iter().enumerate() {
            let cloud = planned.clouds.get(layer);
            let cover = cloud.map_or(0.0, |cloud| cloud.cover_ratio);
            compare(Quantity::CloudCover, cover, found);
        }
        compared
    }

    /// The quantities whose reported values differ from the planned weather, each once, by its first value that does.
    pub fn differences(&self, planned: &Weather) -> Vec<WeatherDifference> {
        self.those(planned, |quantity, planned, found| {
            found.is_some_and(|found| !quantity.is_met(planned, found))
        })
    }

    /// The quantities that mark the scenario, with their reported values.
    pub fn marks(&self, planned: &Weather) -> Vec<WeatherDifference> {
        self.those(planned, |quantity, planned, found| {
            self.differing.contains(&quantity)
                && !found.is_some_and(|found| quantity.is_met(planned, found))
        })
    }

    /// The quantities that were not reported, although they are worth comparing.
    pub fn missing(&self, planned: &Weather) -> Vec<WeatherDifference> {
        self.those(planned, |_, _, found| found.is_none())
    }

    fn those(
        &self,
        planned: &Weather,
        is_one: impl Fn(EffectiveQuantity, f64, Option<f64>) -> bool,
    ) -> Vec<WeatherDifference> {
        let mut found_ones: Vec<WeatherDifference> = Vec::new();
        for (quantity, planned, found) in self.compared(planned) {
            let is_new = found_ones.iter().all(|one| one.quantity != quantity);
            if is_new && is_one(quantity, planned, found) {
                found_ones.push(WeatherDifference {
                    quantity,
                    planned,
                    found,
                });
            }
        }
        found_ones
    }

    /// Adds the quantities that differ only in a later reading, as read then.
    #[must_use]
    pub fn with_new_differences(mut self, later: &Self) -> Self {
        for quantity in later.differing.iter().copied() {
            if !self.differing.insert(quantity) {
                continue;
            }
            match quantity {
                EffectiveQuantity::Visibility => self.visibility_m = later.visibility_m,
                EffectiveQuantity::WindSpeed => self.wind_speed_mps = later.wind_speed_mps,
                EffectiveQuantity::WindDirection => {
                    self.wind_from_true_deg = later.wind_from_true_deg;
                }
                EffectiveQuantity::Rain => self.rain_ratio = later.rain_ratio,
                EffectiveQuantity::CloudCover => self.cloud_cover_ratios = later.cloud_cover_ratios,
            }
        }
        self
    }

    /// True if the scenario is marked.
    pub fn is_marked(&self) -> bool {
        !self.differing.is_empty()
    }

    /// A quantity's reported value; for clouds, the largest cover.
    pub fn value(&self, quantity: EffectiveQuantity) -> Option<f64> {
        match quantity {
            EffectiveQuantity::Visibility => self.visibility_m,
            EffectiveQuantity::WindSpeed => self.wind_speed_mps,
            EffectiveQuantity::WindDirection => self.wind_from_true_deg,
            EffectiveQuantity::Rain => self.rain_ratio,
            EffectiveQuantity::CloudCover => self
                .cloud_cover_ratios
                .into_iter()
                .flatten()
                .max_by(f64::total_cmp),
        }
    }

    /// Checks for numbers outside their limits.
    pub(crate) fn check(&self, check: &mut Check) {
        check_fields!(
            check,
            self,
            optional {
                visibility_m: limits::REPORTED_VISIBILITY_M,
                wind_speed_mps: limits::REPORTED_WIND_SPEED_MPS,
                wind_from_true_deg: limits::REPORTED_WIND_FROM_DEG,
                rain_ratio: limits::REPORTED_RATIO,
            }
        );
        for (layer, cover) in self.cloud_cover_ratios.into_iter().enumerate() {
            if let Some(cover) = cover {
                let field = format!("cloud_cover_ratios[{layer}]");
                check.number(&field, cover, limits::REPORTED_RATIO);
            }
        }
    }

    /// Contradictions within the record: values that differ without a mark, and marks without values that differ.
    pub fn contradiction(&self, planned: &Weather) -> Option<String> {
        let unmarked = self
            .differences(planned)
            .into_iter()
            .find(|difference| !self.differing.contains(&difference.quantity));
        if let Some(difference) = unmarked {
            return Some(format!("{difference}, and it is not among `differing`"));
        }
        let marks = self.marks(planned);
        let groundless = (self.differing.iter())
            .find(|quantity| marks.iter().all(|mark| mark.quantity != **quantity));
        groundless.map(|quantity| format!("{quantity} is among `differing`, and is as planned"))
    }
}

/// True if the wind is strong enough for its direction to be compared.
pub fn has_direction(planned: &Weather) -> bool {
    planned.wind_speed_mps > MIN_WIND_MPS
}

#[cfg(test)]
mod tests;
