//! `[split]`: shares of training, validation and test.

use dataset::numbers::limits;
use schemars::JsonSchema;
use serde::Deserialize;

use super::fault::{Checked, fault};
use super::limits::Enforce;

/// `[split]`: shares of the scenarios on each side; they add up to 1. Scenarios with the same trajectory stay together.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SplitFractions {
    /// For training the networks.
    #[schemars(transform = limits::SPLIT_PART.in_schema())]
    pub train: f64,
    /// For decisions during training.
    #[schemars(transform = limits::SPLIT_PART.in_schema())]
    pub validation: f64,
    /// For evaluation only.
    #[schemars(transform = limits::SPLIT_PART.in_schema())]
    pub test: f64,
}

impl Default for SplitFractions {
    fn default() -> Self {
        Self {
            train: 0.6,
            validation: 0.1,
            test: 0.3,
        }
    }
}

impl SplitFractions {
    pub(super) fn check(&self) -> Checked<()> {
        for (side, part) in [
            ("train", self.train),
            ("validation", self.validation),
            ("test", self.test),
        ] {
            limits::SPLIT_PART.check_key(format!("split.{side}"), part)?;
        }
        let sum = self.train + self.validation + self.test;
        if (sum - 1.0).abs() > 1e-6 {
            return fault("split", format!("the parts add up to {sum}, expected 1"));
        }
        Ok(())
    }
}
