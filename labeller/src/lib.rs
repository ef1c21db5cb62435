//! Locates the aircraft: ground-truth boxes and detections.
//!
//! Input: committed scenarios of a corpus. Output: labels ([`label_corpus`]: geodesic labels in `frames.parquet`, projected ground truth in
//! `boxes_truth.parquet`) and detections ([`detect_corpus`]: `detections/<model>.parquet`, the shifts of the aircraft between views,
//! `registrations/<model>.parquet`, the condition of the cameras, `health/<model>.parquet`, and their surroundings,
//! `backgrounds/<model>.parquet`). Labels come from poses and cameras alone, detections from decoded pixels alone; [`matching`] compares
//! the two.
//!
//! [`Searcher::view_search`] searches endless camera images with the same code and bounded memory. `dtd detect` also writes the
//! results that each image would have had there: `counts_live` and `state_live`.

#![forbid(unsafe_code)]

mod detect;
pub mod detector;
mod error;
mod label;
pub mod matching;
mod registration;
pub mod tiling;
mod tracking;
mod truth_box;
mod view_health;

pub use detect::{
    CpuTime, DetectOptions, DetectOutcome, Findings, FittedCameras, Image, ImageFindings, Mode,
    RegistrationCounts, Searcher, SeenBox, Unhealthy, VideoImages, ViewSearch, detect_corpus,
    register_views,
};
pub use detector::Device;
pub use error::{Error, Failure, Result};
pub use label::{LabelOutcome, label_corpus, labels_of};
pub use matching::false_boxes::FalseBoxes;
pub use matching::statistics::TruthCounts;
pub use registration::Patch;
pub use tiling::row_band::{RowBand, SearchBands};
