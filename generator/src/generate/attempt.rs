//! One attempt at one scenario: who waits for it, and for how long.

use std::time::Duration;

use tokio::time::timeout;
use xplane_bridge::BridgeError;

use super::cancel::Cancel;
use super::error::ScenarioError;
use super::event::Reporter;

/// What the steps of an attempt share.
pub(super) struct Attempt<'a, 'r> {
    pub(super) id: &'a str,
    pub(super) cancel: &'a Cancel,
    pub(super) reporter: &'a Reporter<'r>,
    /// Longest wait for an answer while pictures are taken.
    pub(super) answer_limit: Duration,
}

impl Attempt<'_, '_> {
    /// Waits for an answer of the simulator, but neither longer than it may take nor after the run was stopped.
    pub(super) async fn answered<T>(
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
        self.cancel.or(limited).await
    }
}
