//! Errors while reading or recording a tape.

use std::io::{self, ErrorKind};
use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;

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
    /// Recordings never overwrite files.
    #[error("tape {}: there is a file of that name already; move it away or name another one", path.display())]
    Exists {
        /// The tape.
        path: PathBuf,
    },
    /// MCAP refused.
    #[error("tape {}: cannot {doing}: {}", path.display(), with_causes(source))]
    Mcap {
        /// The tape.
        path: PathBuf,
        /// The operation.
        doing: &'static str,
        /// Underlying error.
        r#source: Box<mcap::McapError>,
    },
    /// The file is not a tape, or its version differs.
    #[error("{} is not a tape that this version reads: {found}; expected an MCAP file of `dtd tape`", path.display())]
    NoTape {
        /// The file.
        path: PathBuf,
        /// Content found instead.
        found: String,
    },
    /// A message on the tape is damaged.
    #[error("tape {}: message {sequence} on {topic}: {found}", path.display())]
    BadMessage {
        /// The tape.
        path: PathBuf,
        /// Sequence number, from 0 over the whole tape.
        sequence: u32,
        /// Topic of the channel.
        topic: String,
        /// Fault of the message.
        found: String,
    },
    /// An address is not available.
    #[error(
        "cannot listen on {address} ({what}): {source}. Does X-Plane run there? --port 0 takes any free port"
    )]
    Bind {
        /// Requested address.
        address: SocketAddr,
        /// Purpose.
        what: &'static str,
        /// Underlying error.
        r#source: io::Error,
    },
    /// Open to other machines without a secret.
    #[error(
        "the recorder would listen on {address} for everybody: set DTD_LINK_TOKEN to a secret of your choice, which is not empty, here and \
         where the client runs, or listen on 127.0.0.1"
    )]
    NoToken {
        /// The address.
        address: IpAddr,
    },
    /// A socket failed while recording.
    #[error("{what} failed: {source}")]
    Socket {
        /// Name of the socket.
        what: &'static str,
        /// Underlying error.
        r#source: io::Error,
    },
    /// The thread that writes the tape ended unexpectedly, which is a bug.
    #[error("the tape's writer stopped")]
    WriterStopped,
}

impl TapeError {
    /// True if the caller must name another file, or repair it, first: the same call will fail again.
    pub fn is_bad_input(&self) -> bool {
        match self {
            Self::Exists { .. }
            | Self::Outside(_)
            | Self::NoTape { .. }
            | Self::Mcap { .. }
            | Self::BadMessage { .. }
            | Self::NoToken { .. } => true,
            Self::Io { source, .. } => matches!(
                source.kind(),
                ErrorKind::NotFound
                    | ErrorKind::NotADirectory
                    | ErrorKind::IsADirectory
                    | ErrorKind::PermissionDenied
                    | ErrorKind::ReadOnlyFilesystem
                    | ErrorKind::InvalidData
            ),
            Self::Bind { .. } | Self::Socket { .. } | Self::WriterStopped => false,
        }
    }
}
