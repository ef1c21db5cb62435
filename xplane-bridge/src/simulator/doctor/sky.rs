//! Measures how X-Plane 12 handles written weather, by values read back, its gauges and images. The original weather is restored.

use std::time::Duration;

use dataset::conditions::{CloudKind, CloudLayer, Weather};
use dataset::numbers::units::MPS_PER_KNOT;
use tokio::time::{Instant, sleep};

use super::Check;
use super::eyes::{Eyes, Shot};
use super::lockstep::difference;
use super::measure::following;
use crate::Simulator;
use crate::datarefs::{
    CHANGE_MODE, CLOUD_BASE, CLOUD_COVER, CLOUD_TOP, CLOUD_TYPE, COMMAND_REGENERATE_WEATHER,
    DatarefWrite, Generation, METERS_PER_STATUTE_MILE, RUNNING_TIME_S, VARIABILITY,
    VISIBILITY_EFFECTIVE_M, VISIBILITY_SM, WIND_ALTITUDE, WIND_DIRECTION, WIND_SPEED,
    weather_writes,
};
use crate::error::BridgeError;
use crate::link::CapturedFrame;
use crate::profile::{Finding, Profile, WindUnit};

/// The wind at the aircraft, knots.
const WIND_GAUGE_KT: &str = "sim/cockpit2/gauges/indicators/wind_speed_kts";
/// Winds to write, and the range of knots shown for each if it was taken as metres per second, or as knots. Near the ground it is
/// weaker, so the two ranges are wide, and two winds must agree.
const WINDS: [f64; 2] = [10.0, 20.0];
const AS_METERS_PER_SECOND: std::ops::RangeInclusive<f64> = 1.6..=2.2;
const AS_KNOTS: std::ops::RangeInclusive<f64> = 0.8..=1.15;
/// Time for written weather to show, except for clouds.
const SHOWING: Duration = Duration::from_secs(12);
/// Time for clouds to read back.
const CLOUDS_WITHIN: Duration = Duration::from_secs(180);
/// Time for a regeneration to begin before clouds are written again.
const REGENERATION: Duration = Duration::from_secs(1);
/// Mean image change, of 255, that a different visibility or cover exceeds; drifting clouds do not.
const CHANGED: f64 = 3.0;
/// Simulated time after which a regeneration has no effect on written weather.
const AFTER_REGENERATION_S: f64 = 75.0;
const POLL: Duration = Duration::from_millis(500);
/// The visibilities to try: the one that is farther from the current one.
const VISIBILITIES_M: [f64; 2] = [4_000.0, 30_000.0];

/// A closed sky.
pub(super) const OVERCAST: CloudLayer = CloudLayer {
    kind: CloudKind::Stratus,
    cover_ratio: 0.9,
    base_msl_m: 1_500.0,
    top_msl_m: 2_500.0,
};
/// A clear sky without wind.
pub(super) const CALM: Weather = Weather {
    visibility_m: VISIBILITIES_M[1],
    clouds: Vec::new(),
    rain_ratio: 0.0,
    wind_speed_mps: 0.0,
    wind_from_true_deg: 0.0,
    turbulence_ratio: 0.0,
};

/// Measures, and restores the weather.
pub(super) async fn measure(eyes: &mut Eyes<'_>, profile: &mut Profile) {
    if eyes.simulator.generation == Generation::XPlane11 {
        let reason = "X-Plane 11 has other datarefs, on which reports agree";
        return mark_unmeasured(profile, reason);
    }
    let before = match eyes.simulator.weather_now().await {
        Ok(before) => before,
        Err(error) => return mark_unmeasured(profile, &error.to_string()),
    };
    measure_any(eyes, profile).await;
    if let Err(error) = eyes.simulator.put_weather_back(&before).await {
        tracing::warn!(%error, "the weather was not put back");
    }
}

async fn measure_any(eyes: &mut Eyes<'_>, profile: &mut Profile) {
    profile.visibility_needs_regeneration = visibility(eyes).await.into();
    let regenerate = profile.visibility_needs_regeneration.found() == Some(&true);
    let clouds = clouds(eyes, regenerate).await;
    (profile.clouds_take_s, profile.clouds_need_regeneration) = clouds
        .unwrap_or_else(|error| (Finding::not_measured(&error), Finding::not_measured(error)));
    profile.wind_unit = wind(eyes.simulator, regenerate).await.into();
    let unit = profile.wind_unit.found().copied();
    profile.weather_follows = following::measure(eyes.simulator, unit).await;
}

