//! Forward filter: the state after each tick, from past ticks.
//!
//! The most precise measurement at a tick corrects the aircraft's motion.
//!
//! Which measurements are outliers, and how large this flight's other errors are, is unknown: several hypotheses compete (a Gaussian sum:
//! Alspach and Sorenson 1972), and the most likely one answers. At each tick every hypothesis branches, weighed by likelihood: the
//! measurement is accepted, with new errors at the same size or half or twice as large; it is an outlier; or it starts a new track, and the
//! old state belongs to a different object. Outliers come in groups. Similar hypotheses are merged, and of the rest the heaviest stay.
//!
//! Errors that are new at each tick in training are not new thirty times per second: video compression, pixel phase and the air change more
//! slowly. So if ticks follow each other faster, each has proportionally less weight.

use std::collections::BTreeSet;

use crate::estimators::inverse_range::{Measurement, Tick};

use super::gaussian::{Gaussian, Step};
use super::hypothesis::{Decision, Hypothesis, Model, ScaledReading, step};
use super::mixture::{Component, mixed};

/// Probabilities per usual tick: an outlier after a good measurement, an outlier after an outlier (groups have three on average), and a new
/// track. Neither these nor the following constants were measured on flights; tests/disturbed.rs has the simulated flights that they were
/// tuned on.
const OUTLIER: f64 = 0.01;
const NEXT_OUTLIER: f64 = 0.7;
const BEGINNING: f64 = 1e-4;
/// Probability that errors halve or double.
const LEVEL_CHANGE: f64 = 0.003;
/// Highest level of new errors: a camera that shakes by two pixels makes all errors 65 times as large, and the new part may be small.
const MAX_LEVEL: u8 = 10;
const MAX_HYPOTHESES: usize = 10;
/// Minimum tick weight, and minimum hypothesis weight relative to the heaviest at a usual tick.
const MIN_WEIGHT: f64 = 1e-3;

/// Weight of a tick relative to a usual one, by the time since the last tick.
pub(super) fn tick_count(model: Model, seconds: f64) -> f64 {
    (seconds / model.tick_s).clamp(MIN_WEIGHT, 1.0)
}

/// Fits with unknown errors in a flight, ascending.
pub(super) fn fits_of(ticks: &[Tick]) -> Vec<usize> {
    let used = ticks.iter().filter_map(|tick| Some(tick.best()?.fit));
    let used: BTreeSet<usize> = used.collect();
    used.into_iter().collect()
}

/// A filtered flight.
pub(super) struct Filtered {
    /// Motion after each tick; `None` before the first measurement.
    pub(super) known: Vec<Option<Gaussian>>,
    /// Decisions of the hypothesis that is most likely after all ticks.
    pub(super) decisions: Vec<Decision>,
}

pub(super) fn filter(model: Model, ticks: &[Tick]) -> Filtered {
    let mut filter = Filter::new(fits_of(ticks));
    filter.decided = Some(Vec::new());
    Filtered {
        known: ticks.iter().map(|tick| filter.take(model, tick)).collect(),
        decisions: filter.decisions(ticks.len()),
    }
}

#[derive(Clone)]
struct WeightedHypothesis {
    hypothesis: Hypothesis,
    /// Logarithm of the weight relative to the heaviest.
    log_weight: f64,
    /// Last entry in [`Filter::decided`].
    decided: usize,
}

/// A decision with the index of the previous one.
#[derive(Clone)]
struct DecisionEntry {
    decision: Decision,
    tick: usize,
    before: Option<usize>,
}

/// Possible continuation.
struct Branch {
    /// Index of the hypothesis.
    of: usize,
    decision: Decision,
    log_weight: f64,
}

/// Filter state. Unless decisions are kept, its memory is bounded.
#[derive(Clone)]
pub(super) struct Filter {
    /// Fits with unknown errors, ascending.
    fits: Vec<usize>,
    /// Time of the last tick, seconds.
    time_s: f64,
    /// Last step with its duration: ticks are equally far apart, except for rounding.
    step: Option<(f64, Step)>,
    /// The heaviest first.
    hypotheses: Vec<WeightedHypothesis>,
    ticks: usize,
    /// All decisions, for a smoother.
    decided: Option<Vec<DecisionEntry>>,
}

