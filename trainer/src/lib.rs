//! Estimates the distance to touchdown from boxes in synchronised pictures, and evaluates the estimates.
//!
//! Input: a corpus with labels and detections. Output: a run folder ([`RunFolder`]) with networks, formulas, figures and a report.
//!
//! ```text
//! samples -> normalisation -> (trajectory_mixing) -> calibration_training -> paper_lstm --+
//!       \-> inverse_range; mono_network, pinhole, triangulation (baselines) --------------+-> evaluation -> metrics, report
//! ```
//!
//! The method is the paper's: a calibration network per camera with a shared auxiliary head, then an LSTM over the views. Where the
//! paper leaves a choice open, the module states the choice and the reason.

#![forbid(unsafe_code)]

mod calibration_training;
pub mod config;
mod dense;
mod encoded;
mod error;
mod estimator;
mod evaluation;
mod gap_balance;
mod head_refit;
mod inverse_range;
mod lstm;
mod memory;
mod metrics;
mod minimum;
mod mono_network;
mod normalisation;
mod paper_lstm;
mod pinhole;
mod report;
mod rig;
mod run_folder;
mod run_place;
mod samples;
mod sealed_run;
mod trained_run;
mod training;
mod training_loop;
mod trajectory_mixing;
mod triangulation;
mod trusted_boxes;
mod view_dropout;
mod view_shift;

pub use config::{TrainConfig, schema};
pub use error::{CorpusFault, Error, Result, RunFault};
pub use evaluation::{EvaluationConfig, evaluate};
pub use metrics::Metrics;
pub use run_folder::RunFolder;
pub use training::{TrainOutcome, train};
