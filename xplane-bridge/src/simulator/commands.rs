//! Commands, which have no answer over UDP: repeated until their effect shows, or by the capture link, which acknowledges them.

use std::time::Duration;

use super::{SWITCH_TIMEOUT, Simulator, wrong};
use crate::datarefs::{COMMAND_PAUSE_OFF, DatarefWrite, PAUSED};
use crate::error::{BridgeError, reads};
use crate::link::{Answer, Request};

/// Attempts before a command counts as ineffective. One of five is lost in the worst network that we test with.
const ATTEMPTS: u32 = 8;
/// Timeout for an effect to show.
const EFFECT_TIMEOUT: Duration = Duration::from_millis(500);

impl Simulator {
    /// Lets the simulator's time run.
    ///
    /// # Errors
    /// [`BridgeError::NotTaken`] if it does not run.
    pub async fn resume(&mut self) -> Result<(), BridgeError> {
        let effect = DatarefWrite::new(PAUSED, 0.0);
        let runs = |value| effect.is_met_by(value);
        let mut found = self.udp.read_one(PAUSED, EFFECT_TIMEOUT, |_| true).await?;
        for _ in 0..ATTEMPTS {
            if found.is_some_and(runs) {
                return Ok(());
            }
            self.udp.command(COMMAND_PAUSE_OFF).await?;
            found = self.udp.read_one(PAUSED, EFFECT_TIMEOUT, runs).await?;
        }
        if found.is_some_and(runs) {
            return Ok(());
        }
        Err(BridgeError::NotTaken {
            text: format!(
                "command {COMMAND_PAUSE_OFF} was sent {ATTEMPTS} times, but dataref {PAUSED} {}, expected 0. Close menus and dialogs in \
                 X-Plane, and run no other plugin that undoes it",
                reads(found, "never answered")
            ),
            name: effect.name,
            wanted: effect.value,
            found,
        })
    }

    /// Runs a command whose effect no dataref shows, exactly once: by the capture link, which acknowledges it.
    pub(super) async fn command_once(&mut self, command: &str) -> Result<(), BridgeError> {
        let request = Request::Command {
            path: command.to_owned(),
        };
        match self.link.ask("a command", &request, SWITCH_TIMEOUT).await {
            Ok(Answer::Commanded) => Ok(()),
            Ok(other) => Err(wrong("commanded", &other)),
            // A plugin that is older than this request.
            Err(BridgeError::Refused { text, .. }) => {
                tracing::warn!(command, text, "sent over UDP instead");
                self.udp.command(command).await
            }
            Err(error) => Err(error),
        }
    }
}
