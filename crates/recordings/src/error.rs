//! Reasons why a recording does not become a corpus.

use std::path::Path;

use dataset::files::toml_file::TomlError;
use dataset::work::watch::Stopped;

/// Result of this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// Reasons why a recording does not become a corpus.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A mistake in `RECORDING.toml`.
    #[error(transparent)]
    Description(#[from] TomlError),
    /// A file cannot be read or written, or has the wrong content.
    #[error(transparent)]
    Dataset(#[from] dataset::Error),
    /// The detector cannot be used, or fails.
    #[error(transparent)]
    Search(#[from] labeller::Error),
    /// The caller stopped the import.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// No part of the recording can be used.
    #[error("{0}")]
    Unusable(String),
}

impl Error {
    /// A wrong line of a table.
    pub(crate) fn line(path: &Path, line: u64, message: impl std::fmt::Display) -> Self {
        Self::Dataset(dataset::Error::corpus(
            path,
            format!("line {line}: {message}"),
        ))
    }

    /// True if a table or video is wrong, so that the rest can be imported without it.
    pub(crate) fn is_of_a_file(&self) -> bool {
        match self {
            Self::Dataset(error) | Self::Search(labeller::Error::Dataset(error)) => {
                !error.is_of_environment()
            }
            _ => false,
        }
    }

    /// True if the input is wrong, not the disk.
    pub fn is_bad_input(&self) -> bool {
        match self {
            Self::Description(_) | Self::Unusable(_) => true,
            Self::Dataset(error) => !error.is_of_environment(),
            Self::Search(error) => !error.is_of_environment(),
            Self::Stopped(_) => false,
        }
    }
}
