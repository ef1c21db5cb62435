//! What a run says while it works.

use std::sync::{Mutex, PoisonError};

use xplane_bridge::profile::KnownProfile;

/// What a run is doing, for whoever shows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Event<'a> {
    /// The run begins.
    Planned {
        /// Scenarios to make.
        to_make: usize,
        /// Scenarios that are whole already.
        skipped: usize,
        /// Expected ticks of all that are to be made.
        ticks: u64,
    },
    /// An earlier run set a scenario aside; this one tries it again.
    SetAsideBefore {
        /// Identifier of the scenario.
        id: &'a str,
        /// Why its last attempt failed.
        reason: &'a str,
    },
    /// The disk may not hold what is to be made.
    LittleSpace {
        /// Bytes that are free.
        free: u64,
        /// Bytes that will be needed, about.
        needed: u64,
    },
    /// Nothing is left to do but what others are making.
    Waiting {
        /// How many scenarios they make.
        scenarios: usize,
        /// Who makes the first of them.
        holder: &'a str,
    },
    /// A scenario begins.
    Started {
        /// Its identifier.
        id: &'a str,
        /// Expected number of ticks.
        ticks: u32,
    },
    /// Its flight is there: from now on the number of ticks is certain.
    Flown {
        /// Its identifier.
        id: &'a str,
        /// Number of ticks.
        ticks: u32,
    },
    /// All views of a tick are captured.
    Captured {
        /// Its identifier.
        id: &'a str,
        /// Ticks so far.
        done: u32,
    },
    /// A scenario is whole.
    Committed {
        /// Its identifier.
        id: &'a str,
        /// Number of ticks.
        ticks: u32,
        /// How long it took, seconds.
        seconds: f64,
    },
    /// Scenarios that an earlier run made, and that are not in the object store yet.
    StagedBefore {
        /// How many.
        scenarios: usize,
    },
    /// A scenario is committed in the object store.
    Uploaded {
        /// Its identifier.
        id: &'a str,
        /// How long it took to send, seconds.
        seconds: f64,
    },
    /// Recording is faster than sending: the run waits before it records on.
    UploadBehind {
        /// The scenario that waits.
        id: &'a str,
    },
    /// The object store does not answer and is waited for.
    StoreAway {
        /// The scenario that is being sent.
        id: &'a str,
        /// Why that is thought.
        reason: &'a str,
    },
    /// Somebody else made a scenario in the meantime.
    MadeElsewhere {
        /// Its identifier.
        id: &'a str,
        /// Expected number of ticks.
        ticks: u32,
    },
    /// An attempt failed and will be repeated.
    Retrying {
        /// Identifier of the scenario.
        id: &'a str,
        /// Why.
        reason: &'a str,
    },
    /// A scenario is set aside.
    Failed {
        /// Its identifier.
        id: &'a str,
        /// Why.
        reason: &'a str,
    },
    /// What `dtd doctor` measured of a simulator behind a plugin, or that it did not. Said once for each.
    Profile {
        /// Which.
        simulator: &'a str,
        /// That it has one that is used, or how to get one.
        known: &'a KnownProfile,
    },
    /// A simulator does not answer any more; the run waits for it.
    SimulatorLost {
        /// Which.
        simulator: &'a str,
        /// Why that is thought.
        reason: &'a str,
    },
    /// It is back.
    SimulatorBack {
        /// Which.
        simulator: &'a str,
    },
    /// It was waited for in vain; others go on, if there are any.
    SimulatorGone {
        /// Which.
        simulator: &'a str,
    },
}

/// Takes the events of a run.
pub type OnEvent<'a> = dyn FnMut(Event<'_>) + Send + 'a;

/// Lets several workers tell one listener.
pub(super) struct Reporter<'a>(Mutex<&'a mut OnEvent<'a>>);

impl<'a> Reporter<'a> {
    pub(super) fn new(on_event: &'a mut OnEvent<'a>) -> Self {
        Self(Mutex::new(on_event))
    }

    pub(super) fn tell(&self, event: Event<'_>) {
        let mut listener = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        (*listener)(event);
    }
}
