//! Distances to touchdown from camera feeds, while they run.
//!
//! Input: a run of `dtd train` and a source for each of its views ([`Source`]): a stream, a video file, a device or a recorded scenario.
//! Output: answers and events, one after another ([`Line`]), and counts ([`Metrics`]).
//!
//! ```text
//! source, input   where images come from; FFmpeg's side of it
//! clock           the time of each image
//! feed            a thread a view: opens, decodes, opens again; hands over the newest image
//! view_state      whether a view can be measured
//! search          a thread a view: boxes and camera motion of the newest image
//! pairing         images of several views that belong together
//! conductor       joins the views, asks the estimator, writes answers
//! lines, metrics  outputs, which no slow reader delays
//! ```
//!
//! An answer is never older than it says: each has the time of its images, its age and a state.

#![forbid(unsafe_code)]

mod access_unit;
mod clock;
mod error;
mod feed;
mod image_look;
mod input;
mod lines;
mod metrics;
mod pairing;
mod slot;
mod source;
mod view_state;

pub use error::{Error, Result};
pub use lines::{Line, Lines};
pub use metrics::Metrics;
pub use source::Source;
pub use view_state::ViewState;
