//! Progress and results of a run over a corpus.

use serde::Serialize;

/// Progress of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Units done: scenarios when labelling, pictures when detecting.
    pub done: u64,
    /// Units in all.
    pub total: u64,
}

/// A scenario that failed. The others are processed nevertheless.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Failure {
    /// Identifier of the scenario.
    pub id: String,
    /// Why, in words.
    pub reason: String,
}
