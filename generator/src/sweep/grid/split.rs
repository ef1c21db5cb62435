//! `[split]`: shares of training, validation and test.

use dataset::numbers::limits;
use schemars::JsonSchema;
use serde::Deserialize;

use crate::sweep::check::fault::{Checked, fault};
use crate::sweep::check::limits::in_schema;

/// `[split]`: shares of the scenarios on each side; they add up to 1. Scenarios with the same trajectory stay together.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SplitFractions {
    /// Share for training the networks; 0.6 without `[split]`.
    #[schemars(transform = in_schema(limits::SPLIT_PART))]
    pub train: f64,
    /// Share for decisions during training; 0.1 without `[split]`.
    #[schemars(transform = in_schema(limits::SPLIT_PART))]
    pub validation: f64,
    /// Share for evaluation only; 0.3 without `[split]`.
    #[schemars(transform = in_schema(limits::SPLIT_PART))]
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
    pub(crate) fn check(&self) -> Checked<()> {
        let sum = self.train + self.validation + self.test;
        if (sum - 1.0).abs() > 1e-6 {
            return fault("split", format!("the parts add up to {sum}, expected 1"));
        }
        Ok(())
    }
}
