//! Reads the weather at the aircraft and compares it with the plan.
//!
//! A quantity that `dtd doctor` measured to follow its writes must be as planned: otherwise images and record show different weathers. Any
//! other may differ for reasons that are unknown here (a different meaning, gusts, the aircraft's height); it is recorded with the scenario
//! and marks it.

use std::collections::BTreeSet;
use std::time::Duration;

use dataset::conditions::Weather;
use dataset::corpus::effective_weather::{EffectiveQuantity, EffectiveWeather};
use tokio::time::{Instant, sleep};

use super::weather::REPLAYED_POLLS;
use crate::datarefs::{DatarefWrite, effective_weather_datarefs, effective_weather_of};
use crate::error::BridgeError;
use crate::profile::Profile;
use crate::simulator::Simulator;

/// Time for the aircraft's surroundings and the image to follow the settings.
const SHOWING: Duration = Duration::from_secs(10);

impl Simulator {
    /// The weather at the aircraft under the current conditions; `None` before they are set, and for X-Plane 11, which reports none.
    pub fn effective_weather(&self) -> Option<&EffectiveWeather> {
        self.effective_weather.as_ref()
    }

    /// Sets the quantities at the aircraft that are known not to follow the writes: they are neither waited for nor rejected.
    pub fn set_not_followed(&mut self, quantities: BTreeSet<EffectiveQuantity>) {
        self.not_followed = quantities;
    }

    /// Waits until the weather at the aircraft is as planned, but for quantities that are known to differ; returns the last reading in any
    /// case. A tape gives its last reading at once.
    pub(crate) async fn await_effective_weather(
        &mut self,
        planned: &Weather,
        known_to_differ: &BTreeSet<EffectiveQuantity>,
    ) -> Result<EffectiveWeather, BridgeError> {
        let began = Instant::now();
        let (mut before, mut unchanged) = (None, 0);
        loop {
            let shown = self.read_effective_weather(planned).await?;
            let waits_for = self.to_wait_for(&shown, planned);
            if waits_for.is_subset(known_to_differ) || began.elapsed() >= SHOWING {
                return Ok(shown);
            }
            unchanged = if before.as_ref() == Some(&shown) {
                unchanged + 1
            } else {
                0
            };
            if self.description.replayed && unchanged >= REPLAYED_POLLS {
                return Ok(shown);
            }
            before = Some(shown);
            sleep(self.poll_pause()).await;
        }
    }

    /// Reads the weather at the aircraft again after the last image. A quantity that has changed since the first reading is treated as if
    /// it had differed then.
    pub(crate) async fn confirm_effective_weather(&mut self) -> Result<(), BridgeError> {
        let planned = self.conditions.as_ref().map(|set| set.weather.clone());
        let (Some(before), Some(planned)) = (self.effective_weather.clone(), planned) else {
            return Ok(());
        };
        let after = self
            .await_effective_weather(&planned, &before.differing)
            .await?;
        self.refuse_what_should_follow(&after, &planned)?;
        self.effective_weather = Some(before.with_new_differences(&after));
        Ok(())
    }

    async fn read_effective_weather(
        &mut self,
        planned: &Weather,
    ) -> Result<EffectiveWeather, BridgeError> {
        let reads_wind_speed = self.knows_unit_of_wind();
        let names = effective_weather_datarefs(planned, reads_wind_speed);
        let names: Vec<_> = names
            .into_iter()
            .map(|name| DatarefWrite::new(name, 0.0))
            .collect();
        let values = self.read(&names).await?;
        Ok(effective_weather_of(planned, reads_wind_speed, &values))
    }

    /// True if the unit of the wind at the aircraft is known: where winds are written in knots it is not, unless it was measured to follow.
    fn knows_unit_of_wind(&self) -> bool {
        let profile = self.profile.current();
        profile.is_none_or(|profile| {
            !profile.winds_are_in_knots() || profile.follows(EffectiveQuantity::WindSpeed)
        })
    }

    /// The quantities that may still become as planned.
    fn to_wait_for(
        &self,
        shown: &EffectiveWeather,
        planned: &Weather,
    ) -> BTreeSet<EffectiveQuantity> {
        let missing = shown.missing(planned).into_iter();
        let missing = missing
            .map(|missing| missing.quantity)
            .filter(|quantity| self.must_follow(*quantity));
        let differing = shown.differing.iter().copied();
        missing
            .chain(differing)
            .filter(|quantity| !self.not_followed.contains(quantity))
            .collect()
    }

    /// True if the clouds at the aircraft are wrong where it may help to regenerate them.
    pub(crate) fn is_sky_wrong(&self, shown: &EffectiveWeather) -> bool {
        let clouds = EffectiveQuantity::CloudCover;
        shown.differing.contains(&clouds) && !self.not_followed.contains(&clouds)
    }

    /// True if a quantity was measured to follow the written value, and no later experience contradicts it.
    fn must_follow(&self, quantity: EffectiveQuantity) -> bool {
        let profile = self.profile.current();
        profile.is_some_and(|profile: &Profile| profile.follows(quantity))
            && !self.not_followed.contains(&quantity)
    }

    /// An error for the first quantity that is not as planned, although it was measured to follow its writes.
    pub(crate) fn refuse_what_should_follow(
        &self,
        shown: &EffectiveWeather,
        planned: &Weather,
    ) -> Result<(), BridgeError> {
        let differences = shown
            .marks(planned)
            .into_iter()
            .chain(shown.missing(planned));
        let refused = differences
            .into_iter()
            .find(|difference| self.must_follow(difference.quantity));
        match refused {
            None => Ok(()),
            Some(difference) => Err(BridgeError::OtherWeatherShows {
                difference,
                waited: SHOWING,
            }),
        }
    }
}
