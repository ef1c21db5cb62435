//! A network that loses, duplicates and reorders datagrams. Pure: a datagram goes in, those that arrive come out.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;

use super::Faults;

/// Calls of [`Disorder::pass_time`] after which a held datagram arrives even though none followed it.
const HELD_AT_MOST: u32 = 3;

/// Direction of datagrams. The two directions draw different random numbers.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Way {
    In = 1,
    Out = 2,
}

/// Datagrams in one direction through a network that loses, repeats and reorders them.
#[derive(Debug)]
pub(crate) struct Disorder<T> {
    loss: f64,
    duplication: f64,
    reordering: f64,
    random: ChaCha12Rng,
    /// The datagram that arrives after the next one.
    held: Option<T>,
    held_for: u32,
}

impl<T: Clone> Disorder<T> {
    pub(crate) fn new(faults: &Faults, way: Way) -> Self {
        let mut random = ChaCha12Rng::seed_from_u64(faults.seed);
        random.set_stream(way as u64);
        Self {
            loss: faults.loss,
            duplication: faults.duplication,
            reordering: faults.reordering,
            random,
            held: None,
            held_for: 0,
        }
    }

    /// Sends a datagram; returns what arrives now.
    pub(crate) fn pass(&mut self, datagram: T) -> Vec<T> {
        // Always three draws, so that one rate does not change which datagrams the others affect.
        let [loses, doubles, delays] = [self.loss, self.duplication, self.reordering]
            .map(|share| self.random.random::<f64>() < share);
        if loses {
            return Vec::new();
        }
        let mut arriving = vec![datagram];
        if doubles {
            arriving.extend(arriving.first().cloned());
        }
        if delays && self.held.is_none() {
            self.held_for = 0;
            self.held = arriving.pop();
        } else {
            arriving.extend(self.held.take());
        }
        arriving
    }

    /// A frame passes; returns datagrams that have waited long enough for a successor.
    pub(crate) fn pass_time(&mut self) -> Option<T> {
        self.held_for += 1;
        if self.held_for < HELD_AT_MOST {
            return None;
        }
        self.held.take()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sent_through(faults: &str, count: u32) -> Vec<u32> {
        let mut network = Disorder::new(&faults.parse().unwrap(), Way::In);
        let mut arrived: Vec<u32> = (0..count).flat_map(|i| network.pass(i)).collect();
        arrived.extend((0..HELD_AT_MOST).filter_map(|_| network.pass_time()));
        arrived
    }

    #[test]
    fn without_faults_everything_arrives_once_and_in_order() {
        assert_eq!(sent_through("", 1_000), (0..1_000).collect::<Vec<_>>());
    }

    #[test]
    fn each_fault_hits_the_share_that_was_asked_for() {
        let share = |count: usize| count as f64 / 10_000.0;
        let lost = 10_000 - sent_through("loss=0.2", 10_000).len();
        assert!((share(lost) - 0.2).abs() < 0.02, "{lost}");
        let doubled = sent_through("dup=0.1", 10_000).len() - 10_000;
        assert!((share(doubled) - 0.1).abs() < 0.02, "{doubled}");
        let shuffled = sent_through("reorder=0.1", 10_000);
        let late = shuffled.windows(2).filter(|pair| pair[1] < pair[0]).count();
        // One in ten, less those that arrive while one is held back.
        assert!((share(late) - 0.09).abs() < 0.02, "{late}");
        let mut sorted = shuffled;
        sorted.sort_unstable();
        assert_eq!(
            sorted,
            (0..10_000).collect::<Vec<_>>(),
            "something got lost"
        );
    }

    #[test]
    fn the_same_seed_hits_the_same_datagrams_and_another_one_others() {
        let faults = "loss=0.2,dup=0.1,reorder=0.1";
        let first = sent_through(faults, 200);
        assert_eq!(first, sent_through(faults, 200));
        assert_ne!(first, sent_through(&format!("{faults},seed=1"), 200));
    }
}
