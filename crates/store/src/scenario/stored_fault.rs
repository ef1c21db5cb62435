//! Differences between a committed scenario in a store and its seal, each of one file.

use std::fmt;

use dataset::corpus::ScenarioFolder;
use dataset::corpus::seal::{BadManifest, DONE, MANIFEST};

/// A file of a committed scenario that is not as it was sealed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum StoredFault {
    /// `DONE.json` cannot be parsed.
    #[error("{DONE} is not a valid seal: {reason}")]
    NotASeal {
        /// Line, column and reason.
        reason: String,
    },
    /// `DONE.json` was changed after it was written.
    #[error("{DONE} was changed after it was written: its content does not match its seal_blake3")]
    ChangedSeal,
    /// `DONE.json` names the manifest of a scenario with other parameters.
    #[error(
        "{DONE} has the config_hash {found}, expected {expected} as in the same manifest elsewhere"
    )]
    OtherParameters {
        /// The hash in the store's seal.
        found: String,
        /// The hash in the seal of a whole copy.
        expected: String,
    },
    /// The manifest is not text, or not the one that was sealed.
    #[error(transparent)]
    Manifest(#[from] BadManifest),
    /// The manifest is not UTF-8.
    #[error("{MANIFEST} is not UTF-8")]
    NotText,
    /// The record is of another scenario.
    #[error("{reason}")]
    OtherScenario {
        /// The difference.
        reason: String,
    },
    /// There is no object with the file's content.
    #[error("{file} is missing")]
    Missing {
        /// Its name within the scenario.
        file: String,
    },
    /// The object has another size.
    #[error("{file} has {found_bytes} bytes, expected {expected_bytes}")]
    OtherSize {
        /// Its name within the scenario.
        file: String,
        /// Size of the object.
        found_bytes: u64,
        /// Size that was sealed.
        expected_bytes: u64,
    },
    /// The object has another hash.
    #[error("{file} has another content: its hash differs")]
    OtherContent {
        /// Its name within the scenario.
        file: String,
    },
}

impl StoredFault {
    /// Name of the file within the scenario.
    pub fn file(&self) -> &str {
        match self {
            Self::NotASeal { .. } | Self::ChangedSeal | Self::OtherParameters { .. } => DONE,
            Self::Manifest(_) | Self::NotText => MANIFEST,
            Self::OtherScenario { .. } => ScenarioFolder::RECORD,
            Self::Missing { file } | Self::OtherSize { file, .. } | Self::OtherContent { file } => {
                file
            }
        }
    }
}

/// All faults of a scenario; displayed in one line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StoredFaults(pub Vec<StoredFault>);

impl From<StoredFault> for StoredFaults {
    fn from(fault: StoredFault) -> Self {
        Self(vec![fault])
    }
}

impl fmt::Display for StoredFaults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, fault) in self.0.iter().enumerate() {
            let separator = if index == 0 { "" } else { "; " };
            write!(f, "{separator}{fault}")?;
        }
        Ok(())
    }
}
