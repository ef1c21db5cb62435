//! Reasons why a live estimation cannot begin or go on.

use std::net::SocketAddr;

/// Live estimation errors.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Invalid source text.
    #[error("source {source}: {why}")]
    Source {
        /// The text, without secrets.
        r#source: String,
        /// Expectation and finding.
        why: String,
    },
    /// A source does not have the images that the run needs.
    #[error("view {view} from {source}: {why}")]
    View {
        /// Name of the view.
        view: String,
        /// The source, without secrets.
        r#source: String,
        /// Expectation, finding and remedy.
        why: String,
    },
    /// The views of the run and those that were given differ.
    #[error("{0}")]
    Views(String),
    /// A corpus file or an image cannot be read.
    #[error(transparent)]
    Dataset(#[from] dataset::Error),
    /// The search failed.
    #[error(transparent)]
    Search(#[from] labeller::Error),
    /// The run cannot be used.
    #[error(transparent)]
    Run(#[from] trainer::Error),
    /// The address for metrics cannot be opened.
    #[error(
        "metrics cannot be served at {address}: {source}; give another port, or 0 for any free one"
    )]
    Metrics {
        /// The address.
        address: SocketAddr,
        /// The system's error.
        r#source: std::io::Error,
    },
    /// The output takes no more lines, although somebody reads it.
    #[error("lines cannot be written to the output: {0}; make room there and start again")]
    Output(std::io::Error),
    /// A thread ended by a fault of this program.
    #[error(
        "the thread \"{thread}\" failed, and the message before this one says where; please report it"
    )]
    Panicked {
        /// Name of the thread.
        thread: String,
    },
    /// A thread cannot be started.
    #[error("a thread cannot be started: {0}")]
    Thread(std::io::Error),
}

/// Results of this crate.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// True if the caller has to change an argument or a file.
    pub fn is_bad_input(&self) -> bool {
        match self {
            Self::Source { .. } | Self::View { .. } | Self::Views(_) | Self::Metrics { .. } => true,
            Self::Dataset(error) => error.is_bad_content(),
            Self::Search(error) => error.is_bad_input(),
            Self::Run(_) => true,
            Self::Output(_) | Self::Panicked { .. } | Self::Thread(_) => false,
        }
    }
}
