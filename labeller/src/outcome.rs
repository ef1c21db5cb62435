//! What a run over a corpus reports while it goes and when it ends.

use serde::Serialize;

/// How far a run has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Units done: scenarios when labelling, pictures when detecting.
    pub done: u64,
    /// Units in all.
    pub total: u64,
}

/// A scenario that could not be done. The others are done nevertheless.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Failure {
    /// Identifier of the scenario.
    pub id: String,
    /// Why, in words.
    pub reason: String,
}
