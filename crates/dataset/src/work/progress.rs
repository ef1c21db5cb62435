//! Progress of a long computation in stages, reported to its caller, independent of any terminal.

/// Receives the progress of training and evaluation, for example to draw bars.
pub trait Progress {
    /// A new stage of `total` steps begins.
    fn begin(&mut self, stage: &str, total: u64);
    /// `done` of the current stage's steps are done; `note` is a short figure such as a validation error, or empty.
    fn advance(&mut self, done: u64, note: &str);
    /// The current stage goes on after `done` steps that an earlier process did.
    fn resume(&mut self, done: u64) {
        self.advance(done, "");
    }
    /// A line that stays.
    fn say(&mut self, _line: &str) {}
}

/// Ignores all progress.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Progress for Silent {
    fn begin(&mut self, _stage: &str, _total: u64) {}
    fn advance(&mut self, _done: u64, _note: &str) {}
}
