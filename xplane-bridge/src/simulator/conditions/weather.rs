//! Sets X-Plane 12's weather in the order that it handles best, and waits for it.
//!
//! Written values read back at once or after a while: clouds keep their old values in all slots for up to a minute and then change
//! all together, temperatures drift for minutes after real weather. Writing them in the meantime only prolongs it. So everything is
//! written, regenerated once (which resets clouds and temperatures to a preset's), those are written once more, and then only read,
//! with tolerances, until it is there. Values that read right may not show yet: so the weather at the aircraft is read as well
//! ([`super::effective_weather`]), and if its clouds still differ it is regenerated once more. Sources: `docs/x-plane-evidence.md`.

use std::collections::BTreeSet;
use std::time::Duration;

use dataset::conditions::Weather;
use dataset::corpus::effective_weather::EffectiveWeather;
use tokio::time::{Instant, sleep};

use crate::datarefs::{
    COMMAND_REGENERATE_WEATHER, DatarefWrite, RUNNING_TIME_S, TEMPERATURE_C, UPDATE_IMMEDIATELY,
    WEATHER_PRESET, WEATHER_SOURCE, WeatherSource, needs_repeating_after_regeneration,
};
use crate::error::{BridgeError, reads};
use crate::simulator::Simulator;

/// Time for the preset before the values are written: it sets its own winds half a second later.
const PRESET_PAUSE: Duration = Duration::from_secs(1);
/// Time for X-Plane to begin with the weather before clouds and temperatures are written again.
const REGENERATION_PAUSE: Duration = Duration::from_secs(1);
/// Interval for checking whether the weather is there.
const POLL: Duration = Duration::from_secs(1);
/// Poll interval for a tape, and the number of unchanged readings after which no new ones are expected.
const REPLAYED_POLL: Duration = Duration::from_millis(50);
pub(crate) const REPLAYED_POLLS: u32 = 10;
/// Timeout of the weather, by the simulator's clock or ours, whichever is faster. Clouds were seen to take 55 s.
const PATIENCE: Duration = Duration::from_secs(70);
/// A regeneration stops X-Plane for seconds; after a longer silence it is considered gone.
const MAX_HITCH: Duration = Duration::from_secs(30);
/// Timeout while only the temperature is missing: after the start, and after real weather, it drifts for minutes.
const PATIENCE_WITH_TEMPERATURE: Duration = Duration::from_secs(300);
/// Timeout while each written value is there for a moment: an attempt that gave up would only start its flight again, and wait for the same
/// temperature. A temperature that something else holds does not even take the value.
const PATIENCE_WHILE_IT_SLIDES: Duration = Duration::from_secs(900);
/// Time for which a temperature must be right after it was written: a drifting one is within its tolerance for the first second or two.
const TEMPERATURE_HOLDS: Duration = Duration::from_secs(5);

/// A value that is not as required.
struct Missing {
    write: DatarefWrite,
    found: Option<f32>,
    made_by: Option<WeatherSource>,
    patience: Duration,
}

/// The value that X-Plane 12 must read besides the settings: no other source makes the weather.
pub(crate) fn ours() -> DatarefWrite {
    DatarefWrite::new(WEATHER_SOURCE, 0.0)
}

impl Simulator {
    /// Sets the weather and waits until X-Plane has it; returns the weather reported at the aircraft then. `writes` belong to `planned`.
    ///
    /// # Errors
    /// Also [`BridgeError::OtherWeatherShows`].
    pub(crate) async fn set_weather_12(
        &mut self,
        writes: &[DatarefWrite],
        planned: &Weather,
    ) -> Result<EffectiveWeather, BridgeError> {
        if planned.clouds.iter().all(|cloud| cloud.cover_ratio <= 0.0) {
            // Zeros alone may leave existing clouds.
            self.write_surely(WEATHER_PRESET, 0.0).await?;
            self.pause_for_weather(PRESET_PAUSE).await;
        }
        self.write_weather(writes).await?;
        self.regenerate(writes).await?;
        let mut shown = self
            .await_effective_weather(planned, &BTreeSet::new())
            .await?;
        if self.is_sky_wrong(&shown) {
            tracing::info!("the sky is another than was set: the weather is regenerated once more");
            self.regenerate(writes).await?;
            shown = self
                .await_effective_weather(planned, &BTreeSet::new())
                .await?;
        }
        self.refuse_what_should_follow(&shown, planned)?;
        Ok(shown)
    }

    /// Lets X-Plane rebuild the written weather, and waits until it has everything.
    async fn regenerate(&mut self, writes: &[DatarefWrite]) -> Result<(), BridgeError> {
        let regenerated = Instant::now();
        self.rebuild_weather(writes).await?;
        self.await_weather(writes).await?;
        sleep(self.weather_settle.saturating_sub(regenerated.elapsed())).await;
        Ok(())
    }

    /// Lets X-Plane rebuild the written weather, and rewrites what that resets.
    pub(crate) async fn rebuild_weather(
        &mut self,
        writes: &[DatarefWrite],
    ) -> Result<(), BridgeError> {
        self.command_once(COMMAND_REGENERATE_WEATHER).await?;
        self.pause_for_weather(REGENERATION_PAUSE).await;
        let again: Vec<DatarefWrite> = writes
            .iter()
            .filter(|write| needs_repeating_after_regeneration(&write.name))
            .cloned()
            .collect();
        self.write_weather(&again).await
    }

