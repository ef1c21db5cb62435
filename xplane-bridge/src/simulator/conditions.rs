//! Setting weather and time, and making sure that they are set.

use std::time::Duration;

use dataset::conditions::Conditions;
use tokio::time::{Instant, sleep};

use super::Simulator;
use crate::datarefs::{
    COMMAND_REGENERATE_WEATHER, DatarefWrite, Generation, UPDATE_IMMEDIATELY, condition_writes,
    needs_repeating_after_regeneration,
};
use crate::error::BridgeError;

/// Writings of a dataref before we believe that it does not take the value.
const ATTEMPTS: u32 = 5;
/// How long one reading back may take.
const READ_TIMEOUT: Duration = Duration::from_secs(3);
/// How long X-Plane has for a frame between writing and the next attempt.
const RETRY_PAUSE: Duration = Duration::from_millis(100);

impl Simulator {
    /// Sets every parameter of weather and time, reads all of them back and compares.
    ///
    /// # Errors
    /// [`BridgeError::BadConditions`] before anything is sent; [`BridgeError::NotTaken`] names the dataref, the value
    /// wanted and the value found, after five attempts.
    pub async fn set_conditions(&mut self, conditions: &Conditions) -> Result<(), BridgeError> {
        let writes = condition_writes(conditions, self.generation)?;
        self.write(&writes).await?;
        if self.generation == Generation::XPlane12 {
            self.regenerate_weather(&writes).await?;
        }
        self.write_until_read_back(&writes).await?;
        self.clock = Some(conditions.clock);
        Ok(())
    }

    /// X-Plane 12 applies all but the clouds at once; those want the command, then to be told again, then time.
    async fn regenerate_weather(&mut self, writes: &[DatarefWrite]) -> Result<(), BridgeError> {
        self.udp.write([(UPDATE_IMMEDIATELY, 1.0)]).await?;
        self.udp.command(COMMAND_REGENERATE_WEATHER).await?;
        let again = writes
            .iter()
            .filter(|write| needs_repeating_after_regeneration(&write.name));
        self.udp
            .write(again.map(|write| (write.name.as_str(), write.value)))
            .await?;
        sleep(self.weather_settle).await;
        Ok(())
    }

    /// Writes datarefs that are not yet as they should be, until all are.
    pub(super) async fn write_until_read_back(
        &mut self,
        writes: &[DatarefWrite],
    ) -> Result<(), BridgeError> {
        let mut wrong: Vec<(DatarefWrite, Option<f32>)> =
            writes.iter().map(|write| (write.clone(), None)).collect();
        for attempt in 0..ATTEMPTS {
            if attempt > 0 {
                tracing::debug!(count = wrong.len(), attempt, "datarefs written again");
                sleep(RETRY_PAUSE).await;
            }
            let due: Vec<DatarefWrite> = wrong.drain(..).map(|(write, _)| write).collect();
            self.write(&due).await?;
            let found = self.read(&due).await?;
            let pairs = due.into_iter().zip(found);
            wrong = pairs
                .filter(|(write, found)| !found.is_some_and(|value| write.is_met_by(value)))
                .collect();
            if wrong.is_empty() {
                return Ok(());
            }
        }
        match wrong.into_iter().next() {
            None => Ok(()),
            Some((write, found)) => Err(BridgeError::NotTaken {
                name: write.name,
                attempts: ATTEMPTS,
                wanted: write.value,
                found,
            }),
        }
    }

    async fn write(&mut self, writes: &[DatarefWrite]) -> Result<(), BridgeError> {
        self.udp
            .write(
                writes
                    .iter()
                    .map(|write| (write.name.as_str(), write.value)),
            )
            .await
    }

    async fn read(&mut self, writes: &[DatarefWrite]) -> Result<Vec<Option<f32>>, BridgeError> {
        let names: Vec<&str> = writes.iter().map(|write| write.name.as_str()).collect();
        let all = |values: &[Option<f32>]| values.iter().all(Option::is_some);
        self.udp
            .read_until(&names, Instant::now() + READ_TIMEOUT, all)
            .await
    }
}
