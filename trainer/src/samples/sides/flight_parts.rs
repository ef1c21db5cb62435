//! Cross-validation parts: each part of the flights is evaluated with fits to the others.

use std::collections::BTreeSet;

use crate::samples::{Sample, Samples};

pub(crate) const MAX_PARTS: usize = 10;

/// Flights identified by content: copies share a part.
#[derive(Debug, Clone)]
pub(crate) struct FlightParts {
    /// Flight number per scenario; `None` without such ticks.
    flown: Vec<Option<usize>>,
    /// Number of parts; 0 for a single flight.
    count: usize,
}

impl FlightParts {
    pub(crate) fn of<'t>(samples: &Samples, ticks: impl Iterator<Item = &'t Sample>) -> Self {
        let flight = |scenario: usize| &samples.scenarios[scenario].flight;
        let flights: BTreeSet<&String> = ticks.map(|tick| flight(tick.scenario)).collect();
        let flights: Vec<&String> = flights.into_iter().collect();
        let scenarios = 0..samples.scenarios.len();
        Self {
            flown: scenarios
                .map(|scenario| flights.binary_search(&flight(scenario)).ok())
                .collect(),
            count: match flights.len() {
                // Errors after learning from the only flight would not predict errors on others.
                0 | 1 => 0,
                flights => flights.min(MAX_PARTS),
            },
        }
    }

    pub(crate) fn flights(&self) -> usize {
        self.flown
            .iter()
            .flatten()
            .max()
            .map_or(0, |&last| last + 1)
    }

    /// Flight number; `None` for other flights.
    pub(crate) fn flown(&self, tick: &Sample) -> Option<usize> {
        self.flown[tick.scenario]
    }

    pub(crate) fn contains(&self, part: usize, tick: &Sample) -> bool {
        let flown = self.flown(tick);
        self.count > 0 && flown.is_some_and(|flown| flown % self.count == part)
    }

    /// For each part, the ticks in all other parts.
    pub(crate) fn others<'s>(&self, ticks: &[&'s Sample]) -> impl Iterator<Item = Vec<&'s Sample>> {
        let outside = move |part| {
            let ticks = ticks.iter().copied();
            let others = ticks.filter(move |tick| !self.contains(part, tick));
            others.collect()
        };
        (0..self.count).map(outside)
    }
}

#[cfg(test)]
mod tests {
    use dataset::corpus::splits::Side;
    use testkit::synthetic::SyntheticCorpus;

    use super::*;

    fn samples(train: usize) -> Samples {
        Samples::synthetic(
            &SyntheticCorpus {
                train,
                ..SyntheticCorpus::tiny()
            },
            0.0,
        )
    }

    #[test]
    fn a_part_has_whole_flights_and_their_copies_and_the_others_have_the_rest() {
        let mut samples = samples(12);
        // The first two are the same, under two names.
        samples.scenarios[1].flight = samples.scenarios[0].flight.clone();
        let training = samples.of_side(Side::Train);
        let parts = FlightParts::of(&samples, training.iter().copied());
        assert_eq!(parts.count, MAX_PARTS);
        let part_of = |scenario: usize| -> Vec<usize> {
            let mut ticks = training.iter().filter(|s| s.scenario == scenario);
            let tick = ticks.next().unwrap();
            let parts = (0..parts.count).filter(|&part| parts.contains(part, tick));
            parts.collect()
        };
        assert_eq!(part_of(0), part_of(1));
        for (part, others) in parts.others(&training).enumerate() {
            let inside = training.iter().filter(|tick| parts.contains(part, tick));
            assert_eq!(inside.count() + others.len(), training.len());
            assert!(others.iter().all(|tick| !parts.contains(part, tick)));
        }
        assert!((0..12).all(|scenario| part_of(scenario).len() == 1));
        let test = samples.of_side(Side::Test);
        assert_eq!(parts.flown(test[0]), None);
    }

    #[test]
    fn a_single_flight_has_no_parts() {
        let samples = samples(1);
        let training = samples.of_side(Side::Train);
        let parts = FlightParts::of(&samples, training.iter().copied());
        assert_eq!(parts.others(&training).count(), 0);
    }
}
