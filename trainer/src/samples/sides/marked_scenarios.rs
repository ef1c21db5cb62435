//! Scenarios recorded in weather that differs from the plan.
//!
//! Training would take their images for the planned weather, so it leaves them out unless the settings accept them. Evaluation counts and
//! names them: leaving them out would change the request.

use std::collections::BTreeMap;

use dataset::corpus::effective_weather::ReportedWeather;
use dataset::corpus::splits::Side;

use crate::samples::Samples;
use crate::samples::rig::json_differences::named;

/// Drops marked scenarios; returns their identifiers.
pub(crate) fn leave_out(samples: &mut Samples) -> Vec<String> {
    let marked = samples
        .scenarios
        .iter()
        .filter(|scenario| scenario.is_marked());
    let ids: Vec<String> = marked.map(|scenario| scenario.id.clone()).collect();
    samples.retain_scenarios(|scenario| !scenario.is_marked());
    ids
}

pub(crate) fn left_out_line(ids: &[String]) -> String {
    format!(
        "left out, since the weather at the aircraft was not the planned one: {} (`dtd verify` says what differs; --accept-weather \
         trains on them)",
        named(ids.to_vec()).join(", ")
    )
}

/// Reported weather on the test side by planned weather; empty without reports.
pub(crate) fn reported_on_test_side(samples: &Samples) -> BTreeMap<String, ReportedWeather> {
    let mut by_name: BTreeMap<String, ReportedWeather> = BTreeMap::new();
    for scenario in samples.scenarios_of(Side::Test) {
        let Some(planned) = &scenario.planned_weather else {
            continue;
        };
        let effective = scenario.effective_weather.as_ref();
        let of_name = by_name.entry(scenario.weather.clone()).or_default();
        of_name.add(&scenario.id, effective, planned);
    }
    by_name.retain(|_, weather| weather.is_reported());
    by_name
}

#[cfg(test)]
mod tests {
    use dataset::corpus::effective_weather::{EffectiveQuantity, EffectiveWeather};
    use testkit::synthetic::SyntheticCorpus;

    use super::*;

    /// Seven scenarios; the last two on the training side, and the very last, are marked.
    fn samples() -> (Samples, Vec<String>) {
        let mut samples = Samples::synthetic(&SyntheticCorpus::tiny(), 0.0);
        let last = samples.scenarios.len() - 1;
        samples.scenarios[last].side = Side::Test;
        let mut ids = Vec::new();
        for at in [1, 2, last] {
            let scenario = &mut samples.scenarios[at];
            scenario.effective_weather = Some(EffectiveWeather {
                visibility_m: Some(1_000.0),
                differing: [EffectiveQuantity::Visibility].into(),
                ..EffectiveWeather::default()
            });
            ids.push(scenario.id.clone());
        }
        (samples, ids)
    }

    #[test]
    fn marked_scenarios_are_left_out_with_their_samples_and_named() {
        let (mut samples, marked) = samples();
        let before = samples.samples.len();
        let left_out = leave_out(&mut samples);
        assert_eq!(left_out, marked);
        assert!(
            samples
                .scenarios
                .iter()
                .all(|scenario| !marked.contains(&scenario.id))
        );
        assert!(samples.samples.len() < before);
        assert!(
            samples
                .samples
                .iter()
                .all(|sample| sample.scenario < samples.scenarios.len())
        );
        let said = left_out_line(&left_out);
        assert!(
            marked.iter().all(|id| said.contains(id)) && said.contains("--accept-weather"),
            "{said}"
        );
        assert!(leave_out(&mut samples).is_empty());
    }

    #[test]
    fn metrics_name_the_marked_scenarios_of_the_test_side_only() {
        let (samples, marked) = samples();
        let reported = reported_on_test_side(&samples);
        let named: Vec<&String> = reported
            .values()
            .flat_map(|weather| weather.marked.keys())
            .collect();
        assert_eq!(named, [marked.last().unwrap()]);
    }
}
