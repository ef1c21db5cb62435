//! Answers, events and counts, as they are written.

pub(crate) mod lines;
pub(crate) mod metrics;
pub(crate) mod metrics_server;

use serde::Serialize;
use trainer::live::{Cause, Phase, Shown};

use crate::clock::ClockSource;
use crate::view_state::ViewState;

/// Maximum age of images for a fresh answer, s. Without newer images, the aircraft is predicted.
pub(crate) const MAX_FRESH_S: f64 = 0.3;
/// Maximum age of the aircraft's last images for a prediction, s.
pub(crate) const MAX_COASTING_S: f64 = 5.0;

/// Answer freshness.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum AnswerState {
    /// Measured in this tick's images.
    Fresh,
    /// Predicted from earlier images.
    Coasting,
    /// The aircraft is no longer known.
    #[default]
    Lost,
}

/// An answer about an aircraft at a time.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Answer {
    /// Time of the images, seconds: since the first one, for recordings their own.
    pub time_s: f64,
    /// `time_s` in UTC; null for recordings.
    pub time_utc: Option<String>,
    /// Number of the aircraft.
    pub track: u32,
    /// `arrival` or `other`.
    pub phase: &'static str,
    /// Distance to touchdown, metres; null unless fresh or coasting.
    pub dtd_m: Option<f64>,
    /// Standard deviation of `dtd_m`.
    pub dtd_sd_m: Option<f64>,
    /// Ends of the 90 % interval.
    pub dtd_from_m: Option<f64>,
    /// See `dtd_from_m`.
    pub dtd_to_m: Option<f64>,
    /// Speed over ground.
    pub ground_speed_mps: Option<f64>,
    /// Until touchdown.
    pub time_to_touchdown_s: Option<f64>,
    /// Position, if the run has fitted cameras.
    pub latitude_deg: Option<f64>,
    /// See `latitude_deg`.
    pub longitude_deg: Option<f64>,
    /// Height above mean sea level.
    pub height_m: Option<f64>,
    /// Standard deviation of the position.
    pub position_sd_m: Option<f64>,
    /// Views whose boxes were used.
    pub views: Vec<String>,
    /// Age of the images when the line was made, seconds.
    pub age_s: f64,
    /// Freshness.
    pub state: AnswerState,
}

impl Answer {
    pub(crate) fn lost(track: u32, time_s: f64, age_s: f64) -> Self {
        Self {
            time_s,
            track,
            phase: Phase::Other.word(),
            age_s,
            ..Self::default()
        }
    }
}

/// An event.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Event {
    /// The estimation began.
    Start {
        /// Time, as of answers.
        time_s: f64,
        /// BLAKE3 of the run.
        run: String,
        /// Name of the estimator that answers.
        estimator: String,
        /// The sources, without secrets.
        sources: Vec<(String, String)>,
    },
    /// A view changed its state.
    View {
        /// Time, as of answers.
        time_s: f64,
        /// Name of the view.
        view: String,
        /// State from now on.
        state: ViewState,
        /// The cause, and what to do about it.
        why: Option<String>,
        /// Origin of its images' times.
        clock: Option<ClockSource>,
    },
    /// Images were not searched, or lines were dropped, since the last such event.
    Overload {
        /// Time, as of answers.
        time_s: f64,
        /// Images by view.
        not_searched: Vec<(String, u64)>,
        /// Lines that no reader took.
        dropped_lines: u64,
    },
    /// A clock's offset that is used from now on.
    Offset {
        /// Time, as of answers.
        time_s: f64,
        /// Name of the view.
        view: String,
        /// Added to the view's image times, s; null: unknown, so the view is not used together with the first one.
        offset_s: Option<f64>,
        /// Standard deviation; null if the offset was given.
        sd_s: Option<f64>,
        /// Drift, s per million s.
        drift_ppm: Option<f64>,
        /// Standard deviation of that.
        drift_sd_ppm: Option<f64>,
    },
    /// A camera's surroundings were compared with the training's, and it does not look as it did there.
    Camera {
        /// Time, as of answers.
        time_s: f64,
        /// Name of the view.
        view: String,
        /// What it shows.
        #[serde(flatten)]
        surroundings: Surroundings,
    },
    /// A view sees an aircraft that has no distance from it, or this is over.
    Withheld {
        /// Time, as of answers.
        time_s: f64,
        /// Name of the view.
        view: String,
        /// Name of the reason; null if it is over.
        reason: Option<&'static str>,
        /// What that means, and what to do about it.
        why: Option<String>,
    },
    /// The estimation ended.
    End {
        /// Time, as of answers.
        time_s: f64,
        /// `recordings`, `signal`, or `reader` if the reader of the lines is gone.
        cause: &'static str,
        /// Searched and other images by view.
        images: Vec<(String, u64, u64)>,
    },
}

