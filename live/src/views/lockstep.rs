//! Keeps the searches of recordings together that are read as fast as possible, so that few images wait for those of the other views.

use std::sync::{Condvar, Mutex};

use crate::queue::lock;

/// Maximum lead over other views, s of the recording.
const MAX_AHEAD_S: f64 = 2.0;

/// The times that the views have reached; none once a view has ended.
pub(crate) struct Lockstep {
    reached_s: Mutex<Vec<Option<f64>>>,
    changed: Condvar,
}

impl Lockstep {
    pub(crate) fn of(views: usize) -> Self {
        Self {
            reached_s: Mutex::new(vec![Some(f64::NEG_INFINITY); views]),
            changed: Condvar::new(),
        }
    }

    /// Waits until no view is far behind this time.
    pub(crate) fn reach(&self, view: usize, time_s: f64) {
        let mut reached = lock(&self.reached_s);
        reached[view] = Some(time_s);
        self.changed.notify_all();
        let is_ahead = |reached: &mut Vec<Option<f64>>| {
            let others = reached.iter().flatten();
            others
                .copied()
                .any(|other_s| other_s < time_s - MAX_AHEAD_S)
        };
        drop(self.changed.wait_while(reached, is_ahead));
    }

    pub(crate) fn leave(&self, view: usize) {
        lock(&self.reached_s)[view] = None;
        self.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};
    use std::thread;

    use super::*;

    #[test]
    fn no_view_runs_away_and_one_that_ended_holds_none_up() {
        let lockstep = Lockstep::of(2);
        let slow = AtomicU32::new(0);
        thread::scope(|scope| {
            scope.spawn(|| {
                for second in 0..20 {
                    slow.store(second, Ordering::SeqCst);
                    lockstep.reach(0, f64::from(second));
                }
                lockstep.leave(0);
            });
            for second in 0..20 {
                lockstep.reach(1, f64::from(second));
                let reached = f64::from(slow.load(Ordering::SeqCst));
                assert!(reached >= f64::from(second) - MAX_AHEAD_S);
            }
            lockstep.reach(1, 1e6);
        });
    }
}
