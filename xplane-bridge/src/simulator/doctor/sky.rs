//! Measures how X-Plane 12 handles written weather, by values read back and its gauges. The original weather is restored.

use std::time::Duration;

use dataset::conditions::{CloudKind, CloudLayer, Weather};
use dataset::numbers::units::MPS_PER_KNOT;
use tokio::time::{Instant, sleep};

use super::Check;
use super::measure::following;
use crate::Simulator;
use crate::datarefs::{
    CHANGE_MODE, DatarefWrite, Generation, VARIABILITY, WIND_ALTITUDE, WIND_DIRECTION, WIND_SPEED,
    weather_writes,
};
use crate::error::BridgeError;
use crate::profile::{Finding, Profile, WindUnit};

/// The wind at the aircraft, knots.
const WIND_GAUGE_KT: &str = "sim/cockpit2/gauges/indicators/wind_speed_kts";
/// Winds to write, and the range of knots shown for each if it was taken as metres per second, or as knots. Near the ground it is
/// weaker, so the two ranges are wide, and two winds must agree.
const WINDS: [f64; 2] = [10.0, 20.0];
const AS_METERS_PER_SECOND: std::ops::RangeInclusive<f64> = 1.6..=2.2;
const AS_KNOTS: std::ops::RangeInclusive<f64> = 0.8..=1.15;
/// Time for a written wind to show.
const SHOWING: Duration = Duration::from_secs(12);
const POLL: Duration = Duration::from_millis(500);

/// A closed sky.
pub(super) const OVERCAST: CloudLayer = CloudLayer {
    kind: CloudKind::Stratus,
    cover_ratio: 0.9,
    base_msl_m: 1_500.0,
    top_msl_m: 2_500.0,
};
/// A clear sky without wind.
pub(super) const CALM: Weather = Weather {
    visibility_m: 30_000.0,
    clouds: Vec::new(),
    rain_ratio: 0.0,
    wind_speed_mps: 0.0,
    wind_from_true_deg: 0.0,
    turbulence_ratio: 0.0,
};

/// Measures, and restores the weather. Returns the time that a weather took to be there, seconds, if it was measured.
pub(super) async fn measure(simulator: &mut Simulator, profile: &mut Profile) -> Option<f64> {
    let mark_unmeasured = |profile: &mut Profile, reason: &str| {
        profile.wind_unit = Finding::not_measured(reason);
        profile.weather_follows = following::nothing(reason);
        None
    };
    if simulator.generation == Generation::XPlane11 {
        let reason = "X-Plane 11 has other datarefs, on which reports agree";
        return mark_unmeasured(profile, reason);
    }
    let before = match simulator.weather_now().await {
        Ok(before) => before,
        Err(error) => return mark_unmeasured(profile, &error.to_string()),
    };
    profile.wind_unit = wind(simulator).await.into();
    let unit = profile.wind_unit.found().copied();
    let took_s;
    (profile.weather_follows, took_s) = following::measure(simulator, unit).await;
    if let Err(error) = simulator.put_weather_back(&before).await {
        tracing::warn!(%error, "the weather was not put back");
    }
    took_s
}

/// For a person.
pub(super) fn checks(profile: &Profile) -> [Check; 2] {
    let unit = Check::measured("wind unit", &profile.wind_unit, |unit| {
        let unit = match unit {
            WindUnit::MetersPerSecond => "metres per second",
            WindUnit::Knots => "knots",
        };
        format!("{WIND_SPEED} is in {unit}, by {WIND_GAUGE_KT}")
    });
    [unit, following::check(&profile.weather_follows)]
}

impl Simulator {
    /// The current values of everything that a scenario would write.
    async fn weather_now(&mut self) -> Result<Vec<DatarefWrite>, BridgeError> {
        let names = weather_writes(&CALM, self.generation)?;
        self.values_now(&names).await
    }

    /// Writes that restore the current values of datarefs.
    pub(super) async fn values_now(
        &mut self,
        names: &[DatarefWrite],
    ) -> Result<Vec<DatarefWrite>, BridgeError> {
        let known = names.iter().zip(self.read(names).await?);
        Ok(known
            .filter_map(|(write, found)| Some(DatarefWrite::new(&write.name, found?.into())))
            .collect())
    }

