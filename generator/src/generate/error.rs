//! Errors while recording a corpus.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Duration;

use dataset::corpus::effective_weather::WeatherDifference;
use flight_model::NotLanded;
use store::StoreError;
use tokio::task::JoinError;
use xplane_bridge::BridgeError;

use super::space;
use crate::generate::stand_in::StandInError;
use crate::trajectory::{BadFlight, TrafficFault};

/// The simulator must keep a frame's pose and its time together; this is the user's remedy when it does not.
const WHAT_TO_DO_ABOUT_A_LIVE_FLIGHT: &str = "It was flown live: if the simulator hitched (scenery that loads, another program), let it \
     settle, lower its graphics until `dtd doctor` finds 20 frames a second or more, and run the same command again";

/// Reasons why a run could not start or continue.
#[derive(Debug, thiserror::Error)]
pub enum GenerateError {
    /// The corpus was started from a plan that the sweep no longer produces.
    #[error(
        "{}: the corpus was started from a different sweep: {difference}. A corpus can only be added to: undo the change in the \
         sweep, or use another folder", corpus.display()
    )]
    OtherPlan {
        /// The corpus.
        corpus: PathBuf,
        /// Difference between the two plans.
        difference: String,
    },
    /// An option, a folder or a store that must be changed first.
    #[error("{0}")]
    BadInput(String),
    /// A foreign folder has a scenario's name.
    #[error("{}: a folder with this name is there, but {message}; move it away first, then the scenario will be recorded again", folder.display())]
    ForeignFolder {
        /// The folder.
        folder: PathBuf,
        /// Fault of the folder.
        message: String,
    },
    /// The run was cancelled before anything was written.
    #[error("stopped before anything was made")]
    Cancelled,
    /// The simulator does not answer, the stand-in does not start, or the tape contains no session to record from.
    #[error(transparent)]
    Simulator(Box<ScenarioError>),
    /// The object store of the corpus cannot be used.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The corpus cannot be read or written.
    #[error(transparent)]
    Corpus(#[from] dataset::Error),
}

fn no_session(tape: &Path, cause: &ScenarioError) -> String {
    format!(
        "tape {}: it gives no session to make scenarios from ({}); a tape is as long as its recorder ran: record the session \
         again with `dtd tape`, to its end",
        tape.display(),
        why_no_session(cause)
    )
}

/// Describes a tape's fault; for a simulator the advice would be to switch something on.
fn why_no_session(error: &ScenarioError) -> String {
    match error {
        ScenarioError::Bridge(BridgeError::NobodyAnswers { .. } | BridgeError::NoPlugin { .. }) => {
            "no client was answered and greeted on it".into()
        }
        other => other.to_string(),
    }
}

impl GenerateError {
    /// True if the caller must change the input first: the same call will fail again.
    pub fn is_bad_input(&self) -> bool {
        match self {
            Self::OtherPlan { .. } | Self::BadInput(_) | Self::ForeignFolder { .. } => true,
            // A path where no corpus can be created.
            Self::Corpus(dataset::Error::Io { source, .. }) => matches!(
                source.kind(),
                ErrorKind::NotFound | ErrorKind::NotADirectory | ErrorKind::PermissionDenied
            ),
            Self::Corpus(error) => error.is_bad_content(),
            Self::Store(error) => error.is_bad_input(),
            Self::Simulator(error) => match error.as_ref() {
                ScenarioError::Tape { .. } => true,
                ScenarioError::Bridge(BridgeError::Pixels(error)) => error.is_bad_input(),
                _ => false,
            },
            _ => false,
        }
    }

    /// True if the same call may succeed later.
    pub fn is_passing(&self) -> bool {
        match self {
            Self::Cancelled => true,
            Self::Corpus(error) => error.is_passing(),
            _ => false,
        }
    }
}

