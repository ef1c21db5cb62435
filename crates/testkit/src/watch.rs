//! Watches for tests.

use dataset::work::watch::Watch;

/// A watch of closures.
#[derive(Debug)]
pub struct Calls<A, S> {
    /// Called with the steps done.
    pub advance: A,
    /// Asked whether the work should stop.
    pub is_stopped: S,
}

impl<A: Fn(u64) + Sync, S: Fn() -> bool + Sync> Watch for Calls<A, S> {
    fn advance(&self, done: u64, _note: &str) {
        (self.advance)(done);
    }

    fn is_stopped(&self) -> bool {
        (self.is_stopped)()
    }
}
