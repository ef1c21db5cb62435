//! Progress and cancellation of long work, independent of any terminal and of any signal.

/// Observer of long work: receives its progress, for example to draw bars, and can stop it. The threads of the work share it.
pub trait Watch: Sync {
    /// A new stage of `total` steps begins. Work with a single stage passes an empty name.
    fn begin(&self, _stage: &str, _total: u64) {}
    /// `done` of the current stage's steps are done; `note` is a short text such as a validation error or a scenario, or empty.
    fn advance(&self, _done: u64, _note: &str) {}
    /// The current stage goes on after `done` steps that an earlier process did.
    fn resume(&self, done: u64) {
        self.advance(done, "");
    }
    /// A line that stays.
    fn say(&self, _line: &str) {}
    /// A line about a problem that does not end the work.
    fn warn(&self, line: &str) {
        self.say(line);
    }
    /// True if the work should stop. Polled before each small unit of the work.
    fn is_stopped(&self) -> bool {
        false
    }
    /// [`Self::is_stopped`] for work that ends with an error.
    ///
    /// # Errors
    /// The work should stop.
    fn check(&self) -> Result<(), Stopped> {
        if self.is_stopped() {
            Err(Stopped)
        } else {
            Ok(())
        }
    }
}

/// The caller stopped the work.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("stopped")]
pub struct Stopped;

/// Ignores all progress and never stops the work.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Watch for Silent {}
