//! Training and validation flights, measured by fits that never saw them: the data for the filter's noise and intervals.

use std::collections::BTreeMap;

use dataset::corpus::splits::Side;
use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;

use crate::estimators::inverse_range::{CrossFitted, InverseRange, Tick, scale_m};
use crate::samples::{Observation, Sample, Samples};

use super::correlated_error::ErrorSample;
use super::estimate::{Estimate, HalfWidths};
use super::held_share::width_that_holds;
use super::motion::Labels;

/// Maximum gap between labels for a speed, seconds.
const MAX_GAP_S: f64 = 10.0;
/// Share of the truth within intervals.
const HELD: f64 = 0.9;

/// Measurements with ground truth.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct LabelledFlight {
    /// Flight number: copies share it, whatever their names.
    pub(super) flown: usize,
    pub(super) ticks: Vec<Tick>,
    pub(super) distances_m: Vec<f64>,
}

impl LabelledFlight {
    /// Training flights, each measured by fits to the others if there are any, and validation flights. Boxes are filtered as in an
    /// evaluation, without ground truth.
    pub(super) fn held_out(
        fits: &CrossFitted,
        samples: &Samples,
        believed: impl Fn(&Observation) -> Observation,
    ) -> Vec<Self> {
        let ticks: Vec<_> = samples.ticks_of_side(Side::Train).collect();
        let mut flights = Self::left_out(fits, &ticks, &believed);
        let learned = samples.flights(Side::Train).len();
        let validated: Vec<String> = samples.flights(Side::Validation).into_iter().collect();
        let ticks: Vec<_> = samples.ticks_of_side(Side::Validation).collect();
        let of_validation = ticks.chunk_by(|a, b| a.scenario == b.scenario);
        flights.extend(of_validation.map(|flight| {
            let name = &samples.scenarios[flight[0].scenario].flight;
            let flown = learned + validated.binary_search(name).unwrap_or_default();
            Self::measured(flown, &fits.all, flight, &believed)
        }));
        flights
    }

    /// The flights, each part measured by fits to the others, if these exist.
    pub(super) fn left_out(
        fits: &CrossFitted,
        ticks: &[&Sample],
        believed: impl Fn(&Observation) -> Observation,
    ) -> Vec<Self> {
        let parts = &fits.parts;
        let mut flights = Vec::new();
        for (part, fits) in fits.others.iter().enumerate() {
            let Some(fits) = fits else { continue };
            let each = ticks.chunk_by(|a, b| a.scenario == b.scenario);
            let inside = each.filter(|flight| parts.contains(part, flight[0]));
            flights.extend(inside.map(|flight| {
                let flown = parts.flown(flight[0]).unwrap_or_default();
                Self::measured(flown, fits, flight, &believed)
            }));
        }
        flights
    }

    fn measured(
        flown: usize,
        fits: &InverseRange,
        flight: &[&Sample],
        believed: impl Fn(&Observation) -> Observation,
    ) -> Self {
        Self {
            flown,
            ticks: super::ticks(fits, flight.iter().map(|sample| believed(sample))),
            distances_m: flight.iter().map(|sample| sample.dtd_m).collect(),
        }
    }

    /// Distances over time, as far as approaches are alike.
    pub(super) fn labels(&self) -> Labels {
        let times = self.ticks.iter().map(|tick| tick.time_s);
        times
            .zip(self.distances_m.iter().copied())
            .filter(|&(_, distance_m)| scale_m(distance_m) == distance_m)
            .collect()
    }

    pub(super) fn errors_of(&self, fit: usize) -> Vec<ErrorSample> {
        let ticks = self.ticks.iter().zip(&self.distances_m);
        ticks
            .filter_map(|(tick, &distance_m)| {
                let measurement = tick.measurements.iter().find(|m| m.fit == fit)?;
                Some(ErrorSample {
                    time_s: tick.time_s,
                    distance_m,
                    error: measurement.error_at(distance_m),
                })
            })
            .collect()
    }

    /// Normalised errors of distance, ground speed and time to touchdown.
    fn errors(&self, estimates: &[Option<Estimate>]) -> [Vec<f64>; 3] {
        let mut errors = [const { Vec::new() }; 3];
        // Nearer than 1 NM, relative errors have other causes.
        let is_far = |&distance_m: &f64| distance_m >= METERS_PER_NAUTICAL_MILE;
        let any_is_far = self.distances_m.iter().any(is_far);
        for (tick, estimate) in estimates.iter().enumerate() {
            let Some(estimate) = estimate else { continue };
            if any_is_far && !is_far(&self.distances_m[tick]) {
                continue;
            }
            let truths = [
                (Some(estimate.distance_m), Some(self.distances_m[tick])),
                (Some(estimate.ground_speed_mps), self.speed_mps(tick)),
                (estimate.time_to_touchdown_s, self.time_to_touchdown_s(tick)),
            ];
            for (errors, truth) in errors.iter_mut().zip(truths) {
                if let (Some(estimated), Some(truth)) = truth {
                    errors.push((estimated.value - truth).abs() / estimated.sd);
                }
            }
        }
        errors
    }

