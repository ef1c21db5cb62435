//! One attempt at one scenario: cancellation and timeouts.

use std::time::Duration;

use dataset::geometry::pose::FlightState;
use tokio::time::timeout;
use xplane_bridge::BridgeError;

use crate::generate::error::ScenarioError;
use crate::generate::event::Reporter;
use crate::generate::options::Cancel;

/// State shared by an attempt's steps.
pub(crate) struct Attempt<'a, 'r> {
    pub(crate) id: &'a str,
    pub(crate) cancel: &'a Cancel,
    pub(crate) reporter: &'a Reporter<'r>,
    /// Answer timeout while images are taken.
    pub(crate) answer_limit: Duration,
    /// Maximum number of ticks, for a trial.
    pub(crate) most_ticks: Option<u32>,
}

impl Attempt<'_, '_> {
    /// States to record: all, or for a trial some that lie evenly between the first and the last. The times of images count ticks, so that
    /// clouds move from one to the next as in a whole scenario.
    pub(crate) fn part_of(&self, states: Vec<FlightState>) -> Vec<FlightState> {
        match self.most_ticks.map(|most| most as usize) {
            Some(most) if most < states.len() => {
                let at = |tick: usize| states[tick * states.len() / most];
                (0..most).map(at).collect()
            }
            _ => states,
        }
    }

    /// Waits for an answer of the simulator, until the timeout or until the run is cancelled.
    pub(crate) async fn answered<T>(
        &self,
        answer: impl Future<Output = Result<T, BridgeError>>,
    ) -> Result<T, ScenarioError> {
        let limited = async {
            match timeout(self.answer_limit, answer).await {
                Ok(answered) => Ok(answered?),
                Err(_) => Err(ScenarioError::Frozen {
                    waited: self.answer_limit,
                }),
            }
        };
        self.unless_cancelled(limited).await
    }

    /// Waits for `work`, but no longer than until the run is cancelled.
    pub(crate) async fn unless_cancelled<T, E: Into<ScenarioError>>(
        &self,
        work: impl Future<Output = Result<T, E>>,
    ) -> Result<T, ScenarioError> {
        unless_cancelled(self.cancel, work).await
    }
}

/// Waits for `work` outside an attempt, but no longer than until the run is cancelled.
pub(crate) async fn unless_cancelled<T, E: Into<ScenarioError>>(
    cancel: &Cancel,
    work: impl Future<Output = Result<T, E>>,
) -> Result<T, ScenarioError> {
    match cancel.run_until_cancelled(work).await {
        Some(done) => done.map_err(Into::into),
        None => Err(ScenarioError::Cancelled),
    }
}
