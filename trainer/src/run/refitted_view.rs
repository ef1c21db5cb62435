//! A view that was fitted again after the training, as `run.json` has it.

use serde::{Deserialize, Serialize};

/// Record of a refit (`run.json`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Refit {
    /// The view.
    pub view: String,
    /// The scenarios that it was fitted to.
    pub scenarios: Vec<String>,
    /// BLAKE3 of all numbers that do not belong to the view, before: of the run that this one was made from.
    pub frozen_before_blake3: String,
    /// The same after.
    pub frozen_after_blake3: String,
    /// Wall-clock time, seconds.
    pub refit_s: f64,
}
