//! Errors that end a transfer of a whole corpus.

use super::corpus_files::BadFile;
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
    /// A file of the folder is damaged or contradicts another one.
    #[error(
        "{path}: {bad}. Nothing was pushed; `dtd fetch {store} --out FOLDER` brings the store's own"
    )]
    BadSource {
        /// The file.
        path: String,
        /// The fault.
        bad: BadFile,
        /// The store.
        store: String,
    },
    /// A file of the store is damaged or contradicts another one.
    #[error(
        "{store}/{}: {bad}. Nothing was fetched; `dtd push` from an intact copy of the corpus, or `dtd generate` with its sweep, replaces it",
        bad.name
    )]
    BadStore {
        /// The store.
        store: String,
        /// The fault.
        bad: BadFile,
    },
    /// The store has another corpus.
    #[error(
        "{store}: the corpus was started from a different sweep or split, {name} differs: {difference}. A corpus can only be added to: push \
         to another prefix"
    )]
    OtherInStore {
        /// The store.
        store: String,
        /// The file that differs.
        name: &'static str,
        /// The difference.
        difference: String,
    },
    /// The folder has another corpus.
    #[error(
        "{path} is of another corpus than {store}: {difference}. Nothing was fetched; name another folder"
    )]
    OtherInFolder {
        /// The file that differs.
        path: String,
        /// The store.
        store: String,
        /// The difference.
        difference: String,
    },
    /// The folder has a sweep without a plan, which may be anybody's work.
    #[error(
        "{path} differs from {store}/{name}, and there was no plan.json that was made from it. Nothing was fetched; move it away, or name \
         another folder"
    )]
    SweepWithoutPlan {
        /// The file.
        path: String,
        /// The store.
        store: String,
        /// Its name.
        name: &'static str,
    },
    /// The store has no scenario.
    #[error("{store}: holds no committed scenario; is the prefix right?")]
    NothingCommitted {
        /// The store.
        store: String,
    },
    /// The store does not have a requested scenario.
    #[error(
        "{store}: has no committed scenario {id} ({committed} scenario{} committed)",
        if *committed == 1 { "" } else { "s" }
    )]
    NoSuchScenario {
        /// The store.
        store: String,
        /// The scenario.
        id: String,
        /// Number of committed scenarios.
        committed: usize,
    },
}

impl From<dataset::Error> for MirrorError {
    fn from(error: dataset::Error) -> Self {
        Self::Store(error.into())
    }
}

impl MirrorError {
    /// True if the caller must change the request, the folder or the environment, because the same call will fail again.
    pub fn is_bad_input(&self) -> bool {
        match self {
            Self::Store(error) => error.is_bad_input(),
            Self::BadStore { .. } => false,
            _ => true,
        }
    }
}
