//! Distances to touchdown from camera feeds, while they run.
//!
//! Input: a run of `dtd train` and a source for each of its views ([`Source`]): a stream, a video file, a device or a recorded scenario.
//! Output: answers and events, one after another ([`Line`]), and counts ([`Metrics`]).
//!
//! ```text
//! source, place, input, gpu   where images come from; FFmpeg's side of it
//! clock           the time of each image; clocks, free_clocks, vertical_lag, clock_offset: offsets of cameras' clocks, by what both see
//! feed            a thread a view: opens, decodes, opens again; hands over the newest image; open_limit, read_limit, undecoded: when
//!                 a source is given up
//! view_state      whether a view can be measured
//! search          a thread a view: boxes and camera motion of the newest image
//! pairing         images of several views that belong together
//! conductor       joins the views, asks the estimator, writes answers
//! lines, metrics  outputs, which no slow reader delays
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
pub use output::line::{Answer, AnswerState, Event, Line};
pub use options::{Decoder, Options};
pub use options::settings::{Settings, ViewSettings, schema};
pub use source::{Source, Stream};
pub use view_state::ViewState;
