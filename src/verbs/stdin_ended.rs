//! Ends the process when standard input ends, which happens when its parent ends, even if killed.

use std::io::{self, Read};
use std::thread;

use tokio::sync::oneshot;

/// Waits until standard input ends. On a separate thread: reading it cannot be cancelled, and must not keep the runtime alive.
pub(super) async fn stdin_ended() {
    let (ended, wait) = oneshot::channel();
    thread::spawn(move || {
        let mut ignored = [0; 64];
        while matches!(io::stdin().read(&mut ignored), Ok(1..)) {}
        // The receiver is gone if the stand-in was stopped by other means.
        let _ = ended.send(());
    });
    let _ = wait.await;
}