    /// Waits until the weather reads as it was written; writes it once more if it is late.
    ///
    /// # Errors
    /// [`BridgeError::NotTaken`] if that does not help either.
    pub(crate) async fn await_weather(
        &mut self,
        writes: &[DatarefWrite],
    ) -> Result<(), BridgeError> {
        let Some(late) = self.poll_weather(writes).await? else {
            return Ok(());
        };
        if is_temperature(&late.write) || self.description.replayed {
            // It was rewritten all the time, or a tape gives the answers, which are always the same.
            return Err(not_taken(late));
        }
        tracing::warn!(
            dataref = late.write.name, wanted = late.write.value, found = ?late.found,
            "the weather is late, and is written once more"
        );
        self.write_weather(writes).await?;
        match self.poll_weather(writes).await? {
            None => Ok(()),
            Some(missing) => Err(not_taken(missing)),
        }
    }

    /// Writes weather; all but the clouds is applied at once. Lost values are rewritten in the first moments; values that take longer are
    /// left alone after that.
    pub(crate) async fn write_weather(
        &mut self,
        writes: &[DatarefWrite],
    ) -> Result<(), BridgeError> {
        const ROUNDS: u32 = 5;
        self.write_surely(UPDATE_IMMEDIATELY, 1.0).await?;
        self.write_in_rounds(writes, ROUNDS).await?;
        // X-Plane resets it once it has applied everything, so it is not read back.
        self.write_surely(UPDATE_IMMEDIATELY, 1.0).await
    }

    /// Reads until everything is as required; returns the differences when the time is up.
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
        let (mut temperature_written_s, mut is_taken_for_a_moment) = (0.0, false);
        // As with a pause, a simulator whose weather shows at once does not need it.
        let holds_s = TEMPERATURE_HOLDS.min(self.weather_settle).as_secs_f32();
        let (mut before, mut unchanged) = (Vec::new(), 0);
        loop {
            let found = self.read(&watched).await?;
            self.check_settings()?;
            let running_s = found.last().copied().flatten();
            running_from_s = running_from_s.or(running_s);
            let simulated_s = running_s
                .zip(running_from_s)
                .map_or(0.0, |(now_s, from_s)| now_s - from_s);
            let passed_s = began.elapsed().as_secs_f32().max(simulated_s);
            let holds = passed_s - temperature_written_s >= holds_s;
            let mut missing: Vec<_> = expected
                .iter()
                .zip(&found)
                .filter(|(write, found)| {
                    let is_met = found.is_some_and(|value| write.is_met_by(value));
                    !is_met || is_temperature(write) && !holds
                })
                .collect();
            // The temperature last: it is waited for differently, once everything else is there.
            missing.sort_by_key(|(write, _)| is_temperature(write));
            let Some(&(write, &value)) = missing.first() else {
                return Ok(None);
            };
            let slides = is_temperature(write);
            if found.iter().any(Option::is_some) {
                heard = Instant::now();
            } else if heard.elapsed() > MAX_HITCH {
                return Err(self.silent(heard.elapsed()));
            }
            let weather = &found[..expected.len()];
            unchanged = if before == weather { unchanged + 1 } else { 0 };
            before = weather.to_vec();
            let is_wrong = !value.is_some_and(|value| write.is_met_by(value));
            let is_over = self.description.replayed && is_wrong && unchanged >= REPLAYED_POLLS;
            let patience = if !slides {
                PATIENCE
            } else if is_taken_for_a_moment {
                PATIENCE_WHILE_IT_SLIDES
            } else {
                PATIENCE_WITH_TEMPERATURE
            };
            if is_over || passed_s >= patience.as_secs_f32() {
                let source = found.get(expected.len() - 1).copied().flatten();
                return Ok(Some(Missing {
                    write: write.clone(),
                    found: value,
                    made_by: source.and_then(WeatherSource::of_value),
                    patience,
                }));
            }
            if slides && is_wrong {
                temperature_written_s = passed_s;
                self.write_surely(UPDATE_IMMEDIATELY, 1.0).await?;
                self.write_surely(&write.name, write.value).await?;
                let found = self.read(std::slice::from_ref(write)).await?[0];
                is_taken_for_a_moment = found.is_some_and(|value| write.is_met_by(value));
            }
            sleep(self.poll_pause()).await;
        }
    }

    /// A tape gives its next values on every reading.
    pub(crate) fn poll_pause(&self) -> Duration {
        if self.description.replayed {
            REPLAYED_POLL
        } else {
            POLL
        }
    }

    /// A pause that a simulator whose weather shows at once does not need.
    pub(crate) async fn pause_for_weather(&self, pause: Duration) {
        sleep(pause.min(self.weather_settle)).await;
    }
}

fn is_temperature(write: &DatarefWrite) -> bool {
    write.name == TEMPERATURE_C
}

fn not_taken(missing: Missing) -> BridgeError {
    let maker = match missing.made_by {
        Some(WeatherSource::Real) => "real weather is on (weather_source reads 1)",
        Some(WeatherSource::ControlPad) => "an instructor's pad sets it (weather_source reads 2)",
        Some(WeatherSource::Plugin) => "another plugin sets it (weather_source reads 3)",
        Some(WeatherSource::Preset) | None => "something holds it",
    };
    BridgeError::NotTaken {
        text: format!(
            "the weather does not become what was set: {} was set to {}, but {} {:?} later, although it was written once more and given as \
             long again. X-Plane 12 keeps old clouds for up to a minute and lets temperatures slide for some; longer means that {maker}. Set \
             the weather to manual and static in X-Plane, switch off other weather plugins, and run the same command again",
            missing.write.name,
            missing.write.value,
            reads(missing.found, "does not answer"),
            missing.patience
        ),
        name: missing.write.name,
        wanted: missing.write.value,
        found: missing.found,
    }
}
