//! Errors of training a detector.

use std::ops::RangeInclusive;
use std::path::PathBuf;

use burn::store::RecordError;
use dataset::corpus::splits::Side;
use dataset::work::watch::Stopped;

/// An error of this crate. Every message says what was expected, what was found and, if the user can act, how.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A corpus cannot be read, or a result not written.
    #[error(transparent)]
    Dataset(#[from] dataset::Error),
    /// The corpus cannot be used for training as it is.
    #[error("corpus {}: {fault}", path.display())]
    Corpus {
        /// Folder of the corpus, or of one of its scenarios.
        path: PathBuf,
        /// Fault of the corpus.
        fault: CorpusFault,
    },
    /// The model cannot be made at this path.
    #[error("run {}: {fault}", path.display())]
    Output {
        /// The model's file, or the folder of its checkpoint.
        path: PathBuf,
        /// Fault of the path.
        fault: OutputFault,
    },
    /// An invalid setting.
    #[error("configuration: {setting} is {found}, expected {expected}")]
    Setting {
        /// Name of the setting with its section.
        setting: String,
        /// Its value.
        found: String,
        /// Allowed values.
        expected: String,
    },
    /// A model whose weights cannot be the first ones.
    #[error(
        "{}: is no detector that `dtd train-detector` wrote, so that training cannot start from its weights; start from such a model, or \
         from none",
        path.display()
    )]
    Start {
        /// The model's file.
        path: PathBuf,
    },
    /// The caller stopped the training.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// The network's numbers are no longer finite.
    #[error(
        "training of detector diverged at step {step}: the loss is not finite; lower its learning_rate"
    )]
    Diverged {
        /// Step at which this was noticed.
        step: u64,
    },
}

/// Reasons why a corpus cannot be used for training.
#[derive(Debug, thiserror::Error)]
pub enum CorpusFault {
    /// No scenario to train or to judge with.
    #[error(
        "has no recorded scenario on the {} side of its split; generate and label it first",
        .0.iter().map(Side::to_string).collect::<Vec<_>>().join(" or ")
    )]
    NoScenarios(Vec<Side>),
    /// A view of a scenario is not in its calibration.
    #[error("has no camera {view} in calibration.json; generate it again")]
    NoCamera {
        /// The view.
        view: String,
    },
    /// The training scenarios show no visible aircraft.
    #[error(
        "shows no visible aircraft in its training scenarios; do the ground-truth boxes belong to these videos?"
    )]
    NothingVisible,
}

/// Reasons why a model cannot be written to a path.
#[derive(Debug, thiserror::Error)]
pub enum OutputFault {
    /// It is no file.
    #[error("is a folder; expected the name of a file")]
    Folder,
    /// It is another file.
    #[error(
        "is not a detector that `dtd train-detector` wrote there, with its report beside it; move it away, or give another --out"
    )]
    Taken,
    /// Its report would replace something else.
    #[error("would have its report in {}, where something else lies; move that away, or give another --out", report.display())]
    ReportTaken {
        /// Path of the report.
        report: PathBuf,
    },
    /// The checkpoint is one of another training.
    #[error(
        "holds an unfinished training with other settings ({found}); repeat those to resume it, or delete the folder"
    )]
    OtherSettings {
        /// The settings.
        found: String,
    },
    /// The numbers of the checkpoint cannot be read or written.
    #[error("cannot read or write the checkpoint: {0}; delete the folder to train from the start")]
    Checkpoint(RecordError),
}

/// Results of this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// Checks the value of a setting.
pub(crate) fn in_range(setting: &str, found: f64, allowed: RangeInclusive<f64>) -> Result<()> {
    // NaN is never in range.
    if allowed.contains(&found) {
        return Ok(());
    }
    Err(Error::Setting {
        setting: setting.to_owned(),
        found: format!("{found:?}"),
        expected: format!("a number from {} to {}", allowed.start(), allowed.end()),
    })
}
