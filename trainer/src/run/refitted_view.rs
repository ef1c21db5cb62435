//! Record of refits (`run.json`).

use serde::{Deserialize, Serialize};

/// Record of one refit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Refit {
    /// View.
    pub view: String,
    /// Scenarios that the view was fitted to.
    pub scenarios: Vec<String>,
    /// BLAKE3 of all numbers that do not belong to the view, in the original run.
    pub frozen_before_blake3: String,
    /// BLAKE3 of all numbers that do not belong to the view, in the new run.
    pub frozen_after_blake3: String,
    /// Wall-clock time, seconds.
    pub refit_s: f64,
}
