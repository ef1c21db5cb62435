//! Errors while reading or recording a tape.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use xplane_bridge::with_causes;

/// Failure to write or read a tape.
#[derive(Debug, thiserror::Error)]
pub enum TapeError {
    /// The file cannot be created, written or read.
    #[error("tape {}: cannot {doing}: {source}", path.display())]
    Io {
        /// The tape.
        path: PathBuf,
        /// The operation.
        doing: &'static str,
        /// Underlying error.
        r#source: io::Error,
    },
    /// The file cannot be read as a tape.
    #[error(transparent)]
    Outside(#[from] dataset::Error),
    /// The caller must name another file, repair it, or give a token first.
    #[error("{0}")]
    BadInput(String),
    /// An address is not available, a socket failed, or the thread that writes the tape ended unexpectedly, which is a bug.
    #[error("{0}")]
    Failed(String),
}

impl TapeError {
    /// MCAP's error about a tape.
    pub(crate) fn mcap(path: &Path, doing: &str, error: &mcap::McapError) -> Self {
        let causes = with_causes(error);
        Self::BadInput(format!("tape {}: cannot {doing}: {causes}", path.display()))
    }

    /// True if the caller must name another file, or repair it, first: the same call will fail again.
    pub fn is_bad_input(&self) -> bool {
        match self {
            Self::Outside(_) | Self::BadInput(_) => true,
            Self::Io { source, .. } => matches!(
                source.kind(),
                ErrorKind::NotFound
                    | ErrorKind::NotADirectory
                    | ErrorKind::IsADirectory
                    | ErrorKind::PermissionDenied
                    | ErrorKind::ReadOnlyFilesystem
                    | ErrorKind::InvalidData
            ),
            Self::Failed(_) => false,
        }
    }
}
