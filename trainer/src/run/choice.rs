//! Recommended estimator (`run.json`).

use serde::{Deserialize, Serialize};

/// Recommended estimator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Choice {
    /// Name of the estimator.
    pub estimator: String,
    /// Lateral standard deviation of the training flights, metres.
    pub lateral_spread_m: f64,
    /// Reason, a sentence.
    pub reason: String,
}
