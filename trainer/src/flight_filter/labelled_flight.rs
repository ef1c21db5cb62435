//! Flights of the training and validation side, measured by fits that never saw them: what the filter's noise and its intervals are
//! fitted to.

use std::collections::BTreeSet;

use crate::inverse_range::{InverseRange, scale_m};
use crate::samples::{Sample, ScenarioSummary};

use super::correlated_error::Observed;
use super::estimate::{Estimate, HalfWidths};
use super::forward::Tick;
use super::motion::Labels;

/// Parts at most that the training side is divided into, each measured by fits to the others.
const MOST_PARTS: usize = 10;
/// Ticks nearer than this do not count for the intervals, 1 NM: there, relative errors have other causes.
const NEAREST_M: f64 = 1_852.0;
/// Labels farther apart give no speed, seconds.
const LONGEST_GAP_S: f64 = 10.0;
/// Share of the truth that intervals hold.
const HELD: f64 = 0.9;

/// Measurements with their truth.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct LabelledFlight {
    pub(super) ticks: Vec<Tick>,
    pub(super) distances_m: Vec<f64>,
}

impl LabelledFlight {
    fn of(fits: &InverseRange, flight: &[&Sample]) -> Self {
        Self {
            ticks: super::ticks(fits, flight.iter().map(|sample| &sample.observed)),
            distances_m: flight.iter().map(|sample| sample.dtd_m).collect(),
        }
    }

    /// The flights of the training side, each measured by fits to other trajectories if there are some, and those of the validation
    /// side.
    pub(super) fn held_out(
        fits: &InverseRange,
        scenarios: &[ScenarioSummary],
        training: &[&Sample],
        validation: &[&Sample],
    ) -> Vec<Self> {
        let trajectory = |sample: &Sample| scenarios[sample.scenario].trajectory.as_str();
        let all: BTreeSet<&str> = training.iter().map(|sample| trajectory(sample)).collect();
        let all: Vec<&str> = all.into_iter().collect();
        let parts = all.len().clamp(1, MOST_PARTS);
        let mut flights = Vec::new();
        for part in 0..parts {
            let is_in_part = |sample: &&&Sample| {
                let number = all.binary_search(&trajectory(sample));
                number.is_ok_and(|number| number % parts == part)
            };
            let (inside, outside): (Vec<&Sample>, Vec<&Sample>) = training
                .iter()
                .copied()
                .partition(|sample| is_in_part(&sample));
            let refitted = (parts > 1).then(|| fits.refitted(&outside));
            flights.extend(Self::each(refitted.as_ref().unwrap_or(fits), &inside));
        }
        flights.extend(Self::each(fits, validation));
        flights
    }

    fn each(fits: &InverseRange, samples: &[&Sample]) -> impl Iterator<Item = Self> {
        samples
            .chunk_by(|a, b| a.scenario == b.scenario)
            .map(|flight| Self::of(fits, flight))
    }

    /// Distances over time, as far as approaches are alike.
    pub(super) fn labels(&self) -> Labels {
        let times = self.ticks.iter().map(|tick| tick.time_s);
        times
            .zip(self.distances_m.iter().copied())
            .filter(|&(_, distance_m)| scale_m(distance_m) == distance_m)
            .collect()
    }

    /// The errors of one fit.
    pub(super) fn errors_of(&self, fit: usize) -> Vec<Observed> {
        let ticks = self.ticks.iter().zip(&self.distances_m);
        ticks
            .filter_map(|(tick, &distance_m)| {
                let measurement = tick.measurements.iter().find(|m| m.fit == fit)?;
                Some(Observed {
                    time_s: tick.time_s,
                    distance_m,
                    error: measurement.error_at(distance_m),
                })
            })
            .collect()
    }

    /// Errors of estimates in standard deviations: of distance, ground speed and time to touchdown.
    fn errors(&self, estimates: &[Option<Estimate>]) -> [Vec<f64>; 3] {
        let mut errors = [const { Vec::new() }; 3];
        let is_far = |&distance_m: &f64| distance_m >= NEAREST_M;
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

    /// Speed by the labels before and after a tick.
    fn speed_mps(&self, tick: usize) -> Option<f64> {
        let (before, after) = (tick.checked_sub(1)?, tick + 1);
        let seconds = self.ticks.get(after)?.time_s - self.ticks[before].time_s;
        (seconds > 0.0 && seconds <= LONGEST_GAP_S)
            .then(|| (self.distances_m[before] - self.distances_m[after]) / seconds)
    }

    /// Time until the last label, and from there on with its speed.
    fn time_to_touchdown_s(&self, tick: usize) -> Option<f64> {
        let last = self.ticks.len() - 1;
        let speed_mps = self.speed_mps(last.checked_sub(1)?)?;
        let rest_s = self.distances_m[last] / speed_mps;
        let time_s = self.ticks[last].time_s - self.ticks[tick].time_s + rest_s;
        (speed_mps > 0.0).then_some(time_s)
    }
}

impl HalfWidths {
    /// Widths whose intervals hold 90 % of the truth, all flights counting the same (split conformal prediction: Papadopoulos and others
    /// 2002). `estimate` is asked for the estimates of a flight.
    pub(super) fn fit(
        flights: &[LabelledFlight],
        estimate: impl Fn(&LabelledFlight) -> Vec<Option<Estimate>>,
    ) -> Self {
        let errors: Vec<[Vec<f64>; 3]> = flights
            .iter()
            .map(|flight| flight.errors(&estimate(flight)))
            .collect();
        let normal = Self::NORMAL.to_array();
        let [distance, ground_speed, time_to_touchdown] = [0, 1, 2].map(|number| {
            let of_number: Vec<&[f64]> = errors.iter().map(|of| of[number].as_slice()).collect();
            holding_width(&of_number).unwrap_or(normal[number])
        });
        Self {
            distance,
            ground_speed,
            time_to_touchdown,
        }
    }
}

/// The width that holds a share of all errors, those of each flight together counting 1.
fn holding_width(flights: &[&[f64]]) -> Option<f64> {
    let mut weighted: Vec<(f64, f64)> = flights
        .iter()
        .flat_map(|errors| {
            let weight = (errors.len() as f64).recip();
            errors.iter().map(move |&error| (error, weight))
        })
        .filter(|(error, _)| error.is_finite())
        .collect();
    weighted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let all: f64 = weighted.iter().map(|(_, weight)| weight).sum();
    let mut held = 0.0;
    weighted.iter().find_map(|&(error, weight)| {
        held += weight;
        (held >= HELD * all).then_some(error)
    })
}
