//! The runtime under the verbs that talk over sockets.

use std::io;

use tokio::runtime::{Builder, Runtime};

/// A multi-threaded runtime with sockets and timers.
pub(crate) fn async_runtime() -> io::Result<Runtime> {
    Builder::new_multi_thread().enable_all().build()
}
