//! Cancellation that reaches whatever is being awaited.

use tokio::sync::watch;

use super::error::ScenarioError;

/// A switch that can be set once, from any thread, e.g. by Ctrl-C.
#[derive(Debug, Clone)]
pub struct Cancel(watch::Sender<bool>);

impl Default for Cancel {
    fn default() -> Self {
        Self(watch::channel(false).0)
    }
}

impl Cancel {
    /// A switch that is not set yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Turns it.
    pub fn cancel(&self) {
        self.0.send_replace(true);
    }

    /// Whether it is set.
    pub fn is_cancelled(&self) -> bool {
        *self.0.borrow()
    }

    /// Waits until it is set.
    pub async fn turned(&self) {
        // Fails only if the sender is gone, which is `self`.
        let _ = self.0.subscribe().wait_for(|turned| *turned).await;
    }

    /// Waits for `work`, but no longer than until the switch is set.
    pub(super) async fn or<T, E: Into<ScenarioError>>(
        &self,
        work: impl Future<Output = Result<T, E>>,
    ) -> Result<T, ScenarioError> {
        let mut turned = self.0.subscribe();
        tokio::select! {
            biased;
            _ = turned.wait_for(|turned| *turned) => Err(ScenarioError::Cancelled),
            done = work => done.map_err(Into::into),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn whoever_waits_is_woken_and_whoever_comes_later_too() {
        let cancel = Cancel::new();
        let ready = cancel.or(async { Ok::<_, ScenarioError>(7) }).await;
        assert_eq!(ready.unwrap(), 7);
        let waiting = {
            let cancel = cancel.clone();
            tokio::spawn(async move {
                cancel
                    .or(std::future::pending::<Result<(), ScenarioError>>())
                    .await
            })
        };
        cancel.cancel();
        assert!(matches!(
            waiting.await.unwrap(),
            Err(ScenarioError::Cancelled)
        ));
        let late = cancel.or(async { Ok::<_, ScenarioError>(7) }).await;
        assert!(matches!(late, Err(ScenarioError::Cancelled)));
    }
}