fn mark_unmeasured(profile: &mut Profile, reason: &str) {
    profile.wind_unit = Finding::not_measured(reason);
    profile.visibility_needs_regeneration = Finding::not_measured(reason);
    profile.clouds_need_regeneration = Finding::not_measured(reason);
    profile.clouds_take_s = Finding::not_measured(reason);
    profile.weather_follows = following::nothing(reason);
}

/// For a person.
pub(super) fn checks(profile: &Profile) -> Vec<Check> {
    let needs = |what: &'static str| {
        move |needed: &bool| {
            let when = if *needed { "only after" } else { "without" };
            format!("{what} shows {when} {COMMAND_REGENERATE_WEATHER}")
        }
    };
    vec![
        Check::measured(
            "visibility",
            &profile.visibility_needs_regeneration,
            needs("a visibility that was written"),
        ),
        Check::measured("clouds", &profile.clouds_take_s, |took_s| {
            format!("read back {took_s:.0} s after they were written")
        }),
        Check::measured(
            "cloud pictures",
            &profile.clouds_need_regeneration,
            needs("a cover that reads back"),
        ),
        Check::measured("wind unit", &profile.wind_unit, |unit| {
            let unit = match unit {
                WindUnit::MetersPerSecond => "metres per second",
                WindUnit::Knots => "knots",
            };
            format!("{WIND_SPEED} is in {unit}, by {WIND_GAUGE_KT}")
        }),
        following::check(&profile.weather_follows),
    ]
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
        self.write_weather(&values).await?;
        self.rebuild_weather(&values).await?;
        self.write_weather(&whose).await
    }

    async fn regenerate_now(&mut self) -> Result<(), BridgeError> {
        self.command_once(COMMAND_REGENERATE_WEATHER).await
    }

    /// Writes weather that stays as it is written.
    async fn write_steady(
        &mut self,
        writes: impl IntoIterator<Item = DatarefWrite>,
    ) -> Result<(), BridgeError> {
        let steady = [
            DatarefWrite::new(CHANGE_MODE, 3.0),
            DatarefWrite::new(VARIABILITY, 0.0),
        ];
        let all: Vec<DatarefWrite> = steady.into_iter().chain(writes).collect();
        self.write_weather(&all).await
    }

    async fn value(&mut self, name: &str) -> Result<f64, BridgeError> {
        let read = self.read(&[DatarefWrite::new(name, 0.0)]).await?;
        Ok(read[0].map_or(0.0, f64::from))
    }

    /// Waits for this much simulated time.
    async fn let_time_pass(&mut self, seconds: f64) -> Result<(), BridgeError> {
        let (began, began_s) = (Instant::now(), self.value(RUNNING_TIME_S).await?);
        // A stopped clock ends it as well.
        while self.value(RUNNING_TIME_S).await? < began_s + seconds
            && began.elapsed().as_secs_f64() < 2.0 * seconds
        {
            sleep(POLL).await;
        }
        Ok(())
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

/// Writes a different visibility, and checks whether it shows: in images, or by X-Plane's own value if they cannot be seen.
async fn visibility(eyes: &mut Eyes<'_>) -> Result<bool, BridgeError> {
    let before_m = eyes.simulator.value(VISIBILITY_EFFECTIVE_M).await?;
    let [near_m, far_m] = VISIBILITIES_M;
    let wanted_m = if before_m > 2.0 * near_m {
        near_m
    } else {
        far_m
    };
    let before = eyes.seen(Shot::BEHIND).await?;
    let write = || {
        [DatarefWrite::new(
            VISIBILITY_SM,
            wanted_m / METERS_PER_STATUTE_MILE,
        )]
    };
    for regenerated in [false, true] {
        eyes.simulator.write_steady(write()).await?;
        if regenerated {
            eyes.simulator.regenerate_now().await?;
            eyes.simulator.write_steady(write()).await?;
        }
        let near = |shown_m: f64| (shown_m / wanted_m - 1.0).abs() < 0.1;
        let shown_m = eyes
            .simulator
            .value_once(VISIBILITY_EFFECTIVE_M, near)
            .await?;
        let shows = match &before {
            Some(before) => has_changed(eyes, Shot::BEHIND, before).await?,
            None => near(shown_m),
        };
        if shows {
            return Ok(regenerated);
        }
    }
    Err(BridgeError::Failed(format!(
        "{wanted_m} m were written, and neither showed by themselves nor after {COMMAND_REGENERATE_WEATHER}: is real weather on, or another \
         weather plugin?"
    )))
}

/// True if a shot differs from the image of it before the weather was written.
async fn has_changed(
    eyes: &mut Eyes<'_>,
    shot: Shot,
    before: &CapturedFrame,
) -> Result<bool, BridgeError> {
    let now = eyes.glance(shot).await?;
    Ok(difference(&before.rgb, &now.rgb) > CHANGED)
}

/// Writes other clouds: how long they take to read back, and whether they show then or after a regeneration.
async fn clouds(
    eyes: &mut Eyes<'_>,
    regenerate: bool,
) -> Result<(Finding<f64>, Finding<bool>), BridgeError> {
    // In fog no cloud is visible.
    let far = DatarefWrite::new(VISIBILITY_SM, VISIBILITIES_M[1] / METERS_PER_STATUTE_MILE);
    eyes.simulator.write_steady([far]).await?;
    if regenerate {
        eyes.simulator.regenerate_now().await?;
    }
    // Clouds written soon after a regeneration show because of it, whether it is ours or an earlier doctor's.
    eyes.simulator.let_time_pass(AFTER_REGENERATION_S).await?;
    let cover = eyes.simulator.value(&format!("{CLOUD_COVER}[0]")).await?;
    let writes = layers(cover < 0.5, eyes.simulator.generation)?;
    let before = eyes.seen(Shot::SKY).await?;
    let took_s = await_clouds(eyes.simulator, &writes).await?;
    let Some(took_s) = took_s else {
        return Err(BridgeError::Failed(format!(
            "clouds do not read back within {} s: is real weather on, or another weather plugin?",
            CLOUDS_WITHIN.as_secs()
        )));
    };
    let took = Finding::Found(took_s);
    let Some(before) = before else {
        let blind = eyes.blind().unwrap_or_default();
        return Ok((took, Finding::NotMeasured(blind)));
    };
    for regenerated in [false, true] {
        if regenerated {
            eyes.simulator.regenerate_now().await?;
            eyes.simulator.pause_for_weather(REGENERATION).await;
            await_clouds(eyes.simulator, &writes).await?;
        }
        sleep(eyes.simulator.weather_settle).await;
        if has_changed(eyes, Shot::SKY, &before).await? {
            return Ok((took, Finding::Found(regenerated)));
        }
    }
    let reason = format!(
        "another cover reads back, and the sky looks the same, after {COMMAND_REGENERATE_WEATHER} too"
    );
    Ok((took, Finding::NotMeasured(reason)))
}

/// A covered or an empty sky, all three slots.
fn layers(covered: bool, generation: Generation) -> Result<Vec<DatarefWrite>, BridgeError> {
    let clouds = covered.then_some(OVERCAST).into_iter().collect();
    let weather = Weather { clouds, ..CALM };
    let clouds = [CLOUD_TYPE, CLOUD_COVER, CLOUD_BASE, CLOUD_TOP];
    writes_of(&clouds, &weather, generation)
}

/// The writes of these arrays for a weather.
fn writes_of(
    arrays: &[&str],
    weather: &Weather,
    generation: Generation,
) -> Result<Vec<DatarefWrite>, BridgeError> {
    let mut writes = weather_writes(weather, generation)?;
    writes.retain(|write| arrays.contains(&write.name.split('[').next().unwrap_or_default()));
    Ok(writes)
}

/// Writes clouds once and waits until all slots read so; returns how long it took, seconds of simulated or real time, whichever is
/// more. Writing them in the meantime would prolong it.
async fn await_clouds(
    simulator: &mut Simulator,
    writes: &[DatarefWrite],
) -> Result<Option<f64>, BridgeError> {
    let began = Instant::now();
    let began_s = simulator.value(RUNNING_TIME_S).await?;
    simulator.write_steady(writes.iter().cloned()).await?;
    loop {
        let found = simulator.read(writes).await?;
        let passed_s = simulator.value(RUNNING_TIME_S).await? - began_s;
        let passed_s = passed_s.max(began.elapsed().as_secs_f64());
        let mut pairs = writes.iter().zip(found);
        if pairs.all(|(write, found)| found.is_some_and(|value| write.is_met_by(value))) {
            return Ok(Some(passed_s));
        }
        if passed_s >= CLOUDS_WITHIN.as_secs_f64() {
            return Ok(None);
        }
        sleep(POLL).await;
    }
}

/// Writes two winds and reads the cockpit's gauge.
async fn wind(simulator: &mut Simulator, regenerate: bool) -> Result<WindUnit, BridgeError> {
    let mut units = Vec::new();
    let mut shown = Vec::new();
    for written in WINDS {
        let any = Weather {
            wind_speed_mps: written,
            wind_from_true_deg: 90.0,
            ..CALM
        };
        let winds = [WIND_ALTITUDE, WIND_SPEED, WIND_DIRECTION];
        let winds = writes_of(&winds, &any, simulator.generation)?;
        simulator.write_steady(winds).await?;
        if regenerate {
            simulator.regenerate_now().await?;
        }
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