    /// Speed from the neighbouring labels.
    fn speed_mps(&self, tick: usize) -> Option<f64> {
        let (before, after) = (tick.checked_sub(1)?, tick + 1);
        let seconds = self.ticks.get(after)?.time_s - self.ticks[before].time_s;
        (seconds > 0.0 && seconds <= MAX_GAP_S)
            .then(|| (self.distances_m[before] - self.distances_m[after]) / seconds)
    }

    /// Time until the last label, extrapolated with its speed.
    fn time_to_touchdown_s(&self, tick: usize) -> Option<f64> {
        let last = self.ticks.len() - 1;
        let speed_mps = self.speed_mps(last.checked_sub(1)?)?;
        let rest_s = self.distances_m[last] / speed_mps;
        let time_s = self.ticks[last].time_s - self.ticks[tick].time_s + rest_s;
        (speed_mps > 0.0).then_some(time_s)
    }
}

impl HalfWidths {
    /// Widths for 90 % coverage, with equal weight for each flight. `estimate` computes a flight's estimates.
    pub(super) fn fit(
        flights: &[LabelledFlight],
        estimate: impl Fn(&LabelledFlight) -> Vec<Option<Estimate>>,
    ) -> Self {
        let mut errors: BTreeMap<usize, [Vec<f64>; 3]> = BTreeMap::new();
        for flight in flights {
            let of_flown = errors.entry(flight.flown).or_default();
            for (all, more) in of_flown.iter_mut().zip(flight.errors(&estimate(flight))) {
                all.extend(more);
            }
        }
        let normal = Self::NORMAL.to_array();
        let [distance, ground_speed, time_to_touchdown] = [0, 1, 2].map(|number| {
            let of_number = errors
                .values_mut()
                .map(|of| std::mem::take(&mut of[number]));
            width_that_holds(HELD, of_number.collect()).unwrap_or(normal[number])
        });
        Self {
            distance,
            ground_speed,
            time_to_touchdown,
        }
    }
}

#[cfg(test)]
mod tests {
    use testkit::synthetic::SyntheticCorpus;

    use super::*;

    #[test]
    fn a_flight_is_measured_by_fits_that_saw_no_copy_of_it_at_all_ticks_and_by_boxes_as_recorded() {
        let mut samples = Samples::synthetic(
            &SyntheticCorpus {
                miss_ratio: 0.3,
                ..SyntheticCorpus::tiny()
            },
            0.0,
        );
        // The first two training flights are the same, under two names.
        samples.scenarios[1].flight = samples.scenarios[0].flight.clone();
        assert_ne!(
            samples.scenarios[1].trajectory,
            samples.scenarios[0].trajectory
        );
        let true_boxes = samples.with_true_boxes();
        let training: Vec<&Sample> = true_boxes.iter().collect();
        let fits = CrossFitted::fit(&samples, &training);
        let flights = LabelledFlight::held_out(&fits, &samples, Clone::clone);

        let ticks: usize = flights.iter().map(|flight| flight.ticks.len()).sum();
        let recorded = [Side::Train, Side::Validation].map(|s| samples.ticks_of_side(s).count());
        assert_eq!(
            ticks,
            recorded.iter().sum::<usize>(),
            "those without any box count, too"
        );
        let others = training.iter().copied().filter(|s| s.scenario > 1);
        let fits_to_others = fits.all.refitted(&others.collect::<Vec<_>>());
        let mut copies = Vec::new();
        for flight in samples
            .flights_of_side(Side::Train)
            .filter(|f| f[0].scenario < 2)
        {
            let expected = super::super::ticks(&fits_to_others, flight.iter().map(|s| &s.observed));
            let found = flights.iter().find(|found| found.ticks == expected);
            copies.extend(found.map(|found| found.flown));
        }
        assert!(matches!(copies[..], [one, other] if one == other));
        let mut flown: Vec<usize> = flights.iter().map(|flight| flight.flown).collect();
        flown.sort_unstable();
        flown.dedup();
        assert_eq!(
            flown.len(),
            4,
            "three of the training side, one that validates"
        );
    }
}
