//! X-Plane 12's weather, in the order in which it is taken over, and waited for.
//!
//! Written values read back at once or after a while: clouds keep their old values in all slots for up to a minute and then change all
//! together, temperatures slide for minutes after real weather. Writing them meanwhile only makes it last longer. So everything is
//! written, regenerated once (which puts clouds and temperatures back to a preset's), those are written once more, and then only read,
//! with tolerances, until it is there. Sources: `docs/x-plane.md`.

use std::time::Duration;

use tokio::time::{Instant, sleep};

use super::Simulator;
use crate::datarefs::{
    COMMAND_REGENERATE_WEATHER, DatarefWrite, METERS_PER_STATUTE_MILE, RUNNING_TIME_S,
    UPDATE_IMMEDIATELY, VISIBILITY_EFFECTIVE_M, VISIBILITY_SM, WEATHER_PRESET, WEATHER_SOURCE,
    WeatherSource, needs_repeating_after_regeneration,
};
use crate::error::BridgeError;

/// How long X-Plane has for the preset before the values come: it sets winds of its own half a second later.
const PRESET_PAUSE: Duration = Duration::from_secs(1);
/// How long X-Plane has to begin with the weather before it is told clouds and temperatures again.
const REGENERATION_PAUSE: Duration = Duration::from_secs(1);
/// How often is looked whether the weather is there.
const POLL: Duration = Duration::from_secs(1);
/// How long the weather may take, by the simulator's clock or ours, whichever is faster. Clouds were seen to take 55 s.
const PATIENCE: Duration = Duration::from_secs(70);
/// A regeneration stops X-Plane for seconds; one that says nothing for longer is gone.
const LONGEST_HITCH: Duration = Duration::from_secs(30);
/// How long what is drawn may take to follow the visibility that was set, and how closely it does.
const SHOWING: Duration = Duration::from_secs(10);
const VISIBILITY_SHOWN_WITHIN: f64 = 0.1;

/// What is not as it should be.
struct Missing {
    write: DatarefWrite,
    found: Option<f32>,
    made_by: Option<WeatherSource>,
}

/// What X-Plane 12 has to read besides what was written: that nobody else makes the weather.
pub(super) fn ours() -> DatarefWrite {
    DatarefWrite::new(WEATHER_SOURCE, 0.0)
}

impl Simulator {
    /// Sets the weather and waits until X-Plane has it. `clear`: without any cloud.
    pub(super) async fn set_weather_12(
        &mut self,
        writes: &[DatarefWrite],
        clear: bool,
    ) -> Result<(), BridgeError> {
        if clear {
            // Zeros alone may leave clouds that are there.
            self.write_surely(WEATHER_PRESET, 0.0).await?;
            self.pause_for_weather(PRESET_PAUSE).await;
        }
        self.write_weather(writes).await?;
        self.command_once(COMMAND_REGENERATE_WEATHER).await?;
        let regenerated = Instant::now();
        self.pause_for_weather(REGENERATION_PAUSE).await;
        let again: Vec<DatarefWrite> = writes
            .iter()
            .filter(|write| needs_repeating_after_regeneration(&write.name))
            .cloned()
            .collect();
        self.write_weather(&again).await?;
        self.await_weather(writes).await?;
        sleep(self.weather_settle.saturating_sub(regenerated.elapsed())).await;
        self.await_visibility(writes).await
    }

    /// Waits until the weather reads as it was written; writes it once more if it is late.
    ///
    /// # Errors
    /// [`BridgeError::WeatherNotTaken`] if that does not help either.
    pub(super) async fn await_weather(
        &mut self,
        writes: &[DatarefWrite],
    ) -> Result<(), BridgeError> {
        let Some(late) = self.poll_weather(writes).await? else {
            return Ok(());
        };
        tracing::warn!(
            dataref = late.write.name, wanted = late.write.value, found = ?late.found,
            "the weather is late, and is written once more"
        );
        self.write_weather(writes).await?;
        match self.poll_weather(writes).await? {
            None => Ok(()),
            Some(missing) => Err(BridgeError::WeatherNotTaken {
                name: missing.write.name,
                wanted: missing.write.value,
                found: missing.found,
                patience: PATIENCE,
                made_by: missing.made_by,
            }),
        }
    }

