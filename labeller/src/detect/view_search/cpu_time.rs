//! Breakdown of the processor time of a search.

use std::cell::Cell;
use std::ops::{AddAssign, Index, IndexMut};
use std::time::Duration;

use rustix::time::{ClockId, clock_gettime};
use serde::{Deserialize, Serialize};

/// Processor time, seconds. Threads of the model's own are not in it: `dtd detect` gives it none.
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

/// A part of the work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stage {
    Decode,
    Convert,
    Infer,
    Rest,
}

impl CpuTime {
    /// All of it.
    pub fn total(&self) -> f64 {
        self.decode + self.convert + self.infer + self.rest
    }
}

impl AddAssign for CpuTime {
    fn add_assign(&mut self, other: Self) {
        for stage in [Stage::Decode, Stage::Convert, Stage::Infer, Stage::Rest] {
            self[stage] += other[stage];
        }
    }
}

impl Index<Stage> for CpuTime {
    type Output = f64;

    fn index(&self, stage: Stage) -> &f64 {
        match stage {
            Stage::Decode => &self.decode,
            Stage::Convert => &self.convert,
            Stage::Infer => &self.infer,
            Stage::Rest => &self.rest,
        }
    }
}

impl IndexMut<Stage> for CpuTime {
    fn index_mut(&mut self, stage: Stage) -> &mut f64 {
        match stage {
            Stage::Decode => &mut self.decode,
            Stage::Convert => &mut self.convert,
            Stage::Infer => &mut self.infer,
            Stage::Rest => &mut self.rest,
        }
    }
}

/// Measures the calling thread. Time counts as [`Stage::Rest`] unless it was spent in [`CpuClock::during`].
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

    /// Does a piece of work of a stage.
    pub(crate) fn during<T>(&self, stage: Stage, work: impl FnOnce() -> T) -> T {
        self.lap(Stage::Rest);
        let done = work();
        self.lap(stage);
        done
    }

    /// Processor time spent so far.
    pub(crate) fn spent(&self) -> CpuTime {
        self.lap(Stage::Rest);
        self.spent.get()
    }

    fn lap(&self, stage: Stage) {
        let now = of_this_thread();
        let mut spent = self.spent.get();
        spent[stage] += now.saturating_sub(self.since.replace(now)).as_secs_f64();
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
        let sum = clock.during(Stage::Infer, || {
            (0..3_000_000_u64).map(std::hint::black_box).sum::<u64>()
        });
        assert!(sum > 0);
        let (sender, receiver) = std::sync::mpsc::channel();
        let other = std::thread::spawn(move || {
            let sum: u64 = (0..30_000_000_u64).map(std::hint::black_box).sum();
            sender.send(sum).unwrap();
        });
        clock.during(Stage::Decode, || receiver.recv().unwrap());
        other.join().unwrap();
        let spent = clock.spent();
        assert!(spent.infer > 0.0 && spent.infer > spent.decode, "{spent:?}");
        assert!((spent.total() - spent.infer - spent.decode - spent.rest).abs() < 1e-9);
    }
}
