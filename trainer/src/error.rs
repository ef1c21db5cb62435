//! Errors of training, evaluation and reports.

use std::fmt::Display;
use std::path::{Path, PathBuf};

use dataset::work::watch::Stopped;

/// Error of this crate. Every message states the expected and the actual value and, if the user can act, a remedy.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A corpus cannot be read, or a result not written.
    #[error(transparent)]
    Dataset(#[from] dataset::Error),
    /// The corpus cannot be used for training or evaluation as it is.
    #[error("corpus {}: {fault}", path.display())]
    Corpus {
        /// Corpus or scenario folder.
        path: PathBuf,
        /// Fault of the corpus.
        fault: String,
    },
    /// An invalid setting.
    #[error("configuration: {setting} is {found}, expected {expected}")]
    Setting {
        /// Name of the setting with its section.
        setting: String,
        /// Invalid value.
        found: String,
        /// Allowed values.
        expected: String,
    },
    /// A run folder that cannot be used.
    #[error("run {}: {fault}", path.display())]
    Run {
        /// Folder or file of the run.
        path: PathBuf,
        /// Fault of the run.
        fault: String,
    },
    /// A table of predictions that cannot be judged.
    #[error("table {}: {fault}", path.display())]
    Predictions {
        /// File of the table.
        path: PathBuf,
        /// Fault of the table.
        fault: String,
    },
    /// A test trajectory was used for training, so its errors would be meaningless.
    #[error(
        "run {} was trained on trajectory {trajectory}, which corpus {} holds as a test trajectory (scenario {scenario}); \
         evaluate on the corpus it was trained with, or train again with this corpus's split",
        run.display(),
        corpus.display()
    )]
    Leak {
        /// Folder of the run.
        run: PathBuf,
        /// Folder of the corpus.
        corpus: PathBuf,
        /// The trajectory on both sides.
        trajectory: String,
        /// The test scenario that flies it.
        scenario: String,
    },
    /// The network's numbers are no longer finite.
    #[error(
        "training of {network} diverged at step {step}: the loss is not finite; lower its learning_rate"
    )]
    Diverged {
        /// Name of the network.
        network: &'static str,
        /// Step when this was noticed.
        step: usize,
    },
    /// Results would replace a file.
    #[error("{} is there already and is not replaced; remove it, or name another file with --out", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// The caller stopped the work.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// The report cannot be made.
    #[error(transparent)]
    Report(#[from] report_page::Error),
}

/// Results of this crate.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    pub(crate) fn setting(setting: &str, found: impl Display, expected: impl Into<String>) -> Self {
        Self::Setting {
            setting: setting.to_owned(),
            found: found.to_string(),
            expected: expected.into(),
        }
    }

    pub(crate) fn corpus(path: &Path, fault: impl Into<String>) -> Self {
        Self::Corpus {
            path: path.to_owned(),
            fault: fault.into(),
        }
    }

    pub(crate) fn predictions(path: &Path, fault: impl Into<String>) -> Self {
        Self::Predictions {
            path: path.to_owned(),
            fault: fault.into(),
        }
    }

    pub(crate) fn run(path: &Path, fault: impl Into<String>) -> Self {
        Self::Run {
            path: path.to_owned(),
            fault: fault.into(),
        }
    }
}
