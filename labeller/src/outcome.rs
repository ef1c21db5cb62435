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

/// Progress callback and cancellation for a run.
#[derive(Clone, Copy)]
pub struct Watch<'a> {
    /// Called after every unit.
    pub progress: &'a (dyn Fn(Progress) + Sync),
    /// Polled before every unit, and while the run waits; true stops the run.
    pub is_stopped: &'a (dyn Fn() -> bool + Sync),
}

/// A scenario that failed. The others are processed nevertheless.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Failure {
    /// Identifier of the scenario.
    pub id: String,
    /// Reason, in words.
    pub reason: String,
}