/// Reason why a view does not count for the distance of an aircraft that it sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Reason {
    /// It shows the ground of a different view.
    OtherView,
    /// It shows other ground than in the training.
    Elsewhere,
    /// The camera was turned, and its new direction is unknown.
    Turned,
    /// The offset of its clock is unknown.
    Clock,
    /// What it sees contradicts another view, the training's paths, or an approach.
    Contradicts(Cause),
    /// Boxes have other places or sizes than in the training.
    Unlike,
    /// No answer uses its boxes.
    Unpaired,
    /// The estimator has no distance.
    NoDistance,
}

impl Reason {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::OtherView => "other_view",
            Self::Elsewhere => "elsewhere",
            Self::Turned => "turned",
            Self::Clock => "clock",
            Self::Contradicts(_) => "contradicts",
            Self::Unlike => "unlike",
            Self::Unpaired => "unpaired",
            Self::NoDistance => "no_distance",
        }
    }

    /// What that means, and what to do about it.
    pub(crate) fn why(self) -> String {
        let why = match self {
            Self::OtherView => {
                "it shows what a different view showed in the training: are the sources exchanged?"
            }
            Self::Elsewhere => {
                "it shows other surroundings than in the training; if it was replaced or turned far, `dtd refit` learns it again"
            }
            Self::Turned => {
                "it was turned, and what it shows now could not be compared with the training; if it stays so, `dtd refit` learns it again"
            }
            Self::Clock => {
                "the offset of its clock is unknown until both views have seen an aircraft; `--keep-offsets` stores it for the next start"
            }
            Self::Contradicts(cause) => return cause.to_string(),
            Self::Unlike => {
                "it sees the aircraft at a place or in a size that the training has not seen"
            }
            Self::Unpaired => "what it sees does not match what the other views see",
            Self::NoDistance => {
                "the estimator has no distance for the aircraft yet, or it is too uncertain"
            }
        };
        why.into()
    }
}

/// What a camera shows of its surroundings, beside the training's.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Surroundings {
    /// `usual`, `moved`, `other_view`, `elsewhere` or `unknown`.
    pub shows: &'static str,
    /// Shift of a moved camera, pixels right and down.
    pub shift_px: Option<[f64; 2]>,
    /// What that means, and what to do about it.
    pub why: Option<String>,
}

impl Surroundings {
    pub(crate) fn of(shown: &Shown) -> Self {
        let (shows, shift_px, why) = match shown {
            Shown::Usual => ("usual", None, None),
            Shown::Moved(off_px) => (
                "moved",
                Some(off_px.to_array()),
                Some(format!(
                    "it points elsewhere than in the training: its image is displaced by up to {:.1} px right and {:.1} px down; boxes are corrected",
                    off_px.x, off_px.y
                )),
            ),
            Shown::OtherView(other) => (
                "other_view",
                None,
                Some(format!(
                    "it shows what {other} showed in the training: are the sources exchanged? It is not used"
                )),
            ),
            Shown::Elsewhere => (
                "elsewhere",
                None,
                Some(
                    "it shows other surroundings than in the training, and is not used; if it was replaced or turned far, `dtd refit` learns it \
                     again"
                        .to_owned(),
                ),
            ),
            Shown::Unknown => (
                "unknown",
                None,
                Some(
                    "it shows too little of its surroundings to compare them, as in fog, or the run has none: it is expected in its usual \
                     direction, and intervals are wider"
                        .to_owned(),
                ),
            ),
        };
        Self {
            shows,
            shift_px,
            why,
        }
    }
}

/// A line of output.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Line {
    /// An answer.
    Answer(Box<Answer>),
    /// An event.
    Event(Event),
}
