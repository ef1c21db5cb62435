//! Training settings.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::crop::augmentation::Augmentation;
use crate::error::{Result, in_range};

/// The longest training that can be asked for, minutes: a year.
pub const MAX_MINUTES: f64 = 525_600.0;
/// Smallest value of settings that must be above 0.
const MIN_POSITIVE: f64 = 1e-9;

/// Training length.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Effort {
    /// Minutes of wall-clock time.
    Minutes(f64),
    /// Steps: gives the same weights on every run.
    Steps(u64),
}

/// The training itself.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TrainingConfig {
    /// Length of the training. `--minutes` overrides it.
    pub effort: Effort,
    /// Highest learning rate, at most 1.
    pub learning_rate: f64,
    /// Seed of the first weights and of all crops.
    pub seed: u64,
    /// Detector of this project whose weights the training starts from, instead of random ones. `--start-from` overrides it.
    pub start_from: Option<PathBuf>,
    /// Augmentation of crops.
    pub augmentation: Augmentation,
}

impl Default for TrainingConfig {
    fn default() -> Self {
        Self {
            effort: Effort::Minutes(30.0),
            learning_rate: 2e-3,
            seed: 1,
            start_from: None,
            augmentation: Augmentation::default(),
        }
    }
}

impl TrainingConfig {
    /// Checks that every setting is in its range.
    pub fn check(&self) -> Result<()> {
        if let Effort::Minutes(minutes) = self.effort {
            in_range(
                "training.effort.minutes",
                minutes,
                MIN_POSITIVE..=MAX_MINUTES,
            )?;
        }
        in_range(
            "training.learning_rate",
            self.learning_rate,
            MIN_POSITIVE..=1.0,
        )?;
        self.augmentation.check()
    }
}
