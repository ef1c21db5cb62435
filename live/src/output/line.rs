//! Answers and events, as they are written.

use serde::Serialize;

use crate::clocks::clock::ClockSource;
use crate::view_state::ViewState;

/// Freshness of an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum AnswerState {
    /// Measured from the images of its time.
    Fresh,
    /// Predicted from earlier images.
    Coasting,
    /// Nothing is known any more.
    Lost,
}

/// An answer about an aircraft at a time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Answer {
    /// Time of the images, seconds: since the first one, for recordings their own.
    pub time_s: f64,
    /// The same in UTC; null for recordings.
    pub time_utc: Option<String>,
    /// Number of the aircraft.
    pub track: u32,
    /// `arrival` or `other`.
    pub phase: &'static str,
    /// Distance to touchdown, metres; null unless fresh or coasting.
    pub dtd_m: Option<f64>,
    /// Its standard deviation.
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
        /// Source of the times of its images.
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
        /// Added to the times of its images, seconds; null: unknown, so that it is not used together with the first view.
        offset_s: Option<f64>,
        /// Its standard deviation; null if it was given.
        sd_s: Option<f64>,
        /// By how much it grows, seconds per million seconds.
        drift_ppm: Option<f64>,
        /// Standard deviation of that.
        drift_sd_ppm: Option<f64>,
    },
    /// Views that see an aircraft are not used for it from now on.
    Withheld {
        /// Time, as of answers.
        time_s: f64,
        /// Its number in the answers.
        track: u32,
        /// Names of the views.
        views: Vec<String>,
        /// The cause, and what to do about it.
        why: String,
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

/// A line of output.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Line {
    /// An answer.
    Answer(Box<Answer>),
    /// An event.
    Event(Event),
}
