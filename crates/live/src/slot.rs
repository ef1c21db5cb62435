//! Hands images from one thread to another: the newest one first, or every one.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A place for one thing.
pub(crate) struct Slot<T> {
    state: Mutex<State<T>>,
    changed: Condvar,
}

struct State<T> {
    content: Option<T>,
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
    pub(crate) fn new() -> Self {
        Self {
            state: Mutex::new(State {
                content: None,
                is_closed: false,
            }),
            changed: Condvar::new(),
        }
    }

    /// Puts a thing here at once, and returns the one that waited in its place.
    pub(crate) fn put(&self, content: T) -> Option<T> {
        let before = self.lock().content.replace(content);
        self.changed.notify_all();
        before
    }

    /// Puts a thing here when the one before was taken. False: it was closed.
    pub(crate) fn put_after(&self, content: T) -> bool {
        let state = self.lock();
        let is_occupied = |state: &mut State<T>| state.content.is_some() && !state.is_closed;
        let mut state = self
            .changed
            .wait_while(state, is_occupied)
            .unwrap_or_else(PoisonError::into_inner);
        if !state.is_closed {
            state.content = Some(content);
            self.changed.notify_all();
        }
        !state.is_closed
    }

    /// Takes what is here, or waits for it.
    pub(crate) fn take(&self, most: Duration) -> Taken<T> {
        let state = self.lock();
        let is_empty = |state: &mut State<T>| state.content.is_none() && !state.is_closed;
        let (mut state, _) = self
            .changed
            .wait_timeout_while(state, most, is_empty)
            .unwrap_or_else(PoisonError::into_inner);
        match state.content.take() {
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
    fn the_newest_replaces_what_nobody_took() {
        let slot = Slot::new();
        assert_eq!(slot.put(1), None);
        assert_eq!(slot.put(2), Some(1));
        assert_eq!(slot.take(LONG), Taken::Content(2));
        assert_eq!(slot.take(Duration::ZERO), Taken::Nothing);
    }

    #[test]
    fn one_after_another_loses_none_and_what_is_here_outlives_the_end() {
        let slot = Slot::new();
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
