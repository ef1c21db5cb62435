//! Estimation of the distance to touchdown from bounding boxes in synchronised images, and its evaluation.
//!
//! Input: a corpus with labels and detections. Output: a run folder ([`RunFolder`]) with networks, formulas, figures and a report.
//!
//! ```text
//! samples      corpus ticks: selected boxes, registered shifts, distances
//! background   camera directions from static image content
//! paper        figures that the paper reports
//! networks     layers, training loop and checkpoint
//! estimators   paper_lstm, inverse_range with its filter, cameras and rays (geometry), single views (mono_network, mono_pinhole)
//! run          run folder and estimators
//! live         answers tick by tick, without a corpus
//! evaluation   predictions, metrics and report
//! export       ONNX models
//! training     from a corpus to a run: stages, search, refit
//! ```
//!
//! A module imports only modules above it (`scripts/check_modules.py`).
//!
//! `paper_lstm` is the paper's estimator: a calibration network per camera with a shared auxiliary head, then an LSTM over the views. If
//! the paper leaves a choice open, the module states the choice and the reason; deviating settings are listed ([`config::PaperDeviation`]).

#![forbid(unsafe_code)]

mod background;
pub mod config;
mod error;
mod estimators;
mod evaluation;
mod export;
pub mod live;
mod networks;
pub mod paper;
mod run;
mod samples;
mod training;

pub use background::Alignment;
pub use config::backend::TrainingBackend;
pub use config::{TrainConfig, schema};
pub use error::{Error, Result};
pub use evaluation::figures;
pub use evaluation::judged::JudgedSide;
pub use evaluation::judged_table::{TableEvaluationConfig, TableMetrics, evaluate_table};
pub use evaluation::metrics::{
    ErrorFigures, EstimatorMetrics, Metrics, SideCount, SplitFigures, SplitSummary, TickCounts,
};
pub use evaluation::prediction::{Predicted, predict};
pub use evaluation::rules::EvaluationRules;
pub use evaluation::{EvaluationConfig, evaluate};
pub use export::{Agreement, ExportedModel, ExportedRun, Probes, TOLERANCE, export};
pub use networks::stage::EndedBy;
pub use run::choice::Choice;
pub use run::fitted_cameras::fitted_cameras;
pub use run::folder::RunFolder;
pub use run::refitted_view::Refit;
pub use samples::Moment;
pub use training::refit::{MAX_APPROACHES, RefitConfig, refit};
pub use training::search::{Search, SearchTable, TrainingResult, VariantResult, search};
pub use training::{TrainOutcome, train, train_on_all};