    /// Restores it; the source of the weather comes last, since real weather overwrites the rest.
    async fn put_weather_back(&mut self, before: &[DatarefWrite]) -> Result<(), BridgeError> {
        let (whose, values): (Vec<_>, Vec<_>) = before
            .iter()
            .cloned()
            .partition(|write| write.name == CHANGE_MODE);
        self.resume().await?;
        self.rewrite_weather(&values).await?;
        self.write_weather(&whose).await
    }

    /// Writes weather as a scenario does: it may show only after a regeneration.
    async fn rewrite_weather(&mut self, writes: &[DatarefWrite]) -> Result<(), BridgeError> {
        self.write_weather(writes).await?;
        self.rebuild_weather(writes).await
    }

    async fn value(&mut self, name: &str) -> Result<f64, BridgeError> {
        let read = self.read(&[DatarefWrite::new(name, 0.0)]).await?;
        Ok(read[0].map_or(0.0, f64::from))
    }

    /// Waits until a value is as wanted; returns the last one, if it never is.
    async fn value_once(
        &mut self,
        name: &str,
        wanted: impl Fn(f64) -> bool,
    ) -> Result<f64, BridgeError> {
        let began = Instant::now();
        loop {
            let value = self.value(name).await?;
            if wanted(value) || began.elapsed() >= SHOWING {
                return Ok(value);
            }
            sleep(POLL).await;
        }
    }
}

/// Writes two winds and reads the cockpit's gauge.
async fn wind(simulator: &mut Simulator) -> Result<WindUnit, BridgeError> {
    let mut units = Vec::new();
    let mut shown = Vec::new();
    for written in WINDS {
        let any = Weather {
            wind_speed_mps: written,
            wind_from_true_deg: 90.0,
            ..CALM
        };
        let mut writes = weather_writes(&any, simulator.generation)?;
        let winds = [WIND_ALTITUDE, WIND_SPEED, WIND_DIRECTION];
        writes.retain(|write| winds.iter().any(|name| write.name.starts_with(name)));
        writes.push(DatarefWrite::new(CHANGE_MODE, 3.0));
        writes.push(DatarefWrite::new(VARIABILITY, 0.0));
        simulator.rewrite_weather(&writes).await?;
        let is_one = |knots: f64| unit_of(written, knots).is_some();
        let knots = simulator.value_once(WIND_GAUGE_KT, is_one).await?;
        units.push(unit_of(written, knots));
        shown.push(knots);
    }
    match units[..] {
        [Some(one), Some(other)] if one == other => Ok(one),
        _ => Err(BridgeError::Failed(format!(
            "{WIND_GAUGE_KT} shows {shown:.1?} for {WINDS:?}: about {:.0} kt and {:.0} kt would be metres per second, 10 kt and 20 kt knots",
            WINDS[0] / MPS_PER_KNOT,
            WINDS[1] / MPS_PER_KNOT
        ))),
    }
}

/// The unit in which a written wind was taken, given the shown knots.
fn unit_of(written: f64, knots: f64) -> Option<WindUnit> {
    let ratio = knots / written;
    match ratio {
        _ if AS_METERS_PER_SECOND.contains(&ratio) => Some(WindUnit::MetersPerSecond),
        _ if AS_KNOTS.contains(&ratio) => Some(WindUnit::Knots),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gauge_tells_knots_from_metres_per_second_or_nothing() {
        for (written, knots, unit) in [
            (10.0, 19.4, Some(WindUnit::MetersPerSecond)),
            (20.0, 36.0, Some(WindUnit::MetersPerSecond)),
            (10.0, 10.0, Some(WindUnit::Knots)),
            (20.0, 17.5, Some(WindUnit::Knots)),
            (10.0, 13.9, None),
            (10.0, 0.0, None),
        ] {
            assert_eq!(unit_of(written, knots), unit, "{written} {knots}");
        }
    }
}
