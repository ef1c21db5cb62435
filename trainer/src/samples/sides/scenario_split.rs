//! The paper's split: scenarios are assigned at random, even if they share flights.
//!
//! The same flight in different light can then be on both sides, so this does not test unseen flights. Training records the assignment, and
//! the evaluation uses it.

use std::collections::{BTreeMap, BTreeSet};

use dataset::corpus::splits::Side;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha12Rng;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::samples::{Samples, ScenarioSummary};

/// A split by scenario: scenarios are drawn for the sides, whatever flights they share. Test flights may then occur in the training.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ScenarioSplitConfig {
    /// Share of the scenarios on the test side; 0.3 in the paper.
    pub test_share: f64,
    /// Share of the scenarios on the validation side. The paper has none: its decisions used the test side.
    pub validation_share: f64,
    /// Seed of the draw.
    pub seed: u64,
}

impl Default for ScenarioSplitConfig {
    fn default() -> Self {
        Self {
            test_share: 0.3,
            validation_share: 0.1,
            seed: 0,
        }
    }
}

/// Recorded assignment (`run.json`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct ScenarioSplit {
    /// Test share.
    pub test_share: f64,
    /// Validation share.
    pub validation_share: f64,
    pub seed: u64,
    /// Test scenarios with their flights.
    pub test: BTreeMap<String, String>,
    /// Test scenarios with a flight that is also on the training or validation side.
    pub sharing_flights: BTreeSet<String>,
}

impl ScenarioSplit {
    /// Assigns the sides, with at least one scenario each for test and validation.
    pub(crate) fn draw(samples: &mut Samples, config: &ScenarioSplitConfig) -> Self {
        let mut order: Vec<usize> = (0..samples.scenarios.len()).collect();
        order.shuffle(&mut ChaCha12Rng::seed_from_u64(config.seed));
        let count = |share: f64| ((share * order.len() as f64).round() as usize).max(1);
        let (test, validation) = (count(config.test_share), count(config.validation_share));
        for (place, &scenario) in order.iter().enumerate() {
            samples.scenarios[scenario].side = if place < test {
                Side::Test
            } else if place < test + validation {
                Side::Validation
            } else {
                Side::Train
            };
        }
        let of_test = |is_test: bool| {
            let scenarios = samples.scenarios.iter();
            scenarios.filter(move |scenario| (scenario.side == Side::Test) == is_test)
        };
        let learned: BTreeSet<&str> = of_test(false).map(|s| s.flight.as_str()).collect();
        let sharing = of_test(true).filter(|s| learned.contains(s.flight.as_str()));
        Self {
            test_share: config.test_share,
            validation_share: config.validation_share,
            seed: config.seed,
            sharing_flights: sharing.map(|s| s.id.clone()).collect(),
            test: of_test(true)
                .map(|s| (s.id.clone(), s.flight.clone()))
                .collect(),
        }
    }

    /// Restores the test side, and puts all other scenarios on the training side. Returns whether there is a test scenario.
    pub(crate) fn restore(&self, samples: &mut Samples) -> bool {
        for scenario in &mut samples.scenarios {
            scenario.side = if self.tests(scenario) {
                Side::Test
            } else {
                Side::Train
            };
        }
        samples.scenario_count(Side::Test) > 0
    }

    pub(crate) fn tests(&self, scenario: &ScenarioSummary) -> bool {
        self.test.get(&scenario.id) == Some(&scenario.flight)
    }
}

#[cfg(test)]
mod tests {
    use testkit::synthetic::SyntheticCorpus;

    use super::*;

    #[test]
    fn shares_are_drawn_by_the_seed_and_shared_flights_are_named() {
        let mut samples = Samples::synthetic(&SyntheticCorpus::tiny(), 0.0);
        // Seven scenarios; all but the last two share a flight.
        for scenario in &mut samples.scenarios[..5] {
            scenario.flight = "one".into();
        }
        let config = |seed| ScenarioSplitConfig {
            test_share: 0.3,
            validation_share: 0.15,
            seed,
        };
        let mut draw = |seed| {
            let split = ScenarioSplit::draw(&mut samples, &config(seed));
            let sides: Vec<Side> = samples.scenarios.iter().map(|s| s.side).collect();
            let of = |side| sides.iter().filter(|s| **s == side).count();
            let counts = [Side::Test, Side::Validation, Side::Train].map(of);
            assert_eq!(counts, [2, 1, 4]);
            let mut restored = samples.clone();
            assert!(split.restore(&mut restored));
            for (scenario, side) in restored.scenarios.iter().zip(&sides) {
                assert_eq!(scenario.side == Side::Test, *side == Side::Test);
            }
            let tested = samples.scenarios.iter().filter(|s| s.side == Side::Test);
            // Five scenarios share the flight, and two are tested: a third is always on the training side.
            let sharing = tested.filter(|s| s.flight == "one");
            let sharing: BTreeSet<String> = sharing.map(|s| s.id.clone()).collect();
            assert_eq!(split.sharing_flights, sharing);
            sides
        };
        assert_eq!(draw(1), draw(1));
        let sides = draw(0);
        assert!((1..20).any(|seed| draw(seed) != sides));
    }
}
