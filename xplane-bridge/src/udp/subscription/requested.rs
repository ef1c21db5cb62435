//! Bookkeeping of datarefs: subscribed, answered, and next to request. Pure: takes the time and values, returns requests.

use std::time::Duration;

use tokio::time::Instant;

use super::{BATCH, BATCH_PAUSE, Reading, SILENCE};
use crate::packet::{DatarefValue, SubscribeDataref};

/// Delay before a request that brought no value is sent again.
const REPEAT_AFTER: Duration = Duration::from_millis(500);

#[derive(Debug)]
pub(super) struct RequestedDatarefs {
    names: Vec<String>,
    readings: Vec<Option<Reading>>,
    asked_at: Vec<Option<Instant>>,
    frequency_hz: i32,
    /// The number of the first; the others follow.
    first_index: i32,
    batch_from: Option<Instant>,
}

impl RequestedDatarefs {
    pub(super) fn new(names: Vec<String>, frequency_hz: i32, first_index: i32) -> Self {
        Self {
            readings: vec![None; names.len()],
            asked_at: vec![None; names.len()],
            names,
            frequency_hz,
            first_index,
            batch_from: None,
        }
    }

    pub(super) fn readings(&self) -> &[Option<Reading>] {
        &self.readings
    }

    /// Requests due now: never more than X-Plane accepts in a frame.
    pub(super) fn due(&mut self, now: Instant) -> Vec<SubscribeDataref> {
        if self.batch_from.is_some_and(|from| now < from) {
            return Vec::new();
        }
        let due: Vec<usize> = (0..self.names.len())
            .filter(|&at| self.asks_from(at).is_none_or(|from| from <= now))
            .take(BATCH)
            .collect();
        if !due.is_empty() {
            self.batch_from = Some(now + BATCH_PAUSE);
        }
        due.into_iter()
            .map(|at| {
                self.asked_at[at] = Some(now);
                SubscribeDataref {
                    frequency_hz: self.frequency_hz,
                    index: self.first_index + at as i32,
                    path: self.names[at].clone(),
                }
            })
            .collect()
    }

    /// Time of the next check for due requests.
    pub(super) fn wake_at(&self, now: Instant) -> Instant {
        let soonest = (0..self.names.len())
            .map(|at| self.asks_from(at).unwrap_or(now))
            .min()
            .unwrap_or(now + SILENCE);
        soonest.max(self.batch_from.unwrap_or(now)).max(now)
    }

    /// Receives a value of one of its numbers.
    pub(super) fn take(&mut self, value: DatarefValue, now: Instant) {
        let at = (value.index - self.first_index) as usize;
        self.readings[at] = Some(Reading {
            value: value.value,
            at: now,
        });
    }

    /// Time of the next request for a dataref: after its value stopped, but not too soon after the last request; `None` for at once.
    fn asks_from(&self, at: usize) -> Option<Instant> {
        let silent = self.readings[at].map(|reading| reading.at + SILENCE);
        let again = self.asked_at[at].map(|asked| asked + REPEAT_AFTER);
        silent.max(again)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answer(requested: &mut RequestedDatarefs, requests: &[SubscribeDataref], now: Instant) {
        for request in requests {
            let value = DatarefValue {
                index: request.index,
                value: 1.0,
            };
            requested.take(value, now);
        }
    }

    fn roll_of(names: usize) -> RequestedDatarefs {
        RequestedDatarefs::new((0..names).map(|i| format!("dataref/{i}")).collect(), 5, 1)
    }

    #[test]
    fn a_long_roll_is_asked_in_batches_with_pauses() {
        let mut requested = roll_of(250);
        let mut now = Instant::now();
        let mut sizes = Vec::new();
        while sizes.len() < 3 {
            let due = requested.due(now);
            assert!(
                requested.due(now).is_empty(),
                "a second batch in the same frame"
            );
            answer(&mut requested, &due, now);
            sizes.push(due.len());
            now = requested.wake_at(now);
        }
        assert_eq!(sizes, [100, 100, 50]);
        assert!(requested.due(now - Duration::from_millis(1)).is_empty());
    }

    #[test]
    fn what_brought_no_value_is_asked_again_and_nothing_else() {
        let mut requested = roll_of(3);
        let begin = Instant::now();
        let due = requested.due(begin);
        answer(&mut requested, &due[..2], begin);
        assert!(requested.due(begin + Duration::from_millis(400)).is_empty());
        let again = requested.due(begin + REPEAT_AFTER);
        assert_eq!(again.len(), 1);
        assert_eq!(again[0], due[2]);
    }
}
