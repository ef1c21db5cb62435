//! Progress on stderr: bars on a terminal; otherwise lines, for people or for programs ([`crate::logging::stderr`]).

mod cadence;
mod standing;
pub(crate) mod verb_watch;

use std::sync::{Arc, LazyLock, Mutex, MutexGuard, Once, PoisonError, Weak};
use std::thread;
use std::time::{Duration, Instant, SystemTime};

use console::Term;
use dataset::plain::one_line;
use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use serde::Serialize;

use crate::logging::repeats::{self, Source};
use crate::logging::stderr::{self, Form, Level};
use cadence::{BEAT, Cadence};
use standing::Standing;
pub(crate) use standing::{Disk, Scenarios};

/// All bars of the process. Without a terminal they are hidden.
static BARS: LazyLock<MultiProgress> = LazyLock::new(|| {
    MultiProgress::with_draw_target(match stderr::form() {
        Form::Terminal => ProgressDrawTarget::stderr(),
        Form::Log | Form::Json => ProgressDrawTarget::hidden(),
    })
});

/// Columns of a terminal from which on there is room for a long bar.
const WIDE: usize = 120;

/// Columns of the terminal.
fn columns() -> usize {
    Term::stderr().size().1.into()
}

/// The steps in work, the newest last, and when a line of progress was written last.
static STEPS: Mutex<Steps> = Mutex::new(Steps {
    in_work: Vec::new(),
    last_line: None,
});

struct Steps {
    in_work: Vec<Weak<Step>>,
    last_line: Option<Instant>,
}

/// Writes to the terminal while no bar is in the way.
pub(crate) fn beside_bars<T>(write: impl FnOnce() -> T) -> T {
    BARS.suspend(write)
}

/// A progress bar that counts `unit`s.
pub(crate) struct Bar {
    step: Arc<Step>,
    bar: ProgressBar,
}

/// State behind a bar.
struct Step {
    name: &'static str,
    unit: &'static str,
    began: Mutex<Instant>,
    standing: Mutex<Standing>,
    cadence: Mutex<Cadence>,
}

/// Progress as a program reads it.
#[derive(Serialize)]
struct ProgressLine<'a> {
    time: String,
    kind: &'static str,
    step: &'static str,
    unit: &'static str,
    done: u64,
    total: Option<u64>,
    elapsed_s: f64,
    per_s: Option<f64>,
    left_s: Option<f64>,
    working_on: Option<&'a str>,
    scenarios: Option<Scenarios>,
    bytes_written: Option<u64>,
    bytes_free: Option<u64>,
}

impl Bar {
    /// A bar for `step`, with `total` units if that is known already.
    pub(crate) fn new(step: &'static str, unit: &'static str, total: Option<u64>) -> Self {
        let standing = Standing {
            total,
            ..Standing::default()
        };
        let step = Arc::new(Step {
            name: step,
            unit,
            began: Mutex::new(Instant::now()),
            standing: Mutex::new(standing),
            cadence: Mutex::default(),
        });
        // Hidden until it has its style.
        let hidden = ProgressBar::with_draw_target(total, ProgressDrawTarget::hidden());
        hidden.set_prefix(step.name);
        let bar = Self { step, bar: hidden };
        bar.set_style();
        BARS.add(bar.bar.clone());
        if stderr::form() == Form::Terminal {
            bar.bar.enable_steady_tick(Duration::from_millis(200));
        } else {
            beat();
            lock(&STEPS).in_work.push(Arc::downgrade(&bar.step));
        }
        bar
    }

    /// A bar where the end is known, else a sign of life.
    fn set_style(&self) {
        let bar_columns = match self.bar.length() {
            Some(_) if columns() < WIDE => 10,
            Some(_) => 32,
            None => 1,
        };
        let template = match self.bar.length() {
            Some(_) => format!("{{prefix:>9.bold}} {{bar:{bar_columns}.cyan}} {{known}}"),
            None => "{prefix:>9.bold} {spinner:.cyan} {known}".to_owned(),
        };
        let Ok(style) = ProgressStyle::with_template(&template) else {
            return;
        };
        let step = self.step.clone();
        // The last column stays free: some terminals wrap a line that reaches it.
        let taken = step.name.len().max(9) + bar_columns + 3;
        let known = move |_: &ProgressState, out: &mut dyn std::fmt::Write| {
            let left = columns().saturating_sub(taken);
            let words = lock(&step.standing).fitted(step.unit, step.elapsed(), left);
            // A bar that cannot be drawn is no loss.
            let _ = out.write_str(&words);
        };
        self.bar
            .set_style(style.with_key("known", known).progress_chars("=> "));
    }

    /// Sets the number of units.
    pub(crate) fn set_total(&self, total: u64) {
        let had_none = lock(&self.step.standing).total.replace(total).is_none();
        self.bar.set_length(total);
        if had_none {
            self.set_style();
        }
    }

    /// Sets the number of units that an earlier process finished, which say nothing about the pace of this one.
    pub(crate) fn resume(&self, done: u64) {
        *lock(&self.step.began) = Instant::now();
        {
            let mut standing = lock(&self.step.standing);
            (standing.before, standing.done) = (done, done);
            lock(&self.step.cadence).resume(&standing);
        }
        self.bar.set_position(done);
    }

    /// Adds units that this process did not finish although [`Self::set_done`] counts them: others did, or they failed.
    pub(crate) fn add_foreign(&self, units: u64) {
        lock(&self.step.standing).before += units;
    }

