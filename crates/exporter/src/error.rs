//! Errors of an export.

use std::path::PathBuf;

use dataset::work::watch::Stopped;

/// Export error. Every message names its subject.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file cannot be read or written.
    #[error(transparent)]
    Dataset(#[from] dataset::Error),
    /// The request fits neither the corpus nor the format nor the destination, so that a repetition would fail as well.
    #[error("{0}")]
    Request(String),
    /// A video lacks images.
    #[error("{0}")]
    Video(String),
    /// An MCAP file cannot be written.
    #[error("cannot write {}: {source}", path.display())]
    Mcap {
        /// The file.
        path: PathBuf,
        /// Cause.
        r#source: Box<mcap::McapError>,
    },
    /// An image cannot be encoded.
    #[error("cannot encode {}: {source}", path.display())]
    Encode {
        /// The file.
        path: PathBuf,
        /// Cause.
        r#source: image::ImageError,
    },
    /// The caller stopped it.
    #[error(transparent)]
    Stopped(#[from] Stopped),
}

/// Results of this crate.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// A name that the corpus does not have.
    pub(crate) fn unknown(what: &str, found: &str, known: &str) -> Self {
        Self::Request(format!(
            "{what} {found:?} is not in the corpus; expected one of {known}"
        ))
    }

    /// True if files of the corpus are damaged: an export is only possible once they are repaired.
    pub(crate) fn is_fault_of_corpus(&self) -> bool {
        match self {
            Self::Dataset(dataset::Error::Memory(_)) => false,
            Self::Dataset(error) => error.is_bad_content(),
            Self::Video(_) => true,
            _ => false,
        }
    }
}
