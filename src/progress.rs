//! Progress on stderr: bars on a terminal; otherwise, as in a log file, a line per tenth of the work.

use std::io::IsTerminal;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::print::plain;

/// Number of log lines per step.
const LOG_LINES: u64 = 10;

/// A bar that counts `unit`s of one step of the work.
pub(crate) struct Bar {
    step: &'static str,
    unit: &'static str,
    bar: ProgressBar,
    /// Parts of the work, of [`LOG_LINES`], that were logged.
    logged: AtomicU64,
}

impl Bar {
    /// A bar for `step`, with `total` units if that is known already.
    pub(crate) fn new(step: &'static str, unit: &'static str, total: Option<u64>) -> Self {
        let bar = match total {
            Some(total) => ProgressBar::new(total),
            None => ProgressBar::no_length(),
        };
        bar.set_draw_target(if std::io::stderr().is_terminal() {
            ProgressDrawTarget::stderr()
        } else {
            ProgressDrawTarget::hidden()
        });
        let template = format!(
            "{{prefix:>9}} {{bar:32}} {{pos}}/{{len}} {unit} {{per_sec}} eta {{eta}} {{msg}}"
        );
        if let Ok(style) = ProgressStyle::with_template(&template) {
            bar.set_style(style.progress_chars("=> "));
        }
        bar.set_prefix(step);
        bar.enable_steady_tick(Duration::from_millis(200));
        Self {
            step,
            unit,
            bar,
            logged: AtomicU64::new(0),
        }
    }

    /// Sets the number of units.
    pub(crate) fn set_total(&self, total: u64) {
        self.bar.set_length(total);
    }

    /// Sets the number of finished units.
    pub(crate) fn set_done(&self, done: u64) {
        self.bar.set_position(done);
        let total = self.bar.length().unwrap_or(0);
        if !self.bar.is_hidden() || total == 0 {
            return;
        }
        let part = (done * LOG_LINES / total).min(LOG_LINES);
        if part > self.logged.fetch_max(part, Ordering::Relaxed) {
            eprintln!(
                "{}: {done}/{total} {} {}",
                self.step,
                self.unit,
                self.bar.message()
            );
        }
    }

    /// Shows the current item.
    pub(crate) fn working_on(&self, what: &str) {
        self.bar.set_message(plain(what).into_owned());
    }

    /// Prints a line that stays, above the bar or in the log.
    pub(crate) fn say(&self, line: &str) {
        if self.bar.is_hidden() {
            eprintln!("{}: {line}", self.step);
        } else {
            self.bar
                .println(format!("{:>9} {}", self.step, plain(line)));
        }
    }

    /// Removes the bar.
    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.finish();
    }
}
