//! Locates the aircraft: ground-truth boxes and detections.
//!
//! Input: committed scenarios of a corpus. Output: labels ([`label_corpus`]: geodesic labels in `frames.parquet`, projected ground truth in
//! `boxes_truth.parquet`) and detections ([`detect_corpus`]: `detections/<model>.parquet`, the shifts of the aircraft between views,
//! `registrations/<model>.parquet`, and the condition of the cameras, `health/<model>.parquet`). Labels come from poses and cameras alone,
//! detections from decoded pixels alone; [`matching`] and `statistics` compare the two.

#![forbid(unsafe_code)]

mod detect;
pub mod detector;
mod error;
mod label;
pub mod live;
pub mod matching;
mod outcome;
mod registration;
pub mod tiling;
mod tracking;
mod truth_box;
mod view_health;

pub use detect::{
    CpuTime, DetectOptions, DetectOutcome, Findings, FittedCameras, Mode, ModeSettings,
    RegistrationCounts, Searcher, Unhealthy, detect_corpus,
};
pub use detector::Device;
pub use error::{Error, Result};
pub use label::{LabelOutcome, label_corpus};
pub use matching::false_boxes::FalseBoxes;
pub use matching::statistics::TruthCounts;
pub use outcome::Failure;
pub use tiling::row_band::{RowBand, SearchBands};
