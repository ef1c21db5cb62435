//! When a line of progress is due in a log: not so often that a night's log is unreadable, not so rarely that a run seems
//! dead. Pure.

use std::time::Duration;

use super::standing::Standing;

/// Number of parts of the work with a line each.
const PARTS: u64 = 10;
/// Minimum time between lines, except for a step's last one.
const MIN_TIME: Duration = Duration::from_secs(10);
/// Minimum time between lines for programs.
const MIN_FOR_PROGRAMS: Duration = Duration::from_secs(1);
/// A line is due after this time at the latest: within five minutes of the last one, looked at every [`BEAT`].
const MAX_TIME: Duration = Duration::from_secs(290);
/// Interval of checks for a due line while the work does not move.
pub(super) const BEAT: Duration = Duration::from_secs(5);

/// The last written progress of a step.
#[derive(Debug, Default)]
pub(super) struct Cadence {
    part: u64,
    done: u64,
    is_complete: bool,
}

impl Cadence {
    /// Starts from the progress of an earlier process.
    pub(super) fn resume(&mut self, standing: &Standing) {
        *self = Self {
            part: part(standing),
            done: standing.done,
            is_complete: false,
        };
    }

    /// True if a line is due. `since`: the time since the last line of progress of this process, or since its step began. If so, it counts
    /// as written.
    pub(super) fn is_due(
        &mut self,
        standing: &Standing,
        since: Duration,
        for_programs: bool,
    ) -> bool {
        let is_due = if standing.is_complete() {
            !self.is_complete
        } else if for_programs {
            since >= MAX_TIME || (standing.done != self.done && since >= MIN_FOR_PROGRAMS)
        } else {
            since >= MAX_TIME || (part(standing) > self.part && since >= MIN_TIME)
        };
        if is_due {
            self.resume(standing);
            self.is_complete = standing.is_complete();
        }
        is_due
    }
}

fn part(standing: &Standing) -> u64 {
    let total = standing.total.unwrap_or(0).max(1);
    standing.done.saturating_mul(PARTS) / total
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(done: u64) -> Standing {
        Standing {
            total: Some(100),
            done,
            ..Standing::default()
        }
    }

    #[test]
    fn a_line_is_due_after_each_tenth_but_not_more_than_one_in_ten_seconds() {
        let mut cadence = Cadence::default();
        let mut lines = Vec::new();
        let mut last_s = 0;
        for done in 0..=100 {
            // A hundredth every 3 seconds.
            let since = Duration::from_secs(3 * done - last_s);
            if cadence.is_due(&at(done), since, false) {
                last_s = 3 * done;
                lines.push(done);
            }
        }
        assert_eq!(lines, [10, 20, 30, 40, 50, 60, 70, 80, 90, 100]);
        let mut fast = Cadence::default();
        let lines = (0..=100).filter(|done| fast.is_due(&at(*done), Duration::ZERO, false));
        assert_eq!(lines.collect::<Vec<_>>(), [100]);
    }

    #[test]
    fn a_line_is_due_within_five_minutes_although_the_work_does_not_move() {
        let mut cadence = Cadence::default();
        let minutes = Duration::from_secs(60);
        assert!(!cadence.is_due(&at(3), 4 * minutes, false));
        assert!(cadence.is_due(&at(3), 5 * minutes - BEAT, false));
        let unknown = Standing::default();
        assert!(cadence.is_due(&unknown, 5 * minutes - BEAT, false));
        assert!(cadence.is_due(&unknown, 5 * minutes - BEAT, true));
    }

    #[test]
    fn the_last_line_of_a_step_is_written_once() {
        let mut cadence = Cadence::default();
        assert!(cadence.is_due(&at(100), Duration::ZERO, true));
        assert!(!cadence.is_due(&at(100), Duration::from_secs(900), true));
    }

    #[test]
    fn a_program_gets_a_line_a_second_while_the_work_moves() {
        let mut cadence = Cadence::default();
        let second = Duration::from_secs(1);
        assert!(!cadence.is_due(&at(1), second / 2, true));
        assert!(cadence.is_due(&at(1), second, true));
        assert!(!cadence.is_due(&at(1), 20 * second, true));
    }
}
