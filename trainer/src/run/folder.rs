//! Run folder: the output of `dtd train`, from which estimators are loaded.
//!
//! ```text
//! run/
//!   config.json         settings of the training
//!   run.json            training data, cameras and version
//!   normalisation.json  offset and scale of the features
//!   baselines.json      the fitted formulas: pinholes, centre offsets, inverse range
//!   weights.safetensors all networks
//!   backgrounds.png     what the cameras saw, to compare flights with
//!   convergence.json    errors on the validation side over both stages
//!   replaces.json       identity of the run that this one replaced
//!   metrics.json  predictions.parquet  evaluation.json  report.html     (from `evaluate`)
//!   MANIFEST.b3  DONE.json      the seal, as a scenario has it
//! ```
//!
//! The folder appears and is replaced as a whole ([`crate::run::place`]). Files are checked against the sealed hashes when they are read.

use std::path::{Path, PathBuf};

use dataset::corpus::seal::{DONE, MANIFEST};
use dataset::files::json_file::read_json;
use serde::Deserialize;

/// Paths within a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunFolder {
    root: PathBuf,
}

impl RunFolder {
    /// The run at `root`, whether it exists or not.
    pub fn at(root: &Path) -> Self {
        Self {
            root: root.to_owned(),
        }
    }

    pub(crate) const CONFIG: &str = "config.json";
    pub(crate) const SUMMARY: &str = "run.json";
    pub(crate) const NORMALISATION: &str = "normalisation.json";
    pub(crate) const BASELINES: &str = "baselines.json";
    pub(crate) const WEIGHTS: &str = "weights.safetensors";
    pub(crate) const BACKGROUNDS: &str = "backgrounds.png";
    pub(crate) const CONVERGENCE: &str = "convergence.json";
    pub(crate) const EVALUATION: &str = "evaluation.json";
    pub(crate) const METRICS: &str = "metrics.json";
    pub(crate) const PREDICTIONS: &str = "predictions.parquet";
    pub(crate) const REPORT: &str = "report.html";
    pub(crate) const REPLACES: &str = "replaces.json";
    /// Checkpoint, in `training/` of the folder beside the run.
    pub(crate) const CHECKPOINT: &str = "checkpoint.json";

    /// Files written by a training.
    pub(crate) const TRAINED: [&str; 7] = [
        Self::CONFIG,
        Self::SUMMARY,
        Self::NORMALISATION,
        Self::BASELINES,
        Self::WEIGHTS,
        Self::BACKGROUNDS,
        Self::CONVERGENCE,
    ];

    /// All files that a run may contain, in order of removal: a folder without a summary is not a run.
    pub const FILES: [&str; 14] = [
        Self::SUMMARY,
        Self::BACKGROUNDS,
        Self::CONFIG,
        Self::NORMALISATION,
        Self::BASELINES,
        Self::WEIGHTS,
        Self::CONVERGENCE,
        Self::EVALUATION,
        Self::METRICS,
        Self::PREDICTIONS,
        Self::REPORT,
        Self::REPLACES,
        MANIFEST,
        DONE,
    ];

    /// True if the folder contains a finished run.
    pub fn is_at(root: &Path) -> bool {
        [Self::SUMMARY, Self::CONFIG]
            .iter()
            .all(|name| root.join(name).is_file())
    }

    /// The folder itself.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Hash of the detection model; `None` if the summary cannot be read.
    pub fn model_hash(&self) -> Option<String> {
        #[derive(Deserialize)]
        struct Summary {
            model_hash: String,
        }
        let summary: Summary = read_json(&self.path(Self::SUMMARY), "summary of a run").ok()?;
        Some(summary.model_hash)
    }

    /// File path.
    pub fn path(&self, name: &str) -> PathBuf {
        self.root.join(name)
    }

    /// Path of `weights.safetensors`.
    pub fn weights_path(&self) -> PathBuf {
        self.path(Self::WEIGHTS)
    }

    /// Path of `metrics.json`.
    pub fn metrics_path(&self) -> PathBuf {
        self.path(Self::METRICS)
    }

    /// Path of `predictions.parquet`.
    pub fn predictions_path(&self) -> PathBuf {
        self.path(Self::PREDICTIONS)
    }

    /// Path of `report.html`.
    pub fn report_path(&self) -> PathBuf {
        self.path(Self::REPORT)
    }
}
