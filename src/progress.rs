//! Progress on stderr: bars on a terminal; otherwise, as in a log file, a line per tenth of the work.

use std::fmt;
use std::io::IsTerminal;
use std::sync::LazyLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use indicatif::{
    HumanDuration, MultiProgress, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle,
};

use crate::plain::plain;

/// Number of log lines per step.
const LOG_LINES: u64 = 10;

/// All bars of the process. Without a terminal they are hidden.
static BARS: LazyLock<MultiProgress> = LazyLock::new(|| {
    MultiProgress::with_draw_target(match std::io::stderr().is_terminal() {
        true => ProgressDrawTarget::stderr(),
        false => ProgressDrawTarget::hidden(),
    })
});

/// Writes to the terminal while no bar is in the way.
pub(crate) fn beside_bars<T>(write: impl FnOnce() -> T) -> T {
    BARS.suspend(write)
}

/// A bar that counts `unit`s of one step of the work.
pub(crate) struct Bar {
    step: &'static str,
    unit: &'static str,
    bar: ProgressBar,
    /// Units that an earlier process did.
    before: AtomicU64,
    /// Parts of the work, of [`LOG_LINES`], that were logged.
    logged: AtomicU64,
}

impl Bar {
    /// A bar for `step`, with `total` units if that is known already.
    pub(crate) fn new(step: &'static str, unit: &'static str, total: Option<u64>) -> Self {
        let bar = BARS.add(match total {
            Some(total) => ProgressBar::new(total),
            None => ProgressBar::no_length(),
        });
        let template =
            format!("{{prefix:>9}} {{bar:32}} {{pos}}/{{len}} {unit} {{rate}} eta {{eta}} {{msg}}");
        if let Ok(style) = ProgressStyle::with_template(&template) {
            let style =
                style.with_key("rate", |state: &ProgressState, out: &mut dyn fmt::Write| {
                    // Nothing is lost with a rate that cannot be shown.
                    let _ = out.write_str(&rate(state.per_sec()));
                });
            bar.set_style(style.progress_chars("=> "));
        }
        bar.set_prefix(step);
        bar.enable_steady_tick(Duration::from_millis(200));
        Self {
            step,
            unit,
            bar,
            before: AtomicU64::new(0),
            logged: AtomicU64::new(0),
        }
    }

    /// Sets the number of units.
    pub(crate) fn set_total(&self, total: u64) {
        self.bar.set_length(total);
    }

    /// Sets the number of units that an earlier process finished, which say nothing about the pace of this one.
    pub(crate) fn resume(&self, done: u64) {
        self.before.store(done, Ordering::Relaxed);
        self.bar.set_position(done);
        self.bar.reset_eta();
        let total = self.bar.length().unwrap_or(0).max(1);
        self.logged
            .store(done * LOG_LINES / total, Ordering::Relaxed);
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
                "{}: {done}/{total} {}{}{}; {}",
                self.step,
                self.unit,
                pace(
                    done,
                    self.before.load(Ordering::Relaxed),
                    total,
                    self.bar.elapsed()
                ),
                match self.bar.message() {
                    message if message.is_empty() => message,
                    message => format!("; {message}"),
                },
                clock(SystemTime::now())
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
        BARS.remove(&self.bar);
    }
}

/// The time of day, for who reads a log in the morning.
fn clock(now: SystemTime) -> String {
    let since = now.duration_since(UNIX_EPOCH).unwrap_or_default();
    let minutes = since.as_secs() / 60;
    format!("{:02}:{:02} UTC", minutes / 60 % 24, minutes % 60)
}

/// Time so far, rate and time left, as far as they say anything.
fn pace(done: u64, before: u64, total: u64, elapsed: Duration) -> String {
    let elapsed_s = elapsed.as_secs_f64();
    if elapsed_s < 1.0 || done <= before {
        return String::new();
    }
    let per_s = (done - before) as f64 / elapsed_s;
    let left = Duration::from_secs_f64(total.saturating_sub(done) as f64 / per_s);
    let left = match done {
        done if done >= total => String::new(),
        _ => format!(", {} left", HumanDuration(left)),
    };
    format!(" in {}, {}{left}", HumanDuration(elapsed), rate(per_s))
}

fn rate(per_s: f64) -> String {
    match per_s {
        rate if rate >= 1.0 => format!("{rate:.1}/s"),
        rate => format!("{:.1}/min", rate * 60.0),
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.finish();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_log_line_says_when() {
        let day: u64 = 86_400;
        let at = |seconds: u64| clock(UNIX_EPOCH + Duration::from_secs(20_000 * day + seconds));
        assert_eq!([at(0), at(day - 1)], ["00:00 UTC", "23:59 UTC"]);
    }

    #[test]
    fn a_log_line_says_how_fast_and_how_long_still() {
        let pace = |done, elapsed_s| pace(done, 0, 200, Duration::from_secs_f64(elapsed_s));
        assert_eq!(pace(20, 0.1), "");
        assert_eq!(pace(0, 10.0), "");
        assert_eq!(pace(50, 10.0), " in 10 seconds, 5.0/s, 30 seconds left");
        assert_eq!(pace(20, 7_200.0), " in 2 hours, 0.2/min, 18 hours left");
        assert_eq!(pace(200, 20.0), " in 20 seconds, 10.0/s");
        let resumed = super::pace(150, 100, 200, Duration::from_secs(10));
        assert_eq!(resumed, " in 10 seconds, 5.0/s, 10 seconds left");
    }
}
