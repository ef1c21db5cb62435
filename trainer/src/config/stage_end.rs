//! The end of a stage of a training: a number of steps, or its plateau.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The end of a stage of a training.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum StageEnd {
    /// The stage trains in cycles, each twice as long as the one before, over each of which the learning rate rises and falls. It ends when
    /// a whole cycle lowers no validation error by more than `calibration.plateau_threshold_pct`, and keeps the last weights.
    /// `optimisation.steps` is a limit.
    Plateau,
    /// All `optimisation.steps` are made, as one cycle.
    Steps,
}

/// The plateau that ends a stage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Plateau {
    /// Steps of the first cycle.
    pub(crate) first_cycle: usize,
    /// Least fall of an error over a cycle that counts, percentage points.
    pub(crate) threshold_pct: f64,
}
