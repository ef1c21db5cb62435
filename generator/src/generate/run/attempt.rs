//! One attempt at one scenario: cancellation and timeouts.

use std::time::Duration;

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
    /// True if every image is settled, because an earlier attempt failed by its images and no other one will follow.
    pub(crate) settles: bool,
}

impl Attempt<'_, '_> {
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
