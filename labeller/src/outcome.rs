//! Results of a run over a corpus.

use serde::Serialize;

/// A scenario that failed. The others are processed nevertheless.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Failure {
    /// Identifier of the scenario.
    pub id: String,
    /// Reason, in words.
    pub reason: String,
}
