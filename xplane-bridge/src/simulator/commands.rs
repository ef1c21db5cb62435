//! Commands, which have no answer over UDP: by the Web API where there is one, and else repeated until their effect shows.

use std::time::Duration;

use tokio::time::{Instant, sleep};

use super::Simulator;
use crate::datarefs::{
    COMMAND_PAUSE_OFF, COMMAND_PAUSE_ON, COMMANDS_APPROACH, DatarefWrite, PAUSED,
};
use crate::error::BridgeError;

/// Commands sent before we believe that they have no effect. One of five is lost in the worst network that we test with.
const ATTEMPTS: u32 = 8;
/// How long an effect may take to show.
const EFFECT_TIMEOUT: Duration = Duration::from_millis(500);
/// Time between commands that are sent several times because no dataref shows their effect.
const REPEAT_PAUSE: Duration = Duration::from_millis(20);

impl Simulator {
    /// Stops the simulator's time.
    ///
    /// # Errors
    /// [`BridgeError::NotTaken`] if it does not stop.
    pub async fn pause(&mut self) -> Result<(), BridgeError> {
        self.command_until(COMMAND_PAUSE_ON, &DatarefWrite::new(PAUSED, 1.0))
            .await
    }

    /// Lets the simulator's time run.
    ///
    /// # Errors
    /// [`BridgeError::NotTaken`] if it does not run.
    pub async fn resume(&mut self) -> Result<(), BridgeError> {
        self.command_until(COMMAND_PAUSE_OFF, &DatarefWrite::new(PAUSED, 0.0))
            .await
    }

    /// Engages the autopilot on the landing system, command by command. The last ones are switches: sent while already on,
    /// they would go off again, so that each is only repeated while its own state is off.
    pub(super) async fn engage_approach(&mut self) -> Result<(), BridgeError> {
        for (at, (command, state)) in COMMANDS_APPROACH.into_iter().enumerate() {
            let mut found = None;
            for _ in 0..ATTEMPTS {
                self.command(command).await?;
                let deadline = Instant::now() + EFFECT_TIMEOUT;
                let is_on = |value: Option<f32>| value.is_some_and(|value| value != 0.0);
                found = self
                    .udp
                    .read_until(&[state], deadline, |values| is_on(values[0]))
                    .await?[0];
                if is_on(found) {
                    break;
                }
            }
            match found {
                Some(value) if value != 0.0 => {}
                // The servos are certain; what an aircraft shows of the modes differs. The flight shows whether they are on.
                _ if at > 0 => {
                    tracing::warn!(command, state, ?found, "the autopilot does not show it");
                }
                _ => {
                    return Err(BridgeError::NotTaken {
                        name: state.to_owned(),
                        attempts: ATTEMPTS,
                        wanted: 2.0,
                        found,
                    });
                }
            }
        }
        Ok(())
    }

    /// Does a command until a dataref shows its effect.
    async fn command_until(
        &mut self,
        command: &str,
        effect: &DatarefWrite,
    ) -> Result<(), BridgeError> {
        let mut found = None;
        for _ in 0..ATTEMPTS {
            self.command(command).await?;
            let deadline = Instant::now() + EFFECT_TIMEOUT;
            let shows = |value: Option<f32>| value.is_some_and(|value| effect.is_met_by(value));
            found = self
                .udp
                .read_until(&[&effect.name], deadline, |values| shows(values[0]))
                .await?[0];
            if shows(found) {
                return Ok(());
            }
        }
        Err(BridgeError::NotTaken {
            name: effect.name.clone(),
            attempts: ATTEMPTS,
            wanted: effect.value,
            found,
        })
    }

    /// Does a command whose effect no dataref shows and that may be done several times. Once by the Web API, which answers;
    /// over UDP five times, since a lost one would go unnoticed.
    pub(super) async fn command_surely(&mut self, command: &str) -> Result<(), BridgeError> {
        const TIMES: u32 = 5;
        if self.command_by_web_api(command).await {
            return Ok(());
        }
        for _ in 0..TIMES {
            self.udp.command(command).await?;
            sleep(REPEAT_PAUSE).await;
        }
        Ok(())
    }

    async fn command(&mut self, command: &str) -> Result<(), BridgeError> {
        match self.command_by_web_api(command).await {
            true => Ok(()),
            false => self.udp.command(command).await,
        }
    }

    /// Says whether the Web API did it.
    async fn command_by_web_api(&self, command: &str) -> bool {
        let Some(api) = self.web_api.as_ref().filter(|api| api.has_commands()) else {
            return false;
        };
        match api.command(command).await {
            Ok(()) => true,
            Err(error) => {
                tracing::warn!(command, %error, "sent over UDP instead");
                false
            }
        }
    }
}
