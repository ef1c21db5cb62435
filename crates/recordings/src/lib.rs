//! Recordings of real cameras as a corpus: `dtd import RECORDING.toml --out CORPUS`.
//!
//! ```text
//! RECORDING.toml  -> description: runway, cameras (calibrated, or a first guess with deviations), files
//! tracks          -> generator::tracks -> flight_path: an arrival with its times
//! videos          -> videos: the detector's boxes as tables, kept until the corpus is whole
//! boxes           -> sightings: images with their times, and the boxes in them
//! both            -> coarse_clocks: offsets at which a camera's boxes move like the arrivals
//!                 -> alignment: one robust least squares over clocks, cameras, and each track's delay and errors
//!                 -> matching: which box shows which arrival; a doubtful one shows none
//! all             -> corpus_folder: a scenario per arrival, labelled, with the boxes as detections
//! ```
//!
//! Each scenario states the origin and the standard deviation of its positions, times and
//! labels ([`dataset::corpus::scenario::Recorded`]). The corpus appears as a whole or not at all.

mod alignment;
mod arrow;
mod coarse_clocks;
mod corpus_folder;
mod description;
mod error;
mod flight_path;
mod import;
mod likely_cause;
mod matching;
mod sightings;
mod videos;

pub use error::{Error, Result};
pub use import::{CameraOutcome, ImportOutcome, Refused, import};