impl Filter {
    pub(super) fn new(fits: Vec<usize>) -> Self {
        Self {
            fits,
            time_s: 0.0,
            step: None,
            hypotheses: Vec::new(),
            ticks: 0,
            decided: None,
        }
    }

    /// Motion after the next tick; `None` before the first measurement.
    pub(super) fn take(&mut self, model: Model, tick: &Tick) -> Option<Gaussian> {
        let number = self.ticks;
        self.ticks += 1;
        let seconds = (tick.time_s - self.time_s).max(0.0);
        let count = if self.hypotheses.is_empty() {
            1.0
        } else {
            self.advance(model, seconds);
            tick_count(model, seconds)
        };
        self.time_s = tick.time_s;
        match tick.best() {
            None => {
                for number_of in 0..self.hypotheses.len() {
                    let before = Some(self.hypotheses[number_of].decided);
                    let decided = self.decide(Decision::Unmeasured, number, before);
                    self.hypotheses[number_of].decided = decided;
                }
            }
            Some(best) if self.hypotheses.is_empty() => self.begin(model, number, best),
            Some(best) => self.branch(model, number, best, count),
        }
        self.merge();
        let is_measured = tick.best().is_some();
        let states = self.hypotheses.iter().map(|of| {
            let is_taken = is_measured && !of.hypothesis.is_outlier;
            Component {
                weight: of.log_weight.exp(),
                known: &of.hypothesis.known,
                inflation: of.hypothesis.inflation(is_taken, count),
            }
        });
        mixed(&states.collect::<Vec<_>>())
    }

    fn decide(&mut self, decision: Decision, tick: usize, before: Option<usize>) -> usize {
        let Some(decided) = &mut self.decided else {
            return 0;
        };
        decided.push(DecisionEntry {
            decision,
            tick,
            before,
        });
        decided.len() - 1
    }

    fn advance(&mut self, model: Model, seconds: f64) {
        let is_of = |(of_s, _): &(f64, Step)| (of_s - seconds).abs() < 1e-6;
        if !self.step.as_ref().is_some_and(is_of) {
            self.step = Some((seconds, step(model, &self.fits, seconds)));
        }
        let Some((_, step)) = &self.step else { return };
        for of in &mut self.hypotheses {
            of.hypothesis.advance(model, step, seconds);
        }
    }

    /// Starts with the first measurement, at every error level.
    fn begin(&mut self, model: Model, number: usize, best: &Measurement) {
        for level in 0..=MAX_LEVEL {
            let decided = self.decide(Decision::Begun { level }, number, None);
            self.hypotheses.push(WeightedHypothesis {
                hypothesis: Hypothesis::begun(model, &self.fits, best, level),
                // Each level is half as likely as the one below.
                log_weight: -f64::from(level) * std::f64::consts::LN_2,
                decided,
            });
        }
    }

    fn branch(&mut self, model: Model, number: usize, best: &Measurement, count: f64) {
        let mut readings = Vec::with_capacity(self.hypotheses.len());
        let mut ways = Vec::new();
        for (of, weighed) in self.hypotheses.iter().enumerate() {
            let reading = weighed.hypothesis.reading(model, &self.fits, best);
            let Some(reading) = reading else { return };
            readings.push(reading);
            self.ways(of, &readings[of], count, &mut ways);
        }
        let ways = Self::heaviest(ways, count);
        let before = std::mem::take(&mut self.hypotheses);
        for way in ways {
            let mut next = before[way.of].clone();
            next.log_weight = way.log_weight;
            next.decided = self.decide(way.decision, number, Some(next.decided));
            match way.decision {
                Decision::Unmeasured => {}
                Decision::Taken { level } => {
                    next.hypothesis.take(&readings[way.of], level, count);
                }
                Decision::Outlier => next.hypothesis.is_outlier = true,
                Decision::Begun { level } => {
                    next.hypothesis = Hypothesis::begun(model, &self.fits, best, level);
                }
            }
            self.hypotheses.push(next);
        }
    }

