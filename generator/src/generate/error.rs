//! What can go wrong while a corpus is made.

use std::path::PathBuf;

use xplane_bridge::BridgeError;

use crate::stand_in::StandInError;

/// Why a run could not begin or go on.
#[derive(Debug, thiserror::Error)]
pub enum GenerateError {
    /// The corpus was begun with a plan that the sweep no longer gives.
    #[error(
        "{}: the corpus was begun with another plan: {difference}. A corpus can only be added to: undo the change in the sweep, \
         or use another folder", corpus.display()
    )]
    OtherPlan {
        /// The corpus.
        corpus: PathBuf,
        /// What differs.
        difference: String,
    },
    /// Somebody asked for a scenario that does not exist.
    #[error(
        "there is no scenario {id} among the {scenarios} of the plan; identifiers look like {example}, `dtd plan` lists them"
    )]
    UnknownScenario {
        /// What was asked for.
        id: String,
        /// Number of scenarios in the plan.
        scenarios: usize,
        /// The first of them.
        example: String,
    },
    /// A folder is where a scenario has to go.
    #[error("{}: a folder with this name is there, but {message}; move it away first", folder.display())]
    ForeignFolder {
        /// The folder.
        folder: PathBuf,
        /// What is wrong with it.
        message: &'static str,
    },
    /// The simulator does not answer.
    #[error(transparent)]
    Bridge(#[from] BridgeError),
    /// The stand-in does not start.
    #[error(transparent)]
    StandIn(#[from] StandInError),
    /// The corpus cannot be read or written.
    #[error(transparent)]
    Corpus(#[from] dataset::Error),
}

impl GenerateError {
    /// Whether the caller has to change the input first: the same call will fail again.
    pub fn is_bad_input(&self) -> bool {
        matches!(
            self,
            Self::OtherPlan { .. } | Self::UnknownScenario { .. } | Self::ForeignFolder { .. }
        )
    }
}

/// Why a scenario could not be made.
#[derive(Debug, thiserror::Error)]
pub enum ScenarioError {
    /// The run was stopped.
    #[error("stopped")]
    Cancelled,
    /// Another process is making the same scenario.
    #[error("another process is making it in {}", folder.display())]
    Busy {
        /// Where.
        folder: PathBuf,
    },
    /// The simulator did not do what it should.
    #[error(transparent)]
    Bridge(#[from] BridgeError),
    /// The stand-in does not start again.
    #[error(transparent)]
    StandIn(#[from] StandInError),
    /// The simulator flew something that is no approach.
    #[error("the flight {message}")]
    Flight {
        /// What is wrong with it.
        message: String,
    },
    /// A picture does not show what was asked for.
    #[error("tick {tick}, view {view}: {what} is {found}, expected {expected}")]
    NotInStep {
        /// Tick that was due.
        tick: u32,
        /// View that was due.
        view: String,
        /// What differs.
        what: &'static str,
        /// What the simulator says it drew.
        found: String,
        /// What it was asked to draw.
        expected: String,
    },
    /// A thread that wrote a video broke down.
    #[error("the encoder of view {view} stopped: {message}")]
    Encoder {
        /// The view.
        view: String,
        /// What it said.
        message: String,
    },
    /// Files cannot be written.
    #[error(transparent)]
    Corpus(#[from] dataset::Error),
}
