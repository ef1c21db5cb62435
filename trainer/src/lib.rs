//! Estimates the distance to touchdown from boxes in synchronised pictures, and evaluates the estimates.
//!
//! Input: a corpus with labels and detections. Output: a run folder ([`run_folder`]) with networks, formulas, figures and a report.
//!
//! ```text
//! samples -> normalisation -> (trajectory_mixing) -> calibration_training -> paper_lstm --+
//!       \-> mono_network, pinhole, triangulation (baselines) -----------------------------+-> evaluation -> metrics, report
//! ```
//!
//! The method is the paper's: a calibration network per camera with a shared auxiliary head, then an LSTM over the views. Where the
//! paper leaves a choice open, the module states the choice and the reason. [`detector`] is independent of all this: it trains the
//! network that finds the aircraft in the pictures.

#![forbid(unsafe_code)]

pub mod calibration_training;
pub mod config;
pub mod dense;
pub mod detector;
pub mod encoded;
pub mod error;
pub mod evaluation;
pub mod gap_balance;
pub mod head_refit;
pub mod lstm;
mod memory;
pub mod metrics;
pub mod mono_network;
pub mod normalisation;
pub mod paper_lstm;
pub mod pinhole;
pub mod progress;
pub mod report;
pub mod run_folder;
mod run_place;
pub mod samples;
pub mod schedule;
mod sealed_run;
pub mod training;
pub mod trajectory_mixing;
pub mod triangulation;
pub mod trusted_boxes;
pub mod view_dropout;

pub use config::TrainConfig;
pub use error::{Error, Result};
pub use evaluation::{EvaluationConfig, evaluate};
pub use metrics::Metrics;
pub use progress::{Progress, Silent};
pub use run_folder::RunFolder;
pub use training::{TrainOutcome, train};