    /// Writes weather; all but the clouds is applied at once. What is lost on the way is written again in the first moments, and
    /// whatever then takes its time is left in peace.
    async fn write_weather(&mut self, writes: &[DatarefWrite]) -> Result<(), BridgeError> {
        const ROUNDS: u32 = 5;
        self.write_surely(UPDATE_IMMEDIATELY, 1.0).await?;
        self.write_in_rounds(writes, ROUNDS).await?;
        // X-Plane takes it back once it has applied everything, so that it is not read back.
        self.write_surely(UPDATE_IMMEDIATELY, 1.0).await
    }

    /// Reads until everything is as it should be; what is not when patience ends.
    async fn poll_weather(
        &mut self,
        writes: &[DatarefWrite],
    ) -> Result<Option<Missing>, BridgeError> {
        let mut expected: Vec<DatarefWrite> = writes
            .iter()
            .filter(|write| write.is_read_back())
            .cloned()
            .collect();
        expected.push(ours());
        let mut watched = expected.clone();
        watched.push(DatarefWrite::new(RUNNING_TIME_S, 0.0));
        let began = Instant::now();
        let (mut heard, mut running_from_s) = (began, None);
        loop {
            let found = self.read(&watched).await?;
            self.check_vigil()?;
            let missing = expected
                .iter()
                .zip(&found)
                .find(|(write, found)| !found.is_some_and(|value| write.is_met_by(value)));
            let Some((write, &value)) = missing else {
                return Ok(None);
            };
            if found.iter().any(Option::is_some) {
                heard = Instant::now();
            } else if heard.elapsed() > LONGEST_HITCH {
                return Err(BridgeError::NobodyAnswers {
                    address: self.address,
                    waited: heard.elapsed(),
                });
            }
            let running_s = found.last().copied().flatten();
            running_from_s = running_from_s.or(running_s);
            let passed_s = running_s
                .zip(running_from_s)
                .map_or(0.0, |(now_s, from_s)| now_s - from_s);
            if began.elapsed().as_secs_f32().max(passed_s) >= PATIENCE.as_secs_f32() {
                let source = found.get(expected.len() - 1).copied().flatten();
                return Ok(Some(Missing {
                    write: write.clone(),
                    found: value,
                    made_by: source.and_then(WeatherSource::of_value),
                }));
            }
            sleep(POLL).await;
        }
    }

    /// Waits until what is drawn follows the visibility that was set. X-Plane has more to say about it (rain, haze, what the aircraft is in),
    /// so that one that stays elsewhere is noted and no error.
    async fn await_visibility(&mut self, writes: &[DatarefWrite]) -> Result<(), BridgeError> {
        let Some(asked) = writes.iter().find(|write| write.name == VISIBILITY_SM) else {
            return Ok(());
        };
        let asked_m = f64::from(asked.value) * METERS_PER_STATUTE_MILE;
        let shows = |found_m: f64| (found_m / asked_m - 1.0).abs() <= VISIBILITY_SHOWN_WITHIN;
        let began = Instant::now();
        loop {
            let wanted = [DatarefWrite::new(VISIBILITY_EFFECTIVE_M, asked_m)];
            // X-Plane reads 0 for a name that it does not have.
            let found_m = self.read(&wanted).await?[0].map_or(0.0, f64::from);
            if found_m == 0.0 || shows(found_m) {
                return Ok(());
            }
            if began.elapsed() >= SHOWING {
                tracing::warn!(asked_m, found_m, "another visibility is drawn than was set");
                return Ok(());
            }
            sleep(POLL).await;
        }
    }

    /// A pause that a simulator does not need whose weather shows at once.
    async fn pause_for_weather(&self, pause: Duration) {
        sleep(pause.min(self.weather_settle)).await;
    }
}
