//! Work that several threads share.

use std::thread;

/// Runs the same work on `count` threads, including the caller's, and waits for all threads. Returns the error of the first thread that
/// failed; the caller's takes precedence.
///
/// # Errors
/// A thread's.
pub fn share<E: Send>(count: usize, work: impl Fn() -> Result<(), E> + Sync) -> Result<(), E> {
    thread::scope(|scope| {
        let others: Vec<_> = (1..count).map(|_| scope.spawn(&work)).collect();
        let mine = work();
        others
            .into_iter()
            .fold(mine, |result, worker| match worker.join() {
                Ok(theirs) => result.and(theirs),
                Err(panic) => std::panic::resume_unwind(panic),
            })
    })
}
