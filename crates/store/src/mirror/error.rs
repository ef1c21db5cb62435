//! Errors that end a transfer of a whole corpus.

use crate::corpus_store::CorpusStore;
use crate::error::StoreError;

/// A corpus that cannot be mirrored.
#[derive(Debug, thiserror::Error)]
pub enum MirrorError {
    /// The store failed, or the folder did while it was written.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The folder cannot be used.
    #[error(transparent)]
    Folder(dataset::Error),
    /// The two are not copies of one corpus, or the request names what the store does not have.
    #[error("{message}")]
    Refused {
        /// Fault, place and advice.
        message: String,
    },
    /// A file of the store is damaged or contradicts another one.
    #[error(
        "{place}: {message}. Nothing was fetched; `dtd push` from an intact copy of the corpus, or `dtd generate` with its sweep, replaces it"
    )]
    Damaged {
        /// The file.
        place: String,
        /// The fault.
        message: String,
    },
}

impl From<dataset::Error> for MirrorError {
    fn from(error: dataset::Error) -> Self {
        Self::Store(error.into())
    }
}

impl MirrorError {
    /// A store that holds no scenario.
    pub fn nothing_committed(store: &CorpusStore) -> Self {
        Self::Refused {
            message: format!(
                "{}: holds no committed scenario; is the prefix right?",
                store.name()
            ),
        }
    }
}
