//! Progress and results of a run over a corpus.

use std::ops::ControlFlow;

use serde::Serialize;

/// Progress of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Units done: scenarios when labelling, pictures when detecting.
    pub done: u64,
    /// Units in all.
    pub total: u64,
}

/// Told after every unit of a run; says whether to go on.
pub type Watch<'a> = &'a (dyn Fn(Progress) -> ControlFlow<()> + Sync);

/// A scenario that failed. The others are processed nevertheless.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Failure {
    /// Identifier of the scenario.
    pub id: String,
    /// Why, in words.
    pub reason: String,
}
