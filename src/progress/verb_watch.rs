//! Progress and cancellation of a long verb: a bar per stage, and a clean end at the first Ctrl-C or SIGTERM.

use std::sync::{Mutex, MutexGuard, PoisonError};

use dataset::work::watch::Watch;

use crate::progress::Bar;
use crate::signals::CleanStop;

/// Shows a verb's progress. While it exists, the first signal stops the work.
pub(crate) struct VerbWatch {
    verb: &'static str,
    unit: &'static str,
    stage: Mutex<Stage>,
    stop: CleanStop,
}

struct Stage {
    name: String,
    bar: Bar,
}

impl VerbWatch {
    /// A bar without an end that is named after the verb and counts `unit`s.
    pub(crate) fn new(verb: &'static str, unit: &'static str) -> Self {
        let stage = Stage {
            name: String::new(),
            bar: Bar::new(verb, unit, None),
        };
        Self {
            verb,
            unit,
            stage: Mutex::new(stage),
            stop: CleanStop::begin(),
        }
    }

    /// Waits until the verb is stopped.
    pub(crate) async fn stopped(&self) {
        self.stop.switch().cancelled().await;
    }

    fn stage(&self) -> MutexGuard<'_, Stage> {
        self.stage.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Watch for VerbWatch {
    fn begin(&self, stage: &str, total: u64) {
        let mut now = self.stage();
        if !stage.is_empty() {
            let bar = Bar::new(self.verb, self.unit, Some(total));
            bar.working_on(stage);
            let name = stage.to_owned();
            *now = Stage { name, bar };
        }
        now.bar.set_total(total);
    }

    fn advance(&self, done: u64, note: &str) {
        let Stage { name, bar } = &*self.stage();
        match (name.as_str(), note) {
            (_, "") => {}
            ("", note) => bar.working_on(note),
            (name, note) => bar.working_on(&format!("{name}: {note}")),
        }
        bar.set_done(done);
    }

    fn resume(&self, done: u64) {
        self.stage().bar.resume(done);
    }

    fn say(&self, line: &str) {
        self.stage().bar.say(line);
    }

    fn warn(&self, line: &str) {
        self.stage().bar.warn(line);
    }

    fn is_stopped(&self) -> bool {
        self.stop.switch().is_cancelled()
    }
}
