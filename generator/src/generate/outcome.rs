//! What a run came to.

use serde::Serialize;

/// What happened to the scenarios of a run, each list in the order of the plan.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Outcome {
    /// Made by this run; for a corpus in an object store: and sent there.
    pub committed: Vec<String>,
    /// Whole already, or made by others while this run waited.
    pub skipped: Vec<String>,
    /// Set aside, with the reason of the last attempt.
    pub failed: Vec<FailedScenario>,
    /// Neither: the run was stopped before.
    pub not_made: Vec<String>,
    /// Made, but not sent to the object store yet: the next run on this stage does.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub staged: Vec<String>,
    /// Why the run ended before its time, if it did.
    pub stopped: Option<Stopped>,
}

/// A scenario that could not be made.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct FailedScenario {
    /// Its identifier.
    pub id: String,
    /// Why.
    pub reason: String,
}

/// Why a run ended before all its scenarios had their turn.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(tag = "cause", rename_all = "snake_case")]
pub enum Stopped {
    /// Somebody wished so.
    Interrupted,
    /// No simulator is left.
    NoSimulator {
        /// What the last one's failure was.
        reason: String,
    },
    /// The object store does not take what was made.
    Store {
        /// What it said, where everything is, how to go on.
        reason: String,
    },
    /// The corpus cannot be written any more.
    Storage {
        /// What was being written, what happened, how much space there is and is needed.
        reason: String,
    },
}
