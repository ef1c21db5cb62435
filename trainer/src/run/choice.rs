//! The estimator that a training recommends, as `run.json` has it.

use serde::{Deserialize, Serialize};

/// The choice (`run.json`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Choice {
    /// Name of the estimator.
    pub estimator: String,
    /// Standard deviation of the training flights to the side, metres.
    pub lateral_spread_m: f64,
    /// The reason in a sentence.
    pub reason: String,
}
