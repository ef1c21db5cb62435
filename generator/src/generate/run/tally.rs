//! Preliminary results, and the switch that ends the run: shared by all workers.

use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use dataset::plan::{Plan, PlannedScenario};

use crate::generate::error::GenerateError;
use crate::generate::options::Cancel;
use crate::generate::outcome::{FailedScenario, MarkedScenario, Outcome, Stopped};

pub(crate) struct Tally {
    /// Set when the run must end, for whatever reason.
    pub(crate) halt: Cancel,
    counts: Mutex<Counts>,
}

#[derive(Default)]
struct Counts {
    outcome: Outcome,
    fatal: Option<GenerateError>,
    /// Reason why the last simulator was given up.
    last_simulator_failure: Option<Stopped>,
    told_of_waiting: bool,
}

impl Tally {
    /// Continues from the outcome known before the run.
    pub(crate) fn new(outcome: Outcome) -> Self {
        Self {
            halt: Cancel::new(),
            counts: Mutex::new(Counts {
                outcome,
                ..Counts::default()
            }),
        }
    }

    pub(crate) fn committed(&self, scenario: &PlannedScenario) {
        self.lock().outcome.committed.push(scenario.id.clone());
    }

    pub(crate) fn marked(&self, id: &str, differences: Vec<String>) {
        let id = id.to_owned();
        let mut counts = self.lock();
        counts
            .outcome
            .marked
            .push(MarkedScenario { id, differences });
    }

    pub(crate) fn skipped(&self, scenario: &PlannedScenario) {
        self.lock().outcome.skipped.push(scenario.id.clone());
    }

    pub(crate) fn stays_staged(&self, scenario: &PlannedScenario) {
        self.lock().outcome.staged.push(scenario.id.clone());
    }

    pub(crate) fn failed(&self, scenario: &PlannedScenario, reason: String) {
        let id = scenario.id.clone();
        self.lock()
            .outcome
            .failed
            .push(FailedScenario { id, reason });
    }

    pub(crate) fn gave_up_simulator(&self, reason: Stopped) {
        self.lock().last_simulator_failure = Some(reason);
    }

    /// True on the first call, when waiting for other runs has not been reported yet.
    pub(crate) fn is_first_to_wait(&self) -> bool {
        !std::mem::replace(&mut self.lock().told_of_waiting, true)
    }

    /// Ends the run early. The first reason counts.
    pub(crate) fn stop(&self, reason: Stopped) {
        self.lock().outcome.stopped.get_or_insert(reason);
        self.halt.cancel();
    }

    /// Ends the run with an error. The first one counts.
    pub(crate) fn fail(&self, error: GenerateError) {
        self.lock().fatal.get_or_insert(error);
        self.halt.cancel();
    }

    /// The outcome of the run, in the order of the plan.
    pub(crate) fn into_outcome<'a>(
        self,
        plan: &Plan,
        not_made: impl Iterator<Item = &'a PlannedScenario>,
    ) -> Result<Outcome, GenerateError> {
        let Counts {
            mut outcome,
            fatal,
            last_simulator_failure,
            ..
        } = self
            .counts
            .into_inner()
            .unwrap_or_else(PoisonError::into_inner);
        if let Some(error) = fatal {
            return Err(error);
        }
        outcome.not_made = not_made.map(|scenario| scenario.id.clone()).collect();
        let ids = plan.scenarios.iter().map(|s| s.id.as_str());
        let places: HashMap<&str, usize> = ids.zip(0..).collect();
        let place = |id: &str| places.get(id).copied();
        outcome.committed.sort_by_key(|id| place(id));
        outcome.skipped.sort_by_key(|id| place(id));
        outcome.not_made.sort_by_key(|id| place(id));
        outcome.staged.sort_by_key(|id| place(id));
        outcome.marked.sort_by_key(|scenario| place(&scenario.id));
        outcome.failed.sort_by_key(|scenario| place(&scenario.id));
        if outcome.stopped.is_none() && !outcome.not_made.is_empty() {
            outcome.stopped = last_simulator_failure;
        }
        Ok(outcome)
    }

    fn lock(&self) -> MutexGuard<'_, Counts> {
        self.counts.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
