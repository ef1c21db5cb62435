//! The project's own aircraft detector: one class, far below 4 MB, trained on a corpus.
//!
//! Input: a labelled corpus (decoded video pixels and ground-truth boxes). Output: an ONNX model, and next to it a report. The network is a
//! small CenterNet (Zhou et al., 2019) adapted to this task: boxes accurate to a fraction of a pixel, because the distance is derived from
//! them, at any contrast that haze leaves.
//!
//! `network` computes, `grid` defines the meaning of the numbers and what they should be, `loss` compares; `samples` and `crop` feed
//! `training`, which may start from a model; `export` writes the model. The crate `detector-evaluation` measures it.

#![forbid(unsafe_code)]

pub mod crop;
mod detector;
mod error;
pub mod export;
pub mod grid;
pub mod loss;
pub mod network;
pub mod samples;
pub mod training;

pub use detector::{DetectorConfig, DetectorReport, train_detector};
pub use error::{Error, Result};
pub use training::training_config::{Effort, MAX_MINUTES, TrainingConfig};
