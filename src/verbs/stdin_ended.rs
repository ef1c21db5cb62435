//! Standard input as a leash: it ends when whoever started the process ends, even when killed.

use std::io::{self, Read};
use std::thread;

use tokio::sync::oneshot;

/// Waits until standard input ends. A thread of its own: reading it cannot be cancelled, and must not keep the runtime alive.
pub(super) async fn stdin_ended() {
    let (ended, wait) = oneshot::channel();
    thread::spawn(move || {
        let mut ignored = [0; 64];
        while matches!(io::stdin().read(&mut ignored), Ok(1..)) {}
        // Nobody listens any more if the stand-in was stopped otherwise.
        let _ = ended.send(());
    });
    let _ = wait.await;
}
