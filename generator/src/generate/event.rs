//! Run events.

use std::sync::{Mutex, PoisonError};

/// Run event, for display.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Event<'a> {
    /// The run begins.
    Planned {
        /// Scenarios to make.
        to_make: usize,
        /// Scenarios that are already complete.
        skipped: usize,
        /// Expected ticks of all remaining scenarios.
        ticks: u64,
    },
    /// A scenario begins.
    Started {
        /// Scenario identifier.
        id: &'a str,
        /// Expected number of ticks.
        ticks: u32,
    },
    /// The flight is known: from now on the number of ticks is exact.
    Flown {
        /// Scenario identifier.
        id: &'a str,
        /// Number of ticks.
        ticks: u32,
    },
    /// A tick is complete in all views.
    Captured {
        /// Scenario identifier.
        id: &'a str,
        /// Number of complete ticks.
        done: u32,
    },
    /// A scenario is complete.
    Committed {
        /// Scenario identifier.
        id: &'a str,
        /// Number of ticks.
        ticks: u32,
        /// Duration, seconds.
        seconds: f64,
    },
    /// A scenario was finished by a different process in the meantime.
    MadeElsewhere {
        /// Scenario identifier.
        id: &'a str,
        /// Expected number of ticks.
        ticks: u32,
    },
    /// The capture of a scenario restarts, and is slower from now on. Pace and remaining time are estimated again.
    PaceChanged {
        /// Scenario identifier.
        id: &'a str,
    },
    /// An attempt failed and will be repeated.
    Retrying {
        /// Identifier of the scenario.
        id: &'a str,
        /// Reason.
        reason: &'a str,
    },
    /// A scenario is set aside.
    Failed {
        /// Scenario identifier.
        id: &'a str,
        /// Reason.
        reason: &'a str,
    },
    /// A line for people.
    Said(&'a str),
    /// A warning for people.
    Warned(&'a str),
}

/// Receiver of run events.
pub type OnEvent<'a> = dyn FnMut(Event<'_>) + Send + 'a;

pub(super) struct Reporter<'a>(Mutex<&'a mut OnEvent<'a>>);

impl<'a> Reporter<'a> {
    pub(super) fn new(on_event: &'a mut OnEvent<'a>) -> Self {
        Self(Mutex::new(on_event))
    }

    pub(super) fn tell(&self, event: Event<'_>) {
        let mut listener = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        (*listener)(event);
    }

    pub(super) fn say(&self, line: &str) {
        self.tell(Event::Said(line));
    }

    pub(super) fn warn(&self, line: &str) {
        self.tell(Event::Warned(line));
    }
}