    /// Sets the number of finished units.
    pub(crate) fn set_done(&self, done: u64) {
        lock(&self.step.standing).done = done;
        self.bar.set_position(done);
        self.step.write_if_due();
    }

    /// Shows the current item.
    pub(crate) fn working_on(&self, what: &str) {
        lock(&self.step.standing).working_on = one_line(what).into_owned();
    }

    /// Shows the number of the current scenario.
    pub(crate) fn set_scenarios(&self, scenarios: Scenarios) {
        lock(&self.step.standing).scenarios = Some(scenarios);
    }

    /// Shows the bytes written and free.
    pub(crate) fn set_disk(&self, disk: Disk) {
        lock(&self.step.standing).disk = Some(disk);
    }

    /// Prints a line that stays, above the bar or in the log. The same line again within a minute is counted.
    pub(crate) fn say(&self, line: &str) {
        self.say_as(Level::Info, line);
    }

    /// Prints a warning, like [`Self::say`].
    pub(crate) fn warn(&self, line: &str) {
        self.say_as(Level::Warning, line);
    }

    fn say_as(&self, level: Level, line: &str) {
        let name = self.step.name;
        let line = one_line(line);
        let text = format!("{name}: {line}");
        let Some(repeated) = repeats::admit(Source::Line(text.clone()), level, &text) else {
            return;
        };
        let line = format!("{line}{repeated}");
        if stderr::form() == Form::Terminal {
            let line = stderr::message(level, &format!("{name:>9} "), &line);
            self.bar.println(line);
        } else {
            stderr::say(level, &format!("{name}: "), &line);
        }
    }

    /// Removes the bar.
    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
        BARS.remove(&self.bar);
    }
}

impl Step {
    fn elapsed(&self) -> Duration {
        lock(&self.began).elapsed()
    }

    /// Writes a line of progress, unless the terminal shows a bar or it is too early for one.
    fn write_if_due(&self) {
        let form = stderr::form();
        if form == Form::Terminal {
            return;
        }
        let standing = lock(&self.standing).clone();
        let now = Instant::now();
        {
            let mut steps = lock(&STEPS);
            let began = *lock(&self.began);
            let last = steps.last_line.map_or(began, |last| last.max(began));
            let since = now.saturating_duration_since(last);
            if !lock(&self.cadence).is_due(&standing, since, form == Form::Json) {
                return;
            }
            steps.last_line = Some(now);
        }
        let elapsed = self.elapsed();
        if form == Form::Json {
            stderr::write_json(&self.line(&standing, elapsed));
            return;
        }
        let words = standing.words(self.unit, elapsed, true);
        let mut line = format!("{}: {words}", self.name);
        if standing.is_complete() {
            // Equal short steps, such as each view's networks, share one line in the log.
            let stage = standing.working_on.split(':').next().unwrap_or_default();
            let source = Source::LastOfStep(format!("{}: {stage}", self.name));
            match repeats::admit(source, Level::Info, "") {
                Some(repeated) => line += &repeated.to_string(),
                None => return,
            }
        }
        stderr::say(Level::Info, "", &line);
    }

    fn line<'a>(&self, standing: &'a Standing, elapsed: Duration) -> ProgressLine<'a> {
        let working_on = standing.working_on.as_str();
        ProgressLine {
            time: stderr::utc(SystemTime::now()),
            kind: "progress",
            step: self.name,
            unit: self.unit,
            done: standing.done,
            total: standing.total,
            elapsed_s: elapsed.as_secs_f64(),
            per_s: standing.per_s(elapsed),
            left_s: standing.left(elapsed).map(|left| left.as_secs_f64()),
            working_on: (!working_on.is_empty()).then_some(working_on),
            scenarios: standing.scenarios,
            bytes_written: standing.disk.map(|disk| disk.written),
            bytes_free: standing.disk.and_then(|disk| disk.free),
        }
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.finish();
    }
}

/// Starts the thread that writes a line of the newest step when there was none for minutes.
fn beat() {
    static STARTED: Once = Once::new();
    STARTED.call_once(|| {
        let beating = || {
            loop {
                thread::sleep(BEAT);
                let newest = {
                    let mut steps = lock(&STEPS);
                    steps.in_work.retain(|step| step.strong_count() > 0);
                    newest_unfinished(&steps.in_work)
                };
                if let Some(step) = newest {
                    step.write_if_due();
                }
            }
        };
        // Without it there are the lines of progress itself.
        let _ = thread::Builder::new()
            .name("progress".into())
            .spawn(beating);
    });
}

/// The newest incomplete step. Steps may be nested.
fn newest_unfinished(in_work: &[Weak<Step>]) -> Option<Arc<Step>> {
    let mut steps = in_work.iter().rev().filter_map(Weak::upgrade);
    steps.find(|step| !lock(&step.standing).is_complete())
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_complete_step_does_not_hide_an_older_one_that_is_in_work() {
        let [older, newer] = [40, 100].map(|done| {
            let bar = Bar::new("train", "steps", Some(100));
            lock(&bar.step.standing).done = done;
            bar
        });
        let in_work = [&older, &newer].map(|bar| Arc::downgrade(&bar.step));
        let found = newest_unfinished(&in_work).unwrap();
        assert!(Arc::ptr_eq(&found, &older.step));
    }

    #[test]
    fn units_of_others_say_nothing_about_the_pace() {
        let bar = Bar::new("generate", "ticks", Some(300));
        bar.add_foreign(100);
        bar.set_done(200);
        let standing = lock(&bar.step.standing).clone();
        assert_eq!(standing.per_s(Duration::from_secs(10)), Some(10.0));
    }
}
