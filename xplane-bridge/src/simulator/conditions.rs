//! Setting weather and time, and making sure that they are set.

mod effective_weather;
mod weather;

use std::time::Duration;

use dataset::conditions::Conditions;
use futures_util::future::{BoxFuture, LocalBoxFuture};
use tokio::time::sleep;

use super::Simulator;
use super::settings_watch::{SettingsWatch, setting_lost};
use crate::datarefs::{
    DATE_DAYS, DatarefWrite, Generation, OVERRIDE_FLIGHT_MODEL, USE_SYSTEM_TIME, ZULU_TIME_S,
    clock_writes, condition_writes, running_clock_writes, weather_writes,
};
use crate::error::{BridgeError, reads};

/// Maximum writes per dataref. A scenario has some 110: if one datagram in five is lost, fewer attempts would make one scenario in thirty
/// fail.
const ATTEMPTS: u32 = 12;
const READ_TIMEOUT: Duration = Duration::from_secs(3);
/// Time for X-Plane to draw a frame between writing and the next attempt.
const RETRY_PAUSE: Duration = Duration::from_millis(100);

impl Simulator {
    /// Sets every parameter of weather and time, reads them back and compares. From then on they are watched: if one changes, or the
    /// simulator restarts, the next frame or flight is an error.
    ///
    /// # Errors
    /// [`BridgeError::BadConditions`] before anything is sent; [`BridgeError::NotTaken`] names the dataref, the value
    /// wanted and the value found, after many attempts; [`BridgeError::OtherWeatherShows`] names the quantity at the aircraft that does
    /// not follow, although it was measured to.
    pub fn set_conditions<'a>(
        &'a mut self,
        conditions: &'a Conditions,
    ) -> LocalBoxFuture<'a, Result<(), BridgeError>> {
        Box::pin(async move {
            let writes = self.in_its_units(condition_writes(conditions, self.generation)?);
            let expected = self.expected_of(&writes);
            match &mut self.settings_watch {
                // Watched already; any value is allowed until they are set again.
                Some(settings_watch) => settings_watch.expect([]),
                None => {
                    self.settings_watch = Some(SettingsWatch::begin(&self.udp, &expected));
                }
            }
            // Weather changes only while time runs; an aircraft that may be in the air is held meanwhile.
            self.hold_aircraft().await?;
            self.resume().await?;
            let (clock, weather): (Vec<_>, Vec<_>) =
                writes.into_iter().partition(|write| is_time(&write.name));
            self.write_until_read_back(&clock).await?;
            self.effective_weather = None;
            match self.generation {
                Generation::XPlane11 => {
                    self.write_until_read_back(&weather).await?;
                    sleep(self.weather_settle).await;
                }
                Generation::XPlane12 => {
                    let shown = self.set_weather_12(&weather, &conditions.weather).await?;
                    self.effective_weather = Some(shown);
                }
            }
            self.conditions = Some(conditions.clone());
            self.expect(expected.into_iter().filter(|write| !is_clock(&write.name)));
            Ok(())
        })
    }

    /// Weather in the units that this simulator was measured to use.
    fn in_its_units(&self, writes: Vec<DatarefWrite>) -> Vec<DatarefWrite> {
        let profile = self.profile.current();
        match profile.and_then(|profile| profile.wind_unit.found()) {
            Some(unit) => unit.applied_to(writes),
            None => writes,
        }
    }

    /// Values that must read back and stay, once conditions are set.
    fn expected_of(&self, writes: &[DatarefWrite]) -> Vec<DatarefWrite> {
        let read_back = writes.iter().filter(|write| write.is_read_back()).cloned();
        let ours = (self.generation == Generation::XPlane12).then(weather::ours);
        read_back.chain(ours).collect()
    }

    /// Stops only the flight model: time continues, the aircraft does not move.
    pub(super) async fn hold_aircraft(&mut self) -> Result<(), BridgeError> {
        self.write_until_read_back(&[DatarefWrite::new(OVERRIDE_FLIGHT_MODEL, 1.0)])
            .await
    }

    /// Waits until the scenario's weather, if any, has replaced the weather with which the new flight started.
    pub(super) async fn await_weather_of(
        &mut self,
        conditions: Option<&Conditions>,
    ) -> Result<(), BridgeError> {
        let Some(conditions) = conditions else {
            return Ok(());
        };
        let weather = self.in_its_units(weather_writes(&conditions.weather, self.generation)?);
        match self.generation {
            Generation::XPlane11 => self.write_until_read_back(&weather).await?,
            Generation::XPlane12 => self.await_weather(&weather).await?,
        }
        let clock = running_clock_writes(&conditions.clock);
        self.write_until_read_back(&clock).await
    }

    /// Lets the flight model continue.
    pub(super) async fn let_aircraft_go(&mut self) -> Result<(), BridgeError> {
        self.write_until_read_back(&[DatarefWrite::new(OVERRIDE_FLIGHT_MODEL, 0.0)])
            .await
    }

    /// Reads all settings and the weather at the aircraft once more, and compares: success proves that all recordings since then were made
    /// under these conditions.
    ///
    /// # Errors
    /// [`BridgeError::Failed`] if a setting was lost or the simulator restarted, or [`BridgeError::OtherWeatherShows`] as in
    /// [`Simulator::set_conditions`].
    pub fn confirm_conditions(&mut self) -> BoxFuture<'_, Result<(), BridgeError>> {
        Box::pin(async move {
            self.check_settings()?;
            let Some(settings_watch) = &self.settings_watch else {
                return Ok(());
            };
            let expected = settings_watch.expected();
            let found = self.read(&expected).await?;
            let lost = expected
                .into_iter()
                .zip(found)
                .find(|(write, found)| !found.is_some_and(|value| write.is_met_by(value)));
            match lost {
                None => {
                    self.check_settings()?;
                    self.confirm_effective_weather().await
                }
                Some((write, found)) => Err(setting_lost(&write, found)),
            }
        })
    }

    /// Sets the clock once more, now that it stands still; from now on it is watched as well.
    pub(super) async fn set_clock_exactly(&mut self) -> Result<(), BridgeError> {
        let Some(conditions) = &self.conditions else {
            return Ok(());
        };
        // The plugin sets back a running clock in every frame.
        let clock = match self.running_at() {
            None => clock_writes(&conditions.clock),
            Some(clock) => running_clock_writes(&clock),
        };
        self.write_until_read_back(&clock).await?;
        let weather = self
            .settings_watch
            .as_ref()
            .map(SettingsWatch::expected)
            .unwrap_or_default();
        let weather = weather.into_iter().filter(|write| !is_clock(&write.name));
        self.expect(weather.chain(clock).collect::<Vec<_>>());
        Ok(())
    }

    /// An error if a watched value differs from its setting.
    pub(super) fn check_settings(&mut self) -> Result<(), BridgeError> {
        self.settings_watch
            .as_mut()
            .map_or(Ok(()), SettingsWatch::check)
    }

    fn expect(&mut self, writes: impl IntoIterator<Item = DatarefWrite>) {
        if let Some(settings_watch) = &mut self.settings_watch {
            settings_watch.expect(writes);
        }
    }

    /// Writes a dataref that cannot be read back: often enough that one datagram arrives.
    pub(super) async fn write_surely(&mut self, name: &str, value: f32) -> Result<(), BridgeError> {
        const TIMES: usize = 5;
        self.udp
            .write(std::iter::repeat_n((name, value), TIMES))
            .await
    }

    /// Writes datarefs that are not yet as required, until all are.
    pub(super) async fn write_until_read_back(
        &mut self,
        writes: &[DatarefWrite],
    ) -> Result<(), BridgeError> {
        match self.write_in_rounds(writes, ATTEMPTS).await? {
            None => Ok(()),
            Some((write, found)) => Err(BridgeError::NotTaken {
                text: format!(
                    "dataref {} was written {ATTEMPTS} times as {}, but {}. Does another plugin or a real-weather setting hold it?",
                    write.name,
                    write.value,
                    reads(found, "never answered")
                ),
                name: write.name,
                wanted: write.value,
                found,
            }),
        }
    }

    /// Writes at most this many times; returns the first dataref that still differs.
    pub(super) async fn write_in_rounds(
        &mut self,
        writes: &[DatarefWrite],
        rounds: u32,
    ) -> Result<Option<(DatarefWrite, Option<f32>)>, BridgeError> {
        let mut wrong: Vec<(DatarefWrite, Option<f32>)> =
            writes.iter().map(|write| (write.clone(), None)).collect();
        for round in 0..rounds {
            if round > 0 {
                tracing::debug!(count = wrong.len(), round, "datarefs written again");
                sleep(RETRY_PAUSE).await;
            }
            let mut due: Vec<DatarefWrite> = wrong.drain(..).map(|(write, _)| write).collect();
            self.write(&due).await?;
            due.retain(DatarefWrite::is_read_back);
            let found = self.read(&due).await?;
            let pairs = due.into_iter().zip(found);
            wrong = pairs
                .filter(|(write, found)| !found.is_some_and(|value| write.is_met_by(value)))
                .collect();
            if wrong.is_empty() {
                break;
            }
        }
        Ok(wrong.into_iter().next())
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

    pub(super) async fn read(
        &mut self,
        writes: &[DatarefWrite],
    ) -> Result<Vec<Option<f32>>, BridgeError> {
        let names: Vec<&str> = writes.iter().map(|write| write.name.as_str()).collect();
        let found = self.udp.read_all(&names, READ_TIMEOUT).await?;
        let is_silent = !found.is_empty() && found.iter().all(Option::is_none);
        if is_silent && self.link.has_ended() {
            // It has ended: the same would not be answered later either.
            return Err(self.silent(READ_TIMEOUT));
        }
        Ok(found)
    }
}

/// True if a dataref belongs to time, not weather.
fn is_time(name: &str) -> bool {
    is_clock(name) || name == USE_SYSTEM_TIME
}

/// True if a dataref belongs to the clock, which runs until the simulator is frozen.
fn is_clock(name: &str) -> bool {
    name == ZULU_TIME_S || name == DATE_DAYS
}
