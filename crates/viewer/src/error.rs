//! Errors that end the server.

use std::io;

/// The page cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// The port.
    #[error(
        "cannot listen on 127.0.0.1:{port}: {source}; choose another port with --port, or any free one with --port 0"
    )]
    Listen {
        /// The port.
        port: u16,
        /// Cause.
        r#source: io::Error,
    },
    /// A run is given twice.
    #[error("run {run} is given twice; leave one of them out")]
    SameRun {
        /// The name.
        run: String,
    },
}
