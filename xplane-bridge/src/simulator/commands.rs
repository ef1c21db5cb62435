//! Commands, which have no answer over UDP: by the Web API or the capture link, which acknowledge them, or repeated until their
//! effect shows.

use std::time::Duration;

use tokio::time::Instant;

use super::{SWITCH_TIMEOUT, Simulator, wrong};
use crate::datarefs::{
    APPROACH_SWITCHES, AUTOPILOT_MODE, AutopilotSwitch, COMMAND_PAUSE_OFF, COMMAND_PAUSE_ON,
    COMMAND_SERVOS_ON, DatarefWrite, PAUSED,
};
use crate::error::{BridgeError, reads};
use crate::link::{Answer, Request};

/// Attempts before a command counts as ineffective. One of five is lost in the worst network that we test with.
const ATTEMPTS: u32 = 8;
/// Timeout for an effect to show.
const EFFECT_TIMEOUT: Duration = Duration::from_millis(500);

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

    /// Engages the autopilot on the landing system, command by command, for a simulator that serves its link without a plugin: our plugin
    /// does the same once the aircraft is in the air. Most commands are toggle buttons. So each is sent only while its state is known to be
    /// off; a state that does not arrive is requested again, not taken for off.
    pub(super) async fn engage_approach(&mut self) -> Result<(), BridgeError> {
        for switch in APPROACH_SWITCHES {
            let command = switch.command;
            let mut found = self.state_of(&switch, false).await?;
            for _ in 0..ATTEMPTS {
                match found.0 {
                    Some(true) => break,
                    Some(false) => {
                        self.command(command).await?;
                        found = self.state_of(&switch, true).await?;
                    }
                    None => found = self.state_of(&switch, false).await?,
                }
            }
            match found {
                (Some(true), _) => {}
                // The servos are reliable; aircraft differ in how they show the modes. The flight shows whether they are on.
                (_, values) if command != COMMAND_SERVOS_ON => {
                    tracing::warn!(command, ?values, "the autopilot does not show it");
                }
                (_, values) => {
                    let effect = DatarefWrite::new(AUTOPILOT_MODE, 2.0);
                    let found = values.first().copied().flatten();
                    return Err(without_effect(command, &effect, found));
                }
            }
        }
        Ok(())
    }

    /// State of an autopilot function, if it can be read, with the values read. With `effect` it waits until the function is on; without,
    /// it takes the first values.
    async fn state_of(
        &mut self,
        switch: &AutopilotSwitch,
        effect: bool,
    ) -> Result<(Option<bool>, Vec<Option<f32>>), BridgeError> {
        let names: Vec<&str> = switch.datarefs().collect();
        let is_on = |values: &[Option<f32>]| {
            switch.is_on(|name| {
                let at = names.iter().position(|known| *known == name)?;
                values.get(at).copied().flatten()
            })
        };
        let deadline = Instant::now() + EFFECT_TIMEOUT;
        let values = self
            .udp
            .read_until(&names, deadline, |values| match is_on(values) {
                Some(false) => !effect,
                on => on.is_some(),
            })
            .await?;
        Ok((is_on(&values), values))
    }

    /// Repeats a command until a dataref shows its effect; sends none if it already does.
    async fn command_until(
        &mut self,
        command: &str,
        effect: &DatarefWrite,
    ) -> Result<(), BridgeError> {
        let shows = |value| effect.is_met_by(value);
        let read = self.udp.read_one(&effect.name, EFFECT_TIMEOUT, |_| true);
        let mut found = read.await?;
        for _ in 0..ATTEMPTS {
            if found.is_some_and(shows) {
                return Ok(());
            }
            self.command(command).await?;
            let read = self.udp.read_one(&effect.name, EFFECT_TIMEOUT, shows);
            found = read.await?;
        }
        if found.is_some_and(shows) {
            return Ok(());
        }
        Err(without_effect(command, effect, found))
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

    async fn command(&mut self, command: &str) -> Result<(), BridgeError> {
        if self.command_by_web_api(command).await {
            Ok(())
        } else {
            self.udp.command(command).await
        }
    }

    /// Returns true if the Web API did it.
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

fn without_effect(command: &str, effect: &DatarefWrite, found: Option<f32>) -> BridgeError {
    BridgeError::NotTaken {
        name: effect.name.clone(),
        wanted: effect.value,
        found,
        text: format!(
            "command {command} was sent {ATTEMPTS} times, but dataref {} {}, expected {}. Close menus and dialogs in X-Plane, and run no other \
             plugin that undoes it",
            effect.name,
            reads(found, "never answered"),
            effect.value
        ),
    }
}
