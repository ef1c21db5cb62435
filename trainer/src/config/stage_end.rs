//! Ends of training stages: a number of steps, or a plateau.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// End of a training stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum StageEnd {
    /// The stage trains in cycles, each twice as long as the one before. The learning rate rises and falls once per cycle. The stage ends
    /// when a whole cycle lowers no validation error by more than `calibration.plateau_threshold_pct`, and keeps the last weights.
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
    /// Minimum fall of the errors over a cycle, percentage points.
    pub(crate) threshold_pct: f64,
}
