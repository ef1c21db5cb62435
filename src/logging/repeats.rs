//! Lines that repeat: the first is written, the others are counted, so that neither a flood of bad datagrams nor a store that is away for a
//! night fills a log. Counts are written when their minute is over, and before the process ends.

use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{LazyLock, Mutex, Once, PoisonError};
use std::time::{Duration, Instant};
use std::{fmt, mem, thread};

use tracing::callsite::Identifier;

use crate::logging::stderr::{self, Level};

/// Minimum time between two equal lines.
const PERIOD: Duration = Duration::from_secs(60);
/// Maximum number of remembered lines.
const MAX_REMEMBERED: usize = 1_024;
/// Interval for looking for counts whose minute is over.
const COUNT_INTERVAL: Duration = Duration::from_secs(5);

/// Identity of a log line.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(crate) enum Source {
    /// An event about a peer: whatever it says, by its place in the code and the peer's address.
    Peer(Identifier, IpAddr),
    /// Any other event, by its place in the code and its text.
    Event(Identifier, String),
    /// A verb's line, by its text.
    Line(String),
    /// The last line of a short step, by its kind. Repetitions are not counted.
    LastOfStep(String),
}

/// Number of times that a line was left out since it was last written; as text, empty for none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Repeated(u64);

impl fmt::Display for Repeated {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            0 => Ok(()),
            times => write!(f, " ({times} more of these since the last one)"),
        }
    }
}

/// Admits a line with this text, unless the same one was written a moment ago.
pub(crate) fn admit(source: Source, level: Level, text: &str) -> Option<Repeated> {
    let admitted = lock().admit(source, level, text, Instant::now());
    if admitted.is_none() {
        count_in_background();
    }
    admitted
}

/// Writes the counts that no later line has; call it before the process ends.
pub(crate) fn write_counts() {
    let counts = lock().counts(Instant::now(), Duration::ZERO);
    counts.iter().for_each(Count::write);
}

fn count_in_background() {
    static STARTED: Once = Once::new();
    STARTED.call_once(|| {
        let counting = || {
            loop {
                thread::sleep(COUNT_INTERVAL);
                let counts = lock().counts(Instant::now(), PERIOD);
                counts.iter().for_each(Count::write);
            }
        };
        // Without it the counts are written at the end.
        let _ = thread::Builder::new()
            .name("repeats".into())
            .spawn(counting);
    });
}

fn lock() -> std::sync::MutexGuard<'static, Repeats> {
    static REPEATS: LazyLock<Mutex<Repeats>> = LazyLock::new(Mutex::default);
    REPEATS.lock().unwrap_or_else(PoisonError::into_inner)
}

#[derive(Debug, Default)]
struct Repeats {
    lines: HashMap<Source, Written>,
    /// Counts of lines that were forgotten.
    forgotten: Vec<Count>,
}

/// A line that was written.
#[derive(Debug)]
struct Written {
    at: Instant,
    level: Level,
    text: String,
    /// Number of times that it was left out since then.
    left_out: u64,
}

/// A line that says how many were left out.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Count {
    text: String,
    is_event: bool,
    level: Level,
}

impl Count {
    fn write(&self) {
        if self.is_event {
            stderr::log(self.level, &self.text);
        } else {
            stderr::say(self.level, "", &self.text);
        }
    }
}

impl Repeats {
    fn admit(
        &mut self,
        source: Source,
        level: Level,
        text: &str,
        now: Instant,
    ) -> Option<Repeated> {
        let is_recent = |written: Instant| now.saturating_duration_since(written) < PERIOD;
        if let Some(written) = self.lines.get_mut(&source) {
            if is_recent(written.at) {
                written.left_out += 1;
                return None;
            }
            written.at = now;
            return Some(Repeated(mem::take(&mut written.left_out)));
        }
        if self.lines.len() >= MAX_REMEMBERED {
            self.forget(|written| is_recent(written.at));
        }
        // More different ones than that within a minute: those that are forgotten may be written again.
        if self.lines.len() >= MAX_REMEMBERED {
            self.forget(|_| false);
        }
        let written = Written {
            at: now,
            level,
            text: text.to_owned(),
            left_out: 0,
        };
        self.lines.insert(source, written);
        Some(Repeated(0))
    }

