//! Distances to touchdown from camera feeds, while they run.
//!
//! Input: a run of `dtd train` and a source per view ([`Source`]): a stream, a video file, a device or a recorded scenario.
//! Output: answers and events as lines ([`Line`]), and counts ([`Metrics`]).
//!
//! ```text
//! clock, error    time of each image; errors
//! queue           hand-over between threads
//! source          image sources: FFmpeg, GPUs
//! view_state      state of a view: up, late, frozen, ..
//! output          lines and metrics; slow readers delay nothing
//! options         options, checked against the run
//! clocks          offsets between the cameras' clocks, measured from common sightings
//! views           two threads per view: feed (opens, decodes, opens again) and search (boxes and camera motion of the newest image)
//! conductor       pairs images of several views, asks the estimator, writes answers; `check` only opens the sources
//! ```
//!
//! Each module imports only modules listed above it.
//!
//! An answer is never older than it says: each has the time of its images, its age and a state.

mod check;
mod clock;
mod clocks;
mod conductor;
mod error;
mod options;
mod output;
mod queue;
mod source;
mod view_state;
mod views;

pub use check::{CheckedSource, check};
pub use clock::ClockSource;
pub use conductor::estimate;
pub use error::{Error, Result};
pub use options::Options;
pub use output::{Answer, AnswerState, Event, Line};
pub use source::{Source, Stream};
pub use view_state::ViewState;
