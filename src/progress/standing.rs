//! A step's progress and pace. Pure.

use std::time::Duration;

use indicatif::{DecimalBytes, HumanDuration};
use serde::Serialize;

/// Minimum time for a meaningful pace.
const MIN_TIME: Duration = Duration::from_secs(1);

/// Progress in scenarios.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub(crate) struct Scenarios {
    /// Number of the one in work, from 1; the last one at the end.
    pub(crate) number: usize,
    /// Their total number.
    pub(crate) of: usize,
    /// Number of failures.
    pub(crate) failed: usize,
}

/// The output disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Disk {
    /// Bytes written by this run.
    pub(crate) written: u64,
    /// Free bytes, if the system reports them.
    pub(crate) free: Option<u64>,
}

/// Progress of a step.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Standing {
    pub(crate) total: Option<u64>,
    pub(crate) done: u64,
    /// Units among them that this process did not finish, which say nothing about its pace.
    pub(crate) before: u64,
    pub(crate) working_on: String,
    pub(crate) scenarios: Option<Scenarios>,
    pub(crate) disk: Option<Disk>,
}

impl Standing {
    /// True at the end.
    pub(crate) fn is_complete(&self) -> bool {
        self.total.is_some_and(|total| self.done >= total)
    }

    /// Units per second, once known.
    pub(crate) fn per_s(&self, elapsed: Duration) -> Option<f64> {
        let done = self
            .done
            .checked_sub(self.before)
            .filter(|done| *done > 0)?;
        (elapsed >= MIN_TIME).then(|| done as f64 / elapsed.as_secs_f64())
    }

    /// The time that is left at that pace, if the end is known.
    pub(crate) fn left(&self, elapsed: Duration) -> Option<Duration> {
        let left = self
            .total?
            .checked_sub(self.done)
            .filter(|left| *left > 0)?;
        Duration::try_from_secs_f64(left as f64 / self.per_s(elapsed)?).ok()
    }

    /// The progress in words, in at most so many columns: the disk is left out first, then the last words.
    pub(crate) fn fitted(&self, unit: &str, elapsed: Duration, columns: usize) -> String {
        let whole = self.words(unit, elapsed, false);
        if whole.chars().count() <= columns {
            return whole;
        }
        let without_disk = Self {
            disk: None,
            ..self.clone()
        };
        shortened(without_disk.words(unit, elapsed, false), columns)
    }

    /// The progress in words. `says_elapsed`: with the elapsed time.
    pub(crate) fn words(&self, unit: &str, elapsed: Duration, says_elapsed: bool) -> String {
        let mut parts = Vec::new();
        let mut count = match self.total {
            Some(total) => format!("{}/{total} {unit}", self.done),
            None if self.done > 0 => format!("{} {unit}", self.done),
            None => String::new(),
        };
        if let Some(per_s) = self.per_s(elapsed) {
            if says_elapsed {
                count += &format!(" in {}", HumanDuration(elapsed));
            }
            count += &format!(", {}", rate(per_s));
        }
        if let Some(left) = self.left(elapsed) {
            count += &format!(", {} left", HumanDuration(left));
        }
        parts.push(count);
        if let Some(Scenarios { number, of, failed }) = self.scenarios {
            parts.push(match failed {
                0 => format!("scenario {number} of {of}"),
                failed => format!("scenario {number} of {of}, {failed} failed"),
            });
        }
        if let Some(Disk { written, free }) = self.disk {
            let free = free.map(|free| format!(", {} free", DecimalBytes(free)));
            let written = DecimalBytes(written);
            parts.push(format!("{written} written{}", free.unwrap_or_default()));
        }
        parts.push(self.working_on.clone());
        parts.retain(|part| !part.is_empty());
        parts.join("; ")
    }
}

/// The text in at most so many columns: whole words, and an ellipsis in the place of the others.
fn shortened(text: String, columns: usize) -> String {
    if text.chars().count() <= columns {
        return text;
    }
    let mut kept: Vec<&str> = text.split(' ').collect();
    let width = |kept: &[&str]| {
        kept.iter()
            .map(|word| word.chars().count() + 1)
            .sum::<usize>()
    };
    while !kept.is_empty() && width(&kept) > columns {
        kept.pop();
    }
    let kept = kept.join(" ");
    format!("{}…", kept.trim_end_matches([';', ',', ':']))
}

fn rate(per_s: f64) -> String {
    match per_s {
        rate if rate >= 1.0 => format!("{rate:.1}/s"),
        rate => format!("{:.1}/min", rate * 60.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn standing(done: u64, before: u64, total: Option<u64>) -> Standing {
        Standing {
            total,
            done,
            before,
            ..Standing::default()
        }
    }

    fn words(standing: &Standing, elapsed_s: f64) -> String {
        standing.words("ticks", Duration::from_secs_f64(elapsed_s), true)
    }

    #[test]
    fn pace_and_remaining_time_are_said_once_they_are_known() {
        let of_200 = |done, elapsed_s| words(&standing(done, 0, Some(200)), elapsed_s);
        assert_eq!(of_200(20, 0.1), "20/200 ticks");
        assert_eq!(of_200(0, 10.0), "0/200 ticks");
        assert_eq!(
            of_200(50, 10.0),
            "50/200 ticks in 10 seconds, 5.0/s, 30 seconds left"
        );
        assert_eq!(
            of_200(20, 7_200.0),
            "20/200 ticks in 2 hours, 0.2/min, 18 hours left"
        );
        assert_eq!(of_200(200, 20.0), "200/200 ticks in 20 seconds, 10.0/s");
        assert_eq!(
            words(&standing(150, 100, Some(200)), 10.0),
            "150/200 ticks in 10 seconds, 5.0/s, 10 seconds left"
        );
        assert_eq!(words(&standing(0, 0, None), 10.0), "");
        assert_eq!(
            words(&standing(7, 0, None), 7.0),
            "7 ticks in 7 seconds, 1.0/s"
        );
    }

    #[test]
    fn on_a_narrow_terminal_the_disk_and_then_the_last_words_are_left_out() {
        let mut night = standing(1, 0, Some(2));
        night.disk = Some(Disk::default());
        night.working_on = "0600-clear-r1 0600-cloudy-r1".into();
        let fitted = |columns| night.fitted("ticks", Duration::ZERO, columns);
        let whole = "1/2 ticks; 0 B written; 0600-clear-r1 0600-cloudy-r1";
        assert_eq!(fitted(52), whole);
        assert_eq!(fitted(51), "1/2 ticks; 0600-clear-r1 0600-cloudy-r1");
        assert_eq!(fitted(38), "1/2 ticks; 0600-clear-r1…");
        assert_eq!(fitted(24), "1/2 ticks…");
        assert_eq!(fitted(3), "…");
    }

    #[test]
    fn scenarios_failures_and_disk_are_named() {
        let mut night = standing(1, 0, Some(2));
        night.scenarios = Some(Scenarios {
            number: 37,
            of: 100,
            failed: 0,
        });
        night.disk = Some(Disk {
            written: 12_400_000_000,
            free: Some(512_000_000_000),
        });
        night.working_on = "0037-clear".into();
        assert_eq!(
            words(&night, 0.0),
            "1/2 ticks; scenario 37 of 100; 12.40 GB written, 512.00 GB free; 0037-clear"
        );
        night.scenarios = Some(Scenarios {
            number: 37,
            of: 100,
            failed: 2,
        });
        night.disk = Some(Disk::default());
        assert_eq!(
            words(&night, 0.0),
            "1/2 ticks; scenario 37 of 100, 2 failed; 0 B written; 0037-clear"
        );
    }
}