/// Reasons why a scenario could not be recorded.
#[derive(Debug, thiserror::Error)]
pub enum ScenarioError {
    /// The run was cancelled.
    #[error("stopped")]
    Cancelled,
    /// The simulator is connected, but no image arrives.
    #[error(
        "the simulator did not answer within {:.1} s while images were taken: it is frozen or cut off",
        waited.as_secs_f64()
    )]
    Frozen {
        /// Time waited.
        waited: Duration,
    },
    /// The simulator did not follow a request.
    #[error(transparent)]
    Bridge(#[from] BridgeError),
    /// The simulator has a different version after a restart.
    #[error(
        "the simulator was {before} when the run began, and is {found} now: its images may differ. Run the same command again to \
         go on with this version"
    )]
    OtherSimulator {
        /// Simulator and plugin when the run began.
        before: String,
        /// Simulator and plugin now.
        found: String,
    },
    /// The stand-in does not start again.
    #[error(transparent)]
    StandIn(#[from] StandInError),
    /// The tape that acts as the simulator does not even send a greeting.
    #[error("{}", no_session(tape, cause))]
    Tape {
        /// The tape.
        tape: PathBuf,
        /// Cause.
        cause: Box<ScenarioError>,
    },
    /// The tape that acts as the simulator has a different session. A retry cannot help.
    #[error(
        "tape {}: this is not the session that was recorded: {what}. Replay the sweep that it was recorded with, or record this one",
        tape.display()
    )]
    NotOnTape {
        /// The tape.
        tape: PathBuf,
        /// The first difference.
        what: String,
    },
    /// The flown path is not an approach.
    #[error("the flight {0}")]
    Flight(BadFlight),
    /// The simulator flew something that is not a flight.
    #[error("the flight {0} {WHAT_TO_DO_ABOUT_A_LIVE_FLIGHT}")]
    LiveFlight(BadFlight),
    /// The other aircraft of the plan cannot be in the scenario.
    #[error(transparent)]
    Traffic(#[from] TrafficFault),
    /// The plan has a flight that the sweep cannot give.
    #[error("the plan does not match the sweep: {0}")]
    NoFlight(String),
    /// The flight model does not land.
    #[error(transparent)]
    NotLanded(#[from] NotLanded),
    /// An image does not match its request.
    #[error("tick {tick}, view {view}: the simulator did not draw what was requested: {what}")]
    NotInStep {
        /// Tick that was due.
        tick: u32,
        /// View that was due.
        view: String,
        /// Difference between the drawn and the expected state.
        what: String,
    },
    /// An image is empty.
    #[error(
        "tick {tick}, view {view}: the image is of one colour, {color:?}, from edge to edge; expected a view of {visibility_m:.0} m. Is the \
         simulator's window covered, minimised or still loading?"
    )]
    Blank {
        /// Tick of the image.
        tick: u32,
        /// View of the image.
        view: String,
        /// Red, green, blue.
        color: [u8; 3],
        /// The visibility, metres.
        visibility_m: f64,
    },
    /// A thread that wrote a video left early.
    #[error("the encoder of view {view} stopped: it ended before the last image")]
    EncoderEnded {
        /// The view.
        view: String,
    },
    /// A thread panicked.
    #[error("{task} failed: {cause}")]
    Panicked {
        /// Work of the thread.
        task: String,
        /// Panic message.
        cause: JoinError,
    },
    /// Files cannot be written.
    #[error(transparent)]
    Corpus(#[from] dataset::Error),
}

/// Cause of a failed attempt, which decides the run's next step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Blame {
    /// The run was cancelled.
    Nobody,
    /// The disk: every scenario would fail.
    Storage,
    /// The simulator as it is set up: every scenario would fail with it.
    Setup,
    /// The simulator: it may be gone.
    Simulator,
    /// Presumably the scenario itself.
    Scenario,
}

impl ScenarioError {
    /// Wraps the panic of a thread that did `task`.
    pub(super) fn panicked(task: impl Into<String>) -> impl FnOnce(JoinError) -> Self {
        let task = task.into();
        move |cause| Self::Panicked { task, cause }
    }

    /// Interprets an error if a tape acts as the simulator: the recorded client did something else; no plugin holds a dataref, no menu is
    /// open.
    pub(super) fn of_tape(self, tape: &Path) -> Self {
        let what = match self {
            Self::Bridge(BridgeError::Refused { text, .. }) => text,
            Self::Bridge(BridgeError::NotTaken {
                name,
                wanted,
                found,
                ..
            }) => match found {
                Some(found) => format!("{name} was {found} then, and is {wanted} now"),
                None => format!("{name}, which is {wanted} now, is not on it"),
            },
            Self::Bridge(BridgeError::NotReady(text)) => text,
            other => return other,
        };
        Self::NotOnTape {
            tape: tape.to_owned(),
            what,
        }
    }

    /// True if the next attempt at the same scenario would fail in the same way. A live flight differs each time.
    pub(super) fn is_certain(&self) -> bool {
        matches!(
            self,
            Self::NotOnTape { .. }
                | Self::Flight(_)
                | Self::NoFlight(_)
                | Self::NotLanded(_)
                | Self::Traffic(_)
                | Self::Corpus(dataset::Error::Corpus { .. })
                | Self::Bridge(
                    BridgeError::BadConditions(_)
                        | BridgeError::Packet(_)
                        | BridgeError::Refused { repeats: true, .. }
                )
        )
    }