    /// Forgets all lines but some; their counts stay.
    fn forget(&mut self, is_kept: impl Fn(&Written) -> bool) {
        let forgotten = self.lines.extract_if(|_, written| !is_kept(written));
        self.forgotten
            .extend(forgotten.filter_map(|(source, mut written)| written.count(&source)));
    }

    /// Counts of lines left out at least `period` ago, each once.
    fn counts(&mut self, now: Instant, period: Duration) -> Vec<Count> {
        let is_over = |since: Instant| now.saturating_duration_since(since) >= period;
        let mut counts = mem::take(&mut self.forgotten);
        for (source, written) in &mut self.lines {
            if is_over(written.at)
                && let Some(count) = written.count(source)
            {
                written.at = now;
                counts.push(count);
            }
        }
        counts.sort();
        counts
    }
}

impl Written {
    /// The line that states its count, which is reset.
    fn count(&mut self, source: &Source) -> Option<Count> {
        let left_out = Some(mem::take(&mut self.left_out)).filter(|count| *count > 0)?;
        let is_event = match source {
            Source::Peer(..) | Source::Event(..) => true,
            Source::Line(_) => false,
            Source::LastOfStep(_) => return None,
        };
        Some(Count {
            text: format!("{}{}", self.text, Repeated(left_out)),
            is_event,
            level: self.level,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(text: &str) -> Source {
        Source::Line(text.into())
    }

    /// Admits a warning whose text is the source's.
    fn admit(repeats: &mut Repeats, text: &str, now: Instant) -> Option<Repeated> {
        repeats.admit(line(text), Level::Warning, text, now)
    }

    fn texts(counts: Vec<Count>) -> Vec<String> {
        counts.into_iter().map(|count| count.text).collect()
    }

    #[test]
    fn the_same_line_is_one_within_a_minute_and_then_says_how_often_it_was() {
        let mut repeats = Repeats::default();
        let begin = Instant::now();
        let mut written = Vec::new();
        for second in 0..=60 {
            let now = begin + Duration::from_secs(second);
            if let Some(repeated) = admit(&mut repeats, "away", now) {
                written.push(format!("{second}{repeated}"));
            }
        }
        assert_eq!(written, ["0", "60 (59 more of these since the last one)"]);
        assert!(admit(&mut repeats, "another", begin).is_some());
    }

    #[test]
    fn what_was_left_out_is_counted_when_its_minute_is_over_or_at_the_end() {
        let mut repeats = Repeats::default();
        let begin = Instant::now();
        for _ in 0..=5 {
            admit(&mut repeats, "away", begin);
        }
        assert!(repeats.counts(begin + PERIOD / 2, PERIOD).is_empty());
        let counted = ["away (5 more of these since the last one)"];
        assert_eq!(texts(repeats.counts(begin + PERIOD, PERIOD)), counted);
        assert!(
            repeats
                .counts(begin + 2 * PERIOD, Duration::ZERO)
                .is_empty()
        );
        // The count was a line as well.
        let soon = begin + PERIOD + PERIOD / 2;
        assert!(admit(&mut repeats, "away", soon).is_none());
        let counted = ["away (1 more of these since the last one)"];
        assert_eq!(texts(repeats.counts(soon, Duration::ZERO)), counted);
    }

    #[test]
    fn no_more_lines_are_remembered_than_the_limit_and_no_count_is_lost() {
        let mut repeats = Repeats::default();
        let now = Instant::now();
        for number in 0..MAX_REMEMBERED {
            assert!(admit(&mut repeats, &number.to_string(), now).is_some());
        }
        assert!(admit(&mut repeats, "0", now).is_none());
        assert!(admit(&mut repeats, "one more", now).is_some());
        assert!(repeats.lines.len() <= MAX_REMEMBERED);
        let counted = ["0 (1 more of these since the last one)"];
        assert_eq!(texts(repeats.counts(now, Duration::ZERO)), counted);
    }

    #[test]
    fn every_different_line_about_our_own_work_is_written() {
        let mut repeats = Repeats::default();
        let now = Instant::now();
        for number in 0..500 {
            let text = format!("scenario {number} is damaged");
            assert!(admit(&mut repeats, &text, now).is_some());
        }
    }
}
