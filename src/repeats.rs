//! Lines that repeat: the first is written, the others are counted, so that neither a flood of bad datagrams nor a store that is away for a
//! night fills a log. Of lines that differ, one place in the code writes a limited number a minute: peers choose some of the text.

use std::collections::HashMap;
use std::fmt;
use std::net::IpAddr;
use std::sync::{LazyLock, Mutex, PoisonError};
use std::time::{Duration, Instant};

use tracing::callsite::Identifier;

/// The same line is written at most once in this time.
const PERIOD: Duration = Duration::from_secs(60);
/// Different lines that one place in the code writes in this time.
const MOST_DIFFERENT: u64 = 60;
/// Lines that are remembered.
const MOST_REMEMBERED: usize = 1_024;

/// The identity of a line.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(crate) enum Source {
    /// An event about a peer: whatever it says, by its place in the code and the peer's address.
    Peer(Identifier, IpAddr),
    /// Any other event, by its place in the code and its text.
    Event(Identifier, String),
    /// A line of a verb, by its text.
    Line(String),
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

/// Admits a line, unless the same one was written a moment ago.
pub(crate) fn admit(source: Source) -> Option<Repeated> {
    static REPEATS: LazyLock<Mutex<Repeats>> = LazyLock::new(Mutex::default);
    let mut repeats = REPEATS.lock().unwrap_or_else(PoisonError::into_inner);
    repeats.admit(source, Instant::now())
}

#[derive(Debug, Default)]
struct Repeats {
    /// When each line was written, and how often it was not since then.
    lines: HashMap<Source, (Instant, u64)>,
    /// Since when lines of a place in the code are counted, and how many were written since then.
    places: HashMap<Identifier, (Instant, u64)>,
}

impl Repeats {
    fn admit(&mut self, source: Source, now: Instant) -> Option<Repeated> {
        let is_recent = |written: Instant| now.saturating_duration_since(written) < PERIOD;
        if let Some((written, unwritten)) = self.lines.get_mut(&source) {
            if is_recent(*written) {
                *unwritten += 1;
                return None;
            }
            let repeated = Repeated(*unwritten);
            (*written, *unwritten) = (now, 0);
            return Some(repeated);
        }
        if let Source::Peer(place, _) | Source::Event(place, _) = &source {
            let (since, different) = self.places.entry(place.clone()).or_insert((now, 0));
            if !is_recent(*since) {
                (*since, *different) = (now, 0);
            }
            *different += 1;
            if *different > MOST_DIFFERENT {
                return None;
            }
        }
        if self.lines.len() >= MOST_REMEMBERED {
            self.lines.retain(|_, (written, _)| is_recent(*written));
        }
        // More different ones than that within a minute: those that are forgotten may be written again.
        if self.lines.len() >= MOST_REMEMBERED {
            self.lines.clear();
        }
        self.lines.insert(source, (now, 0));
        Some(Repeated(0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(text: &str) -> Source {
        Source::Line(text.into())
    }

    #[test]
    fn the_same_line_is_one_within_a_minute_and_then_says_how_often_it_was() {
        let mut repeats = Repeats::default();
        let begin = Instant::now();
        let mut written = Vec::new();
        for second in 0..=60 {
            let now = begin + Duration::from_secs(second);
            if let Some(repeated) = repeats.admit(line("away"), now) {
                written.push(format!("{second}{repeated}"));
            }
        }
        assert_eq!(written, ["0", "60 (59 more of these since the last one)"]);
        assert!(repeats.admit(line("another"), begin).is_some());
    }

    #[test]
    fn no_more_lines_are_remembered_than_the_limit() {
        let mut repeats = Repeats::default();
        let now = Instant::now();
        for number in 0..MOST_REMEMBERED {
            assert!(repeats.admit(line(&number.to_string()), now).is_some());
        }
        assert!(repeats.admit(line("0"), now).is_none());
        assert!(repeats.admit(line("one more"), now).is_some());
        assert!(repeats.lines.len() <= MOST_REMEMBERED);
    }

    #[test]
    fn one_place_in_the_code_writes_sixty_different_lines_a_minute() {
        let place = tracing::subscriber::with_default(tracing_subscriber::registry(), || {
            tracing::info_span!("here").metadata().unwrap().callsite()
        });
        let mut repeats = Repeats::default();
        let begin = Instant::now();
        let mut written = |now: Instant| {
            let lines = (0..1_000).map(|number| Source::Event(place.clone(), number.to_string()));
            let lines = lines.filter(|line| repeats.admit(line.clone(), now).is_some());
            lines.count()
        };
        assert_eq!(written(begin), 60);
        assert_eq!(written(begin + Duration::from_secs(59)), 0);
        // The first sixty may be written again, and as many that were not.
        assert_eq!(written(begin + PERIOD), 120);
    }
}