    /// True if every scenario would fail with this simulator until the setup is changed.
    pub(super) fn is_setup(&self) -> bool {
        match self {
            Self::OtherSimulator { .. } => true,
            Self::Bridge(error) => error.is_setup(),
            _ => false,
        }
    }

    /// [`Self::is_setup`], and the simulator is there: one that is starting, or in a menu, has no plugin yet.
    pub(super) fn is_bad_setup(&self) -> bool {
        self.is_setup() && !matches!(self, Self::Bridge(BridgeError::NoPlugin { .. }))
    }

    /// True if no simulator answers, which says nothing about the scenario.
    pub(super) fn is_silence(&self) -> bool {
        matches!(self, Self::Bridge(BridgeError::NobodyAnswers { .. }))
    }

    /// Difference of the weather at the aircraft, if that is the reason.
    pub(super) fn weather_difference(&self) -> Option<WeatherDifference> {
        match self {
            Self::Bridge(BridgeError::OtherWeatherShows { difference, .. }) => Some(*difference),
            _ => None,
        }
    }

    pub(super) fn blame(&self, corpus: &Path) -> Blame {
        match self {
            Self::Cancelled => Blame::Nobody,
            Self::Corpus(error) if space::is_storage_failure(error, corpus) => Blame::Storage,
            Self::Frozen { .. } | Self::StandIn(_) | Self::Tape { .. } => Blame::Simulator,
            // An X-Plane that is starting answers before its plugin does.
            Self::Bridge(BridgeError::NoPlugin { .. }) => Blame::Simulator,
            error if error.is_setup() => Blame::Setup,
            Self::Bridge(error) => match error {
                BridgeError::Refused { .. }
                | BridgeError::BadConditions(_)
                | BridgeError::NotTaken { .. }
                | BridgeError::OtherWeatherShows { .. }
                | BridgeError::Packet(_) => Blame::Scenario,
                _ => Blame::Simulator,
            },
            _ => Blame::Scenario,
        }
    }
}

#[cfg(test)]
mod tests {
    use xplane_bridge::datarefs::BadConditions;
    use xplane_bridge::link::PictureSize;
    use xplane_bridge::pixels::PixelError;

    use super::*;

    fn refused(doing: &'static str, repeats: bool) -> ScenarioError {
        let text = "no".into();
        ScenarioError::Bridge(BridgeError::Refused {
            doing,
            text,
            repeats,
        })
    }

    fn other_window() -> ScenarioError {
        let size = |width_px| PictureSize {
            width_px,
            height_px: 1280,
        };
        ScenarioError::Bridge(BridgeError::Pixels(PixelError::OtherWindow {
            wanted: size(1920),
            window: size(1900),
            may_have_margins: false,
        }))
    }

    #[test]
    fn what_every_scenario_would_meet_is_the_setups_and_what_one_meets_again_is_certain() {
        let too_few = BadFlight::TooFewStates { states: 1 };
        let no_plugin = || BridgeError::NoPlugin {
            address: ([127, 0, 0, 1], 49_000).into(),
            waited: Duration::ZERO,
        };
        let wrong_aircraft = BridgeError::Setup("C172, expected B738".into());
        let unplayable = BridgeError::BadConditions(BadConditions("a day of 400".into()));
        for (error, blame, certain) in [
            (other_window(), Blame::Setup, false),
            (wrong_aircraft.into(), Blame::Setup, false),
            (refused("hello", true), Blame::Setup, true),
            // A plugin may still be starting, but if it never comes the setup is wrong.
            (no_plugin().into(), Blame::Simulator, false),
            (refused("hello", false), Blame::Scenario, false),
            (refused("a flight", false), Blame::Scenario, false),
            (refused("a flight", true), Blame::Scenario, true),
            (unplayable.into(), Blame::Scenario, true),
            (
                ScenarioError::Flight(too_few.clone()),
                Blame::Scenario,
                true,
            ),
            // The next one may be flown without a hitch.
            (ScenarioError::LiveFlight(too_few), Blame::Scenario, false),
        ] {
            assert_eq!(error.blame(Path::new(".")), blame, "{error}");
            assert_eq!(error.is_certain(), certain, "{error}");
        }
        assert!(ScenarioError::from(no_plugin()).is_setup());
    }
}
