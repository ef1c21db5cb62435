//! Quantities of the weather at the aircraft that a simulator does not follow, learned from its scenarios.
//!
//! One scenario that differs may be an accident, which a retry or the next scenario refutes. If the same quantity differs in three
//! scenarios, and none shows that the simulator follows it, further waiting and repeated attempts would only cost time.

use std::collections::{BTreeMap, BTreeSet};

use dataset::corpus::effective_weather::{EffectiveQuantity, EffectiveWeather, WeatherDifference};

/// Number of scenarios with a differing quantity before it counts as not followed.
const ALIKE: usize = 3;

/// Experience with one simulator.
#[derive(Debug, Default)]
pub(crate) struct Followed {
    /// Scenarios with differing weather and the reported value, by quantity.
    differed: BTreeMap<EffectiveQuantity, BTreeMap<String, Option<f64>>>,
    not_followed: BTreeSet<EffectiveQuantity>,
}

impl Followed {
    pub(crate) fn not_followed(&self) -> BTreeSet<EffectiveQuantity> {
        self.not_followed.clone()
    }

    /// Notes a scenario's differences; returns the quantities that count as not followed from now on.
    pub(crate) fn differed(
        &mut self,
        id: &str,
        differences: &[WeatherDifference],
    ) -> Vec<EffectiveQuantity> {
        let mut news = Vec::new();
        for WeatherDifference {
            quantity, found, ..
        } in differences
        {
            let scenarios = self.differed.entry(*quantity).or_default();
            scenarios.insert(id.to_owned(), *found);
            if scenarios.len() >= ALIKE && self.not_followed.insert(*quantity) {
                news.push(*quantity);
            }
        }
        news
    }

    /// Notes a recorded scenario's weather. A quantity is followed after all if it is as planned and has changed since a scenario where it
    /// differed, or if a repeated attempt at the same scenario has it right.
    pub(crate) fn shown(&mut self, id: &str, shown: &EffectiveWeather) {
        for (quantity, scenarios) in &mut self.differed {
            let Some(value) = shown.value(*quantity) else {
                continue;
            };
            if shown.differing.contains(quantity) {
                continue;
            }
            let moved = scenarios
                .values()
                .any(|before| before.is_none_or(|before| !quantity.is_met(value, before)));
            if moved || scenarios.contains_key(id) {
                scenarios.clear();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn visibility(found: f64, planned: f64) -> [WeatherDifference; 1] {
        [WeatherDifference {
            quantity: EffectiveQuantity::Visibility,
            planned,
            found: Some(found),
        }]
    }

    fn right(visibility_m: f64) -> EffectiveWeather {
        EffectiveWeather {
            visibility_m: Some(visibility_m),
            ..EffectiveWeather::default()
        }
    }

    #[test]
    fn a_quantity_that_stays_the_same_in_three_scenarios_is_not_followed_and_is_named_once() {
        let mut followed = Followed::default();
        assert_eq!(followed.differed("a", &visibility(30e3, 80e3)), []);
        assert_eq!(
            followed.differed("a", &visibility(30e3, 80e3)),
            [],
            "the same one again"
        );
        // A scenario that was planned with the constant value is no evidence.
        followed.shown("b", &right(30e3));
        assert_eq!(followed.differed("c", &visibility(30e3, 50e3)), []);
        let third = followed.differed("d", &visibility(30e3, 9e3));
        assert_eq!(third, [EffectiveQuantity::Visibility]);
        assert_eq!(followed.differed("e", &visibility(30e3, 9e3)), []);
        assert!(
            followed
                .not_followed()
                .contains(&EffectiveQuantity::Visibility)
        );
    }

    #[test]
    fn accidents_far_apart_do_not_add_up() {
        let mut followed = Followed::default();
        for (number, id) in ["a", "b", "c", "d"].into_iter().enumerate() {
            assert_eq!(followed.differed(id, &visibility(30e3, 80e3)), [], "{id}");
            match number % 2 {
                // A second scenario is right, with a different visibility.
                0 => followed.shown("other", &right(50e3)),
                // Its retry is right.
                _ => followed.shown(id, &right(80e3)),
            }
        }
        assert!(followed.not_followed().is_empty());
    }
}
