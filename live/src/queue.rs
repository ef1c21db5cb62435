//! Hand-over between threads: a bounded queue that drops the oldest item or waits, and locks that survive a panic.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Locks a value, also after a thread has panicked with it.
pub(crate) fn lock<T>(value: &Mutex<T>) -> MutexGuard<'_, T> {
    value.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Bounded queue.
pub(crate) struct Queue<T> {
    state: Mutex<State<T>>,
    changed: Condvar,
    most: usize,
}

struct State<T> {
    waiting: VecDeque<T>,
    is_closed: bool,
}

/// A wait's result.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Taken<T> {
    /// The oldest item.
    Content(T),
    /// Timeout.
    Nothing,
    /// The queue is closed.
    Closed,
}

impl<T> Queue<T> {
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

    /// Adds an item at once, and returns the oldest one if there are too many.
    pub(crate) fn put(&self, content: T) -> Option<T> {
        let mut state = lock(&self.state);
        state.waiting.push_back(content);
        self.changed.notify_all();
        let is_full = state.waiting.len() > self.most;
        is_full.then(|| state.waiting.pop_front()).flatten()
    }

    pub(crate) fn is_empty(&self) -> bool {
        lock(&self.state).waiting.is_empty()
    }

    /// Adds an item when there is room; false if the queue is closed.
    pub(crate) fn put_after(&self, content: T) -> bool {
        let state = lock(&self.state);
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

    /// Takes the oldest item, or waits for one.
    pub(crate) fn take(&self, most: Duration) -> Taken<T> {
        let state = lock(&self.state);
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

    /// Ends the queue.
    pub(crate) fn close(&self) {
        lock(&self.state).is_closed = true;
        self.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use std::thread;

    use super::*;

    const LONG: Duration = Duration::from_secs(60);

    #[test]
    fn the_newest_replaces_the_oldest_that_nobody_took() {
        let queue = Queue::of(2);
        assert_eq!(
            [queue.put(1), queue.put(2), queue.put(3)],
            [None, None, Some(1)]
        );
        assert_eq!(queue.take(LONG), Taken::Content(2));
        assert_eq!(queue.take(LONG), Taken::Content(3));
        assert!(queue.is_empty());
        assert_eq!(queue.take(Duration::ZERO), Taken::Nothing);
    }

    #[test]
    fn one_after_another_loses_none_and_what_is_here_outlives_the_end() {
        let queue = Queue::of(1);
        thread::scope(|scope| {
            scope.spawn(|| {
                for number in 0..100 {
                    assert!(queue.put_after(number));
                }
                queue.close();
            });
            for number in 0..100 {
                assert_eq!(queue.take(LONG), Taken::Content(number));
            }
            assert_eq!(queue.take(LONG), Taken::Closed);
            assert!(!queue.put_after(100));
        });
    }
}
