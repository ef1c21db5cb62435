//! Run events.

use std::sync::{Mutex, PoisonError};

use dataset::corpus::effective_weather::EffectiveQuantity;
use xplane_bridge::profile::KnownProfile;

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
    /// The encoder that the user chose passed its trial.
    EncoderTried {
        /// FFmpeg's encoder name.
        encoder: &'a str,
        /// Duration, seconds.
        seconds: f64,
    },
    /// An earlier run set a scenario aside; this one retries it.
    SetAsideBefore {
        /// Identifier of the scenario.
        id: &'a str,
        /// Reason for the last failure.
        reason: &'a str,
    },
    /// `splits.json` of the corpus was lost; it is regenerated from plan and seed.
    SplitLost,
    /// The disk may not have enough space.
    LittleSpace {
        /// Bytes available.
        free: u64,
        /// Bytes needed, approximately.
        needed: u64,
    },
    /// The remaining scenarios belong to other processes.
    Waiting {
        /// Number of scenarios that they are recording.
        scenarios: usize,
        /// Process that records the first one.
        holder: &'a str,
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
    /// A scenario was drawn in different weather than planned; its record says so.
    Marked {
        /// Scenario identifier.
        id: &'a str,
        /// Differences between the two.
        differences: &'a str,
    },
    /// A quantity at the aircraft differs in scenario after scenario. Reported once per simulator; the run goes on, with marked
    /// scenarios.
    NotFollowed {
        /// Name of the simulator.
        simulator: &'a str,
        /// The quantity.
        quantity: EffectiveQuantity,
    },
    /// Scenarios that an earlier run recorded, and that are not in the object store yet.
    StagedBefore {
        /// Number of scenarios.
        scenarios: usize,
    },
    /// A scenario is committed in the object store.
    Uploaded {
        /// Scenario identifier.
        id: &'a str,
        /// Duration of the upload, seconds.
        seconds: f64,
    },
    /// Recording is faster than uploading: the run waits.
    UploadBehind {
        /// The scenario that waits.
        id: &'a str,
    },
    /// The object store does not answer and is being retried.
    StoreAway {
        /// The scenario that is being uploaded.
        id: &'a str,
        /// Cause and reaction.
        reason: &'a str,
    },
    /// A scenario was finished by a different process in the meantime.
    MadeElsewhere {
        /// Scenario identifier.
        id: &'a str,
        /// Expected number of ticks.
        ticks: u32,
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
    /// Plugin simulator's profile by `dtd doctor`, or its absence. Reported once per simulator.
    Profile {
        /// Name of the simulator.
        simulator: &'a str,
        /// Profile, or the way to get one.
        known: &'a KnownProfile,
    },
    /// A simulator stopped answering; the run waits for it.
    SimulatorLost {
        /// Name of the simulator.
        simulator: &'a str,
        /// The reason.
        reason: &'a str,
    },
    /// It is back.
    SimulatorBack {
        /// Name of the simulator.
        simulator: &'a str,
    },
    /// The user's command to restart a simulator runs.
    SimulatorRestarting {
        /// Name of the simulator.
        simulator: &'a str,
        /// Live flights since its last restart.
        live_flights: u32,
    },
    /// The command failed.
    RestartFailed {
        /// Name of the simulator.
        simulator: &'a str,
        /// Kind of failure, and its last output.
        reason: &'a str,
    },
    /// It did not come back; the others continue, if there are any.
    SimulatorGone {
        /// Name of the simulator.
        simulator: &'a str,
        /// The reason.
        reason: &'a str,
    },
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
}