    /// All continuations for a hypothesis.
    fn ways(&self, of: usize, reading: &ScaledReading, count: f64, ways: &mut Vec<Branch>) {
        let WeightedHypothesis {
            hypothesis,
            log_weight,
            ..
        } = &self.hypotheses[of];
        // Probabilities are per usual tick.
        let outlier = if hypothesis.is_outlier {
            1.0 - (1.0 - NEXT_OUTLIER) * count
        } else {
            OUTLIER * count
        };
        let mut way = |decision, chance: f64, log_likelihood: f64| {
            ways.push(Branch {
                of,
                decision,
                log_weight: log_weight + count * log_likelihood + chance.ln(),
            });
        };
        let level = hypothesis.level;
        let change = LEVEL_CHANGE * count;
        for (next, chance) in [
            (level.checked_sub(1), change),
            (Some(level), 1.0 - 2.0 * change),
            ((level < MAX_LEVEL).then_some(level + 1), change),
        ] {
            if let Some(level) = next {
                let likelihood = hypothesis.log_taken(reading, level);
                way(
                    Decision::Taken { level },
                    (1.0 - outlier) * chance,
                    likelihood,
                );
            }
        }
        let likelihood = hypothesis.log_outlier(reading);
        way(Decision::Outlier, outlier, likelihood);
        if of == 0 {
            way(Decision::Begun { level }, BEGINNING * count, likelihood);
        }
    }

    /// The heaviest branches, with weights relative to the heaviest.
    fn heaviest(mut ways: Vec<Branch>, count: f64) -> Vec<Branch> {
        ways.retain(|way| !way.log_weight.is_nan());
        ways.sort_by(|a, b| b.log_weight.total_cmp(&a.log_weight));
        let Some(highest) = ways.first().map(|way| way.log_weight) else {
            return ways;
        };
        let least = highest + (MIN_WEIGHT * count).ln();
        let within = ways.partition_point(|way| way.log_weight >= least);
        ways.truncate(within.min(MAX_HYPOTHESES));
        for way in &mut ways {
            way.log_weight -= highest;
        }
        ways
    }

    /// Merges similar hypotheses, and sorts them.
    fn merge(&mut self) {
        let mut merged: Vec<WeightedHypothesis> = Vec::with_capacity(self.hypotheses.len());
        self.hypotheses
            .sort_by(|a, b| b.log_weight.total_cmp(&a.log_weight));
        for of in self.hypotheses.drain(..) {
            match merged
                .iter_mut()
                .find(|heavier| heavier.hypothesis.is_like(&of.hypothesis))
            {
                Some(heavier) => {
                    heavier.log_weight = log_sum(heavier.log_weight, of.log_weight);
                }
                None => merged.push(of),
            }
        }
        merged.sort_by(|a, b| b.log_weight.total_cmp(&a.log_weight));
        let highest = merged.first().map_or(0.0, |of| of.log_weight);
        for of in &mut merged {
            of.log_weight -= highest;
        }
        self.hypotheses = merged;
    }

    /// Decisions of the hypothesis that is most likely after all ticks.
    fn decisions(&self, ticks: usize) -> Vec<Decision> {
        let mut decisions = vec![Decision::Unmeasured; ticks];
        let decided = self.decided.as_deref().unwrap_or_default();
        let mut next = self.hypotheses.first().map(|of| of.decided);
        while let Some(DecisionEntry {
            decision,
            tick,
            before,
        }) = next.and_then(|number| decided.get(number))
        {
            decisions[*tick] = *decision;
            next = *before;
        }
        decisions
    }
}

/// Log-sum-exp for two numbers.
fn log_sum(a: f64, b: f64) -> f64 {
    a.max(b) + (-(a - b).abs()).exp().ln_1p()
}
