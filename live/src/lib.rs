//! Distances to touchdown from camera feeds, while they run.
//!
//! Input: a run of `dtd train` and a source for each of its views ([`Source`]): a stream, a video file, a device or a recorded scenario.
//! Output: answers and events, one after another ([`Line`]), and counts ([`Metrics`]).
//!
//! ```text
//! source       sources of images: FFmpeg's side of them, GPUs
//! clocks       the time of each image; offsets of cameras' clocks, measured from what both see
//! feed         a thread per view: opens, decodes, opens again; hands over the newest image; time limits of a source
//! view_state   the condition of a view: measured, late, frozen, ..
//! search       a thread per view: boxes and camera motion of the newest image
//! conductor    joins images of several views that belong together, asks the estimator, writes answers
//! output       lines and metrics, which no slow reader delays
//! ```
//!
//! An answer is never older than it says: each has the time of its images, its age and a state.

mod check;
mod clocks;
mod conductor;
mod error;
mod feed;
mod options;
mod output;
mod search;
mod shared;
mod source;
mod view_state;

pub use check::{Found, check};
pub use clocks::clock::ClockSource;
pub use conductor::estimate;
pub use error::{Error, Result};
pub use options::settings::{Settings, ViewSettings, schema};
pub use options::{Decoder, Options};
pub use output::line::{Answer, AnswerState, Event, Line};
pub use source::{Source, Stream};
pub use view_state::ViewState;
