//! Hands images from one thread to another: a few that wait, of which the oldest are dropped, or every one.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A place for a few things, one after another.
pub(crate) struct Slot<T> {
    state: Mutex<State<T>>,
    changed: Condvar,
    most: usize,
}

struct State<T> {
    waiting: VecDeque<T>,
    is_closed: bool,
}

/// Result of a wait for a thing.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Taken<T> {
    /// It came.
    Content(T),
    /// Nothing came in this time.
    Nothing,
    /// Nothing will come.
    Closed,
}

impl<T> Slot<T> {
    /// A place for so many things.
    pub(crate) fn of(most: usize) -> Self {
        Self {
            state: Mutex::new(State {
                waiting: VecDeque::new(),
                is_closed: false,
            }),
            changed: Condvar::new(),
            most,
        }
    }

    /// Puts a thing here at once, and returns the oldest one if there are too many.
    pub(crate) fn put(&self, content: T) -> Option<T> {
        let mut state = self.lock();
        state.waiting.push_back(content);
        self.changed.notify_all();
        let is_full = state.waiting.len() > self.most;
        is_full.then(|| state.waiting.pop_front()).flatten()
    }

    /// True if nothing waits here.
    pub(crate) fn is_empty(&self) -> bool {
        self.lock().waiting.is_empty()
    }

    /// Puts a thing here when there is room. False: it was closed.
    pub(crate) fn put_after(&self, content: T) -> bool {
        let state = self.lock();
        let is_occupied =
            |state: &mut State<T>| state.waiting.len() >= self.most && !state.is_closed;
        let mut state = self
            .changed
            .wait_while(state, is_occupied)
            .unwrap_or_else(PoisonError::into_inner);
        if !state.is_closed {
            state.waiting.push_back(content);
            self.changed.notify_all();
        }
        !state.is_closed
    }

    /// Takes the oldest thing here, or waits for one.
    pub(crate) fn take(&self, most: Duration) -> Taken<T> {
        let state = self.lock();
        let is_empty = |state: &mut State<T>| state.waiting.is_empty() && !state.is_closed;
        let (mut state, _) = self
            .changed
            .wait_timeout_while(state, most, is_empty)
            .unwrap_or_else(PoisonError::into_inner);
        match state.waiting.pop_front() {
            Some(content) => {
                self.changed.notify_all();
                Taken::Content(content)
            }
            None if state.is_closed => Taken::Closed,
            None => Taken::Nothing,
        }
    }

    /// Nothing will be put here any more.
    pub(crate) fn close(&self) {
        self.lock().is_closed = true;
        self.changed.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, State<T>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use std::thread;

    use super::*;

    const LONG: Duration = Duration::from_secs(60);

    #[test]
    fn the_newest_replaces_the_oldest_that_nobody_took() {
        let slot = Slot::of(2);
        assert_eq!(
            [slot.put(1), slot.put(2), slot.put(3)],
            [None, None, Some(1)]
        );
        assert_eq!(slot.take(LONG), Taken::Content(2));
        assert_eq!(slot.take(LONG), Taken::Content(3));
        assert!(slot.is_empty());
        assert_eq!(slot.take(Duration::ZERO), Taken::Nothing);
    }

    #[test]
    fn one_after_another_loses_none_and_what_is_here_outlives_the_end() {
        let slot = Slot::of(1);
        thread::scope(|scope| {
            scope.spawn(|| {
                for number in 0..100 {
                    assert!(slot.put_after(number));
                }
                slot.close();
            });
            for number in 0..100 {
                assert_eq!(slot.take(LONG), Taken::Content(number));
            }
            assert_eq!(slot.take(LONG), Taken::Closed);
            assert!(!slot.put_after(100));
        });
    }
}
