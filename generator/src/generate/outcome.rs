//! Run results.

use serde::Serialize;

/// Outcome of all scenarios, each list in plan order.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Outcome {
    /// Recorded by this run; for a corpus in an object store also uploaded.
    pub committed: Vec<String>,
    /// Complete already, or recorded by others while this run waited.
    pub skipped: Vec<String>,
    /// Scenarios of `committed` drawn in different weather than planned, with the differences.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub marked: Vec<MarkedScenario>,
    /// Set aside, with the reason of the last attempt.
    pub failed: Vec<FailedScenario>,
    /// Neither: the run was stopped before.
    pub not_made: Vec<String>,
    /// Recorded, but not uploaded to the object store yet: the next run on this stage does that.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub staged: Vec<String>,
    /// Reason for an early end of the run, if any.
    pub stopped: Option<Stopped>,
}

/// A scenario that could not be recorded.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct FailedScenario {
    /// Scenario identifier.
    pub id: String,
    /// Reason.
    pub reason: String,
}

/// A scenario whose weather at the aircraft differs from the planned one.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct MarkedScenario {
    /// Scenario identifier.
    pub id: String,
    /// Differences between the two.
    pub differences: Vec<String>,
}

/// Reasons why a run ended before it tried all its scenarios.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(tag = "cause", rename_all = "snake_case")]
pub enum Stopped {
    /// It was cancelled.
    Interrupted,
    /// No simulator is left.
    NoSimulator {
        /// The failure of the last one.
        reason: String,
    },
    /// No simulator is left, and with the last one every scenario would fail until somebody changes something.
    Setup {
        /// Required change.
        reason: String,
    },
    /// The object store does not accept the scenarios.
    Store {
        /// Store's message, location of all files, way to resume.
        reason: String,
    },
    /// The corpus cannot be written any more.
    Storage {
        /// File being written, error, and the space that is available and needed.
        reason: String,
    },
}
