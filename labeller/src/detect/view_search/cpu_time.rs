//! Processor time of the search by stage.

use std::cell::Cell;
use std::ops::AddAssign;
use std::time::Duration;

use rustix::time::{ClockId, clock_gettime};
use serde::{Deserialize, Serialize};

/// Processor time by stage, in the unit that the field holding it names. Threads of the model's own are not in it: `dtd detect` gives it
/// none.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct CpuTime {
    /// Reading and decoding videos.
    pub decode: f64,
    /// Converting images to RGB.
    pub convert: f64,
    /// Running the model: filling its windows, its inference, reading its answers.
    pub infer: f64,
    /// All else: suppression, tracking, registration.
    pub rest: f64,
}

/// A part of the time.
pub(crate) type Part = fn(&mut CpuTime) -> &mut f64;

impl CpuTime {
    /// All stages together.
    pub fn total(&self) -> f64 {
        self.decode + self.convert + self.infer + self.rest
    }

    /// Times of all stages in a different unit.
    #[must_use]
    pub fn map(&self, in_unit: impl Fn(f64) -> f64) -> Self {
        Self {
            decode: in_unit(self.decode),
            convert: in_unit(self.convert),
            infer: in_unit(self.infer),
            rest: in_unit(self.rest),
        }
    }
}

impl AddAssign for CpuTime {
    fn add_assign(&mut self, other: Self) {
        self.decode += other.decode;
        self.convert += other.convert;
        self.infer += other.infer;
        self.rest += other.rest;
    }
}

const REST: Part = |time| &mut time.rest;

/// Measures the calling thread. Time counts as `rest` unless it was spent in [`CpuClock::during`].
pub(crate) struct CpuClock {
    since: Cell<Duration>,
    spent: Cell<CpuTime>,
}

impl CpuClock {
    pub(crate) fn start() -> Self {
        Self {
            since: Cell::new(of_this_thread()),
            spent: Cell::default(),
        }
    }

    /// Measures work as this part.
    pub(crate) fn during<T>(&self, part: Part, work: impl FnOnce() -> T) -> T {
        self.lap(REST);
        let done = work();
        self.lap(part);
        done
    }

    pub(crate) fn spent(&self) -> CpuTime {
        self.lap(REST);
        self.spent.get()
    }

    fn lap(&self, part: Part) {
        let now = of_this_thread();
        let mut spent = self.spent.get();
        *part(&mut spent) += now.saturating_sub(self.since.replace(now)).as_secs_f64();
        self.spent.set(spent);
    }
}

fn of_this_thread() -> Duration {
    // Never negative.
    Duration::try_from(clock_gettime(ClockId::ThreadCPUTime)).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_counts_for_its_stage_and_waiting_for_none() {
        let clock = CpuClock::start();
        let sum = clock.during(
            |cpu_s| &mut cpu_s.infer,
            || (0..3_000_000_u64).map(std::hint::black_box).sum::<u64>(),
        );
        assert!(sum > 0);
        let (sender, receiver) = std::sync::mpsc::channel();
        let other = std::thread::spawn(move || {
            let sum: u64 = (0..30_000_000_u64).map(std::hint::black_box).sum();
            sender.send(sum).unwrap();
        });
        clock.during(|cpu_s| &mut cpu_s.decode, || receiver.recv().unwrap());
        other.join().unwrap();
        let spent = clock.spent();
        assert!(spent.infer > 0.0 && spent.infer > spent.decode, "{spent:?}");
        assert!((spent.total() - spent.infer - spent.decode - spent.rest).abs() < 1e-9);
    }
}
