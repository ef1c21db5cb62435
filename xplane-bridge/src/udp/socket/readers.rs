//! Assigns a socket's values to its readers. Pure, except for the channels to the readers.

use std::collections::BTreeMap;
use std::collections::hash_map::RandomState;
use std::hash::{BuildHasher, Hasher};

use tokio::sync::mpsc;

use crate::packet::{DatarefValue, Position};

/// Datagrams that wait for a reader; more are lost, as is usual with UDP.
const WAITING: usize = 256;
/// A socket's numbers begin at one of this many places, this far apart: a client that takes over a port must not mistake values that are
/// still on the way for its own.
const STARTS: u64 = 65_536;
const APART: i32 = 256;

#[derive(Debug)]
pub(super) struct Readers {
    next: i32,
    by_first: BTreeMap<i32, Reader>,
    positions: Option<mpsc::Sender<Position>>,
}

#[derive(Debug)]
struct Reader {
    /// The number after its last one.
    end: i32,
    values: mpsc::Sender<Vec<DatarefValue>>,
}

impl Readers {
    /// No readers. The first number is random, and never 0, which clients use for "all".
    pub(super) fn new() -> Self {
        let random = RandomState::new().build_hasher().finish();
        Self {
            next: 1 + (random % STARTS) as i32 * APART,
            by_first: BTreeMap::new(),
            positions: None,
        }
    }

    /// Reserves fresh numbers; returns the first, and where the values arrive.
    pub(super) fn claim(&mut self, count: usize) -> (i32, mpsc::Receiver<Vec<DatarefValue>>) {
        let count = i32::try_from(count).unwrap_or(i32::MAX - 1);
        // The numbers last for years of reading.
        let (first, end) = match self.next.checked_add(count) {
            Some(end) => (self.next, end),
            None => (1, 1 + count),
        };
        self.next = end;
        let (sender, values) = mpsc::channel(WAITING);
        self.by_first.insert(
            first,
            Reader {
                end,
                values: sender,
            },
        );
        (first, values)
    }

    /// Releases claimed numbers.
    pub(super) fn release(&mut self, first: i32) {
        self.by_first.remove(&first);
    }

    /// A new reader of positions.
    pub(super) fn positions(&mut self) -> mpsc::Receiver<Position> {
        let (sender, positions) = mpsc::channel(WAITING);
        self.positions = Some(sender);
        positions
    }

    /// Gives values to their readers; returns the numbers that have none. A value that is not finite does not count: the dataref stays
    /// without one, as if the simulator had not answered.
    pub(super) fn hand_out(&self, values: impl IntoIterator<Item = DatarefValue>) -> Vec<i32> {
        let mut unwanted = Vec::new();
        let mut by_reader: BTreeMap<i32, Vec<DatarefValue>> = BTreeMap::new();
        for value in values {
            match self.reader_of(value.index) {
                Some(_) if !value.value.is_finite() => {
                    tracing::debug!(?value, "ignored, since it is not a finite number");
                }
                Some(first) => by_reader.entry(first).or_default().push(value),
                None => unwanted.push(value.index),
            }
        }
        for (first, values) in by_reader {
            if let Some(reader) = self.by_first.get(&first) {
                let _ = reader.values.try_send(values);
            }
        }
        unwanted
    }

    fn reader_of(&self, index: i32) -> Option<i32> {
        let (&first, reader) = self.by_first.range(..=index).next_back()?;
        (index < reader.end).then_some(first)
    }

    /// Gives a position to its reader, unless it has a number that is not finite; returns true if there is a reader.
    pub(super) fn hand_out_position(&self, position: Position) -> bool {
        match &self.positions {
            Some(reader) if !reader.is_closed() => {
                if position.is_finite() {
                    let _ = reader.try_send(position);
                }
                true
            }
            _ => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(index: i32) -> DatarefValue {
        DatarefValue { index, value: 1.0 }
    }

    fn position() -> Position {
        Position {
            longitude_deg: 103.9,
            latitude_deg: 1.3,
            elevation_msl_m: 0.0,
            height_agl_m: 0.0,
            pitch_deg: 0.0,
            heading_true_deg: 0.0,
            roll_deg: 0.0,
            velocity_east_mps: 0.0,
            velocity_up_mps: 0.0,
            velocity_south_mps: 0.0,
            roll_rate_rad_s: 0.0,
            pitch_rate_rad_s: 0.0,
            yaw_rate_rad_s: 0.0,
        }
    }

    #[test]
    fn each_reader_gets_its_own_values_and_those_of_no_reader_are_named() {
        let mut readers = Readers::new();
        let (first, mut of_first) = readers.claim(2);
        let (second, mut of_second) = readers.claim(1);
        let all = [first, first + 1, second, second + 1, 0];
        let unwanted = readers.hand_out(all.into_iter().map(value));
        assert_eq!(unwanted, [second + 1, 0]);
        assert_eq!(of_first.try_recv().unwrap().len(), 2);
        assert_eq!(of_second.try_recv().unwrap(), [value(second)]);
        readers.release(first);
        assert_eq!(readers.hand_out([value(first)].into_iter()), [first]);
    }

    #[test]
    fn a_value_or_a_position_that_is_not_finite_reaches_no_reader() {
        let mut readers = Readers::new();
        let (first, mut values) = readers.claim(1);
        for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let strange = DatarefValue {
                index: first,
                value,
            };
            let unwanted = readers.hand_out([strange]);
            assert!(unwanted.is_empty() && values.try_recv().is_err(), "{value}");
        }
        let mut positions = readers.positions();
        let mut nowhere = position();
        nowhere.latitude_deg = f64::NAN;
        assert!(readers.hand_out_position(nowhere));
        let mut turning = position();
        turning.yaw_rate_rad_s = f32::INFINITY;
        assert!(readers.hand_out_position(turning));
        assert!(positions.try_recv().is_err());
        assert!(readers.hand_out_position(position()));
        assert_eq!(positions.try_recv(), Ok(position()));
    }

    #[test]
    fn numbers_are_fresh_and_positive_even_after_the_last_one() {
        let mut readers = Readers::new();
        assert!(readers.next >= 1);
        readers.next = i32::MAX - 2;
        let (last, _values) = readers.claim(2);
        let (again, _values) = readers.claim(5);
        assert_eq!((last, again), (i32::MAX - 2, 1));
    }

    #[test]
    fn a_reader_of_positions_that_has_gone_wants_no_more() {
        let mut readers = Readers::new();
        assert!(!readers.hand_out_position(position()));
        let reader = readers.positions();
        assert!(readers.hand_out_position(position()));
        drop(reader);
        assert!(!readers.hand_out_position(position()));
    }
}
