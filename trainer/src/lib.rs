//! Estimates the distance to touchdown from boxes in synchronised pictures, and evaluates the estimates.
//!
//! Input: a corpus with labels and detections. Output: a run folder ([`RunFolder`]) with networks, formulas, figures and a report.
//!
//! ```text
//! samples -> normalisation -> (trajectory_mixing) -> calibration_training -> paper_lstm --+
//!       |-> mono_network, pinhole, triangulation (baselines) -----------------------------+
//!       |-> self_calibration (choice) ----------------------------------------------------+
//!       \-> inverse_range -> flight_filter -----------------------------------------------+-> evaluation -> metrics, report
//! ```
//!
//! `paper_lstm` is the paper's: a calibration network per camera with a shared auxiliary head, then an LSTM over the views. Where the
//! paper leaves a choice open, the module states the choice and the reason; settings that deviate from it are named
//! ([`config::PaperDeviation`]).

#![forbid(unsafe_code)]

mod answers;
mod background;
mod calibration_training;
mod checkpoint;
mod choice;
pub mod config;
mod dense;
mod encoded;
mod error;
mod estimator;
mod evaluation;
mod evaluation_rules;
mod fitted_camera;
mod flight_filter;
mod flight_parts;
mod gap_balance;
mod head_refit;
mod inverse_range;
mod json_differences;
mod lateral_spread;
mod leave_out;
mod lstm;
mod marked_scenarios;
mod memory;
mod metrics;
mod minimum;
mod mono_network;
mod normalisation;
mod onnx;
mod paper_lstm;
mod pinhole;
mod prediction;
mod prediction_table;
mod refit;
mod report;
mod rig;
mod row_parts;
mod run_folder;
mod run_place;
mod samples;
mod sealed_run;
mod search;
mod self_calibration;
mod start;
mod trained_run;
mod training;
mod training_backend;
mod training_loop;
mod trajectory_mixing;
mod triangulation;
mod trusted_boxes;
mod view_dropout;
mod view_removal;
mod view_shift;

pub use background::Alignment;
pub use choice::Choice;
pub use config::{TrainConfig, schema};
pub use error::{CorpusFault, Error, Result, RunFault};
pub use evaluation::{EvaluationConfig, JudgedSide, evaluate};
pub use evaluation_rules::EvaluationRules;
pub use inverse_range::{Outcome, RefittedResidual};
pub use metrics::Metrics;
pub use onnx::{
    Agreement, ExportedModel, ExportedRun, Probes, REGISTRATION_NUMBERS, TOLERANCE, export,
};
pub use prediction::{Predicted, predict};
pub use refit::{MOST_APPROACHES, Refit, RefitConfig, refit};
pub use run_folder::RunFolder;
pub use search::{Search, SearchTable, TrainingResult, VariantResult, search};
pub use training::{TrainOutcome, train, train_on_all};
pub use training_backend::TrainingBackend;
