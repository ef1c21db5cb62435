//! The async runtime for verbs that use sockets.

use std::io;

use tokio::runtime::{Builder, Runtime};

/// A multi-threaded runtime with sockets and timers.
pub(crate) fn async_runtime() -> io::Result<Runtime> {
    Builder::new_multi_thread().enable_all().build()
}
