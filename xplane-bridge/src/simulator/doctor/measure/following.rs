//! Measures which quantities of the weather at the aircraft follow the written values: two weathers that differ in every quantity are set
//! as a scenario's would be, and each quantity must be as set under both.

use std::collections::BTreeMap;
use std::time::Instant;

use dataset::conditions::Weather;
use dataset::corpus::effective_weather::{EffectiveQuantity, EffectiveWeather};

use crate::Simulator;
use crate::datarefs::weather_writes;
use crate::error::BridgeError;
use crate::profile::{Finding, WindUnit};
use crate::simulator::doctor::Check;
use crate::simulator::doctor::sky::{CALM, OVERCAST};

const NAME: &str = "weather at the aircraft";

/// Sets both weathers; `unit` is the unit of written winds, if known. Returns as well the time that one took, seconds.
pub(crate) async fn measure(
    simulator: &mut Simulator,
    unit: Option<WindUnit>,
) -> (BTreeMap<EffectiveQuantity, Finding<bool>>, Option<f64>) {
    let began = Instant::now();
    match shown_under_both(simulator, unit).await {
        Ok(shown) => {
            let each_s = began.elapsed().as_secs_f64() / shown.len() as f64;
            (findings(&shown), Some(each_s))
        }
        Err(error) => (nothing(&error.to_string()), None),
    }
}

/// No quantity was measured, for this reason.
pub(crate) fn nothing(reason: &str) -> BTreeMap<EffectiveQuantity, Finding<bool>> {
    let none = |quantity| (quantity, Finding::NotMeasured(reason.to_owned()));
    EffectiveQuantity::ALL.map(none).into()
}

/// For a person.
pub(crate) fn check(findings: &BTreeMap<EffectiveQuantity, Finding<bool>>) -> Check {
    let those = |follows: bool| -> Vec<String> {
        let those = (findings.iter()).filter(|(_, finding)| finding.found() == Some(&follows));
        those.map(|(quantity, _)| quantity.to_string()).collect()
    };
    let (following, others) = (those(true), those(false));
    let reason = findings.values().find_map(|finding| match finding {
        Finding::NotMeasured(reason) => Some(reason.clone()),
        Finding::Found(_) => None,
    });
    match (following.as_slice(), others.as_slice(), reason) {
        ([], [], Some(reason)) => Check::skipped(NAME, reason),
        (following, [], _) => Check::ok(
            NAME,
            format!("follows what is written: {}", following.join(", ")),
        ),
        (_, others, _) => Check::warning(
            NAME,
            format!("does not follow what is written: {}", others.join(", ")),
            "Is real weather on, or another weather plugin? Scenarios in which these differ are marked, and `dtd train` leaves them out unless \
             --accept-weather; if images show the right weather, X-Plane reports something else by these datarefs",
        ),
    }
}

/// Rain from a closed sky in a strong wind, and a clear day with a different wind.
fn weathers() -> [Weather; 2] {
    [
        Weather {
            visibility_m: 6_000.0,
            clouds: vec![OVERCAST],
            rain_ratio: 0.8,
            wind_speed_mps: 14.0,
            wind_from_true_deg: 90.0,
            ..CALM
        },
        Weather {
            wind_speed_mps: 5.0,
            wind_from_true_deg: 250.0,
            ..CALM
        },
    ]
}

async fn shown_under_both(
    simulator: &mut Simulator,
    unit: Option<WindUnit>,
) -> Result<Vec<(Weather, EffectiveWeather)>, BridgeError> {
    let mut shown = Vec::new();
    for weather in weathers() {
        let writes = weather_writes(&weather, simulator.generation)?;
        let writes = unit.unwrap_or(WindUnit::MetersPerSecond).applied_to(writes);
        let found = simulator.set_weather_12(&writes, &weather).await?;
        shown.push((weather, found));
    }
    Ok(shown)
}

/// A quantity follows if it was as set under both.
fn findings(shown: &[(Weather, EffectiveWeather)]) -> BTreeMap<EffectiveQuantity, Finding<bool>> {
    let finding = |quantity| {
        let is_silent = |(weather, found): &(Weather, EffectiveWeather)| {
            let mut missing = found.missing(weather).into_iter();
            missing.any(|missing| missing.quantity == quantity)
        };
        if shown.iter().any(is_silent) {
            return Finding::NotMeasured(format!("{quantity} is not reported"));
        }
        Finding::Found(
            shown
                .iter()
                .all(|(_, found)| !found.differing.contains(&quantity)),
        )
    };
    EffectiveQuantity::ALL
        .map(|quantity| (quantity, finding(quantity)))
        .into()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Report of a simulator that shows this weather.
    fn right(weather: &Weather) -> EffectiveWeather {
        EffectiveWeather {
            visibility_m: Some(weather.visibility_m),
            wind_speed_mps: Some(weather.wind_speed_mps),
            wind_from_true_deg: Some(weather.wind_from_true_deg),
            rain_ratio: Some(weather.rain_ratio),
            cloud_cover_ratios: [0, 1, 2].map(|layer| {
                Some(
                    weather
                        .clouds
                        .get(layer)
                        .map_or(0.0, |cloud| cloud.cover_ratio),
                )
            }),
            ..EffectiveWeather::default()
        }
    }

    #[test]
    fn a_value_that_stays_the_same_under_both_weathers_does_not_follow() {
        for quantity in EffectiveQuantity::ALL {
            for stuck in weathers() {
                let shown = weathers().map(|weather| {
                    let mut found = right(&weather);
                    let stuck = right(&stuck);
                    match quantity {
                        EffectiveQuantity::Visibility => found.visibility_m = stuck.visibility_m,
                        EffectiveQuantity::WindSpeed => found.wind_speed_mps = stuck.wind_speed_mps,
                        EffectiveQuantity::WindDirection => {
                            found.wind_from_true_deg = stuck.wind_from_true_deg;
                        }
                        EffectiveQuantity::Rain => found.rain_ratio = stuck.rain_ratio,
                        EffectiveQuantity::CloudCover => {
                            found.cloud_cover_ratios = stuck.cloud_cover_ratios;
                        }
                    }
                    let differing = found.differences(&weather);
                    found.differing = differing.iter().map(|one| one.quantity).collect();
                    (weather, found)
                });
                for (measured, finding) in findings(&shown) {
                    assert_eq!(finding, Finding::Found(measured != quantity), "{measured}");
                }
            }
        }
    }

    #[test]
    fn what_does_not_follow_is_a_warning_and_what_was_not_measured_is_skipped() {
        let shown = weathers().map(|weather| {
            let silent = EffectiveWeather {
                rain_ratio: None,
                differing: [EffectiveQuantity::Visibility].into(),
                ..right(&weather)
            };
            (weather, silent)
        });
        let findings = findings(&shown);
        assert!(matches!(
            findings[&EffectiveQuantity::Rain],
            Finding::NotMeasured(_)
        ));
        let check = check(&findings);
        assert_eq!(check.verdict, crate::simulator::doctor::Verdict::Warning);
        assert_eq!(check.found, "does not follow what is written: visibility");
        let skipped = super::check(&nothing("no time"));
        assert_eq!(skipped.verdict, crate::simulator::doctor::Verdict::Skipped);
    }
}
