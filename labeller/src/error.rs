//! Errors of labelling and detection.

use std::path::{Path, PathBuf};

use dataset::work::watch::Stopped;
use serde::Serialize;

/// A labelling or detection error. Every message names its subject.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file of the corpus cannot be read or written.
    #[error(transparent)]
    Dataset(#[from] dataset::Error),
    /// A scenario's files contradict each other or need something that is not supported.
    #[error("scenario {id}: {message}")]
    Scenario {
        /// Identifier of the scenario.
        id: String,
        /// Expectation, finding and remedy.
        message: String,
    },
    /// The caller stopped the run.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// ONNX Runtime cannot be found or started.
    #[error("ONNX Runtime: {0}")]
    Runtime(String),
    /// A detector's model cannot be used.
    #[error("model {}: {message}", path.display())]
    Model {
        /// The model file.
        path: PathBuf,
        /// Expectation, finding and remedy.
        message: String,
    },
    /// An option is out of range.
    #[error("option {name} is {found}, expected {expected}")]
    Option {
        /// Name of the option.
        name: &'static str,
        /// Given value.
        found: String,
        /// Allowed values.
        expected: String,
    },
}

/// A scenario that failed. The others are processed nevertheless.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Failure {
    /// Identifier of the scenario.
    pub id: String,
    /// Reason, in words.
    pub reason: String,
}

/// Reason why a model cannot be used. The caller names the model.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub(crate) struct ModelFault(String);

impl ModelFault {
    pub(crate) fn new(message: impl ToString) -> Self {
        Self(message.to_string())
    }
}

/// Results of this crate.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// True if the caller's file or option is at fault, so that a retry cannot succeed: the file is not a detector or not a library.
    pub fn is_bad_input(&self) -> bool {
        matches!(
            self,
            Self::Model { .. } | Self::Runtime(_) | Self::Option { .. }
        )
    }

    /// True if neither model nor scenario is at fault ([`dataset::Error::is_of_environment`]).
    pub fn is_of_environment(&self) -> bool {
        matches!(self, Self::Dataset(error) if error.is_of_environment())
    }

    pub(crate) fn scenario(id: &str, message: impl ToString) -> Self {
        Self::Scenario {
            id: id.to_owned(),
            message: message.to_string(),
        }
    }

    pub(crate) fn model(path: &Path, message: impl ToString) -> Self {
        Self::Model {
            path: path.to_owned(),
            message: message.to_string(),
        }
    }
}
