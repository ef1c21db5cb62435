//! Forward filter of a flight: what is known after each tick, given the ticks so far.
//!
//! The most precise measurement of a tick corrects the aircraft's motion. Single views, which are far less precise, only learn their own
//! errors from it, so that they are of use when the others are missing.
//!
//! Which measurements are outliers, and how large the other errors of this flight are, is not known: the answer is of the likeliest of some
//! hypotheses (a Gaussian sum: Alspach and Sorenson 1972). At each tick every hypothesis continues in several ways, weighed by
//! likelihood: the measurement is taken, with new errors as large as before or half or twice as large; it is an outlier; or it is a
//! beginning, what was known being of something else. Outliers come in groups. Hypotheses that have become alike are one again, and of the
//! rest the heaviest stay.
//!
//! The part of an error that is new at each tick of the training is not new thirty times per second: video compression, pixel phase and the
//! air change more slowly. So if ticks follow each other faster, each counts for proportionally less.

use crate::estimators::inverse_range::Measurement;

use super::gaussian::Step;
use super::hypothesis::mixture::{State, mixed};
use super::hypothesis::{Decision, Hypothesis, Known, Levelled, Model, step};

/// Chances at a usual tick: that an outlier follows a good measurement, that it follows an outlier (groups have three on average), and that
/// what was known is of something else. No flight was measured for these and what follows; tests/disturbed.rs has the simulated flights
/// that they were tried on.
const OUTLIER: f64 = 0.01;
const NEXT_OUTLIER: f64 = 0.7;
const BEGINNING: f64 = 1e-4;
/// Chance that errors are half as large from now on, or twice.
const LEVEL_CHANGE: f64 = 0.003;
/// New errors up to this many times the usual deviation: a camera that shakes by two pixels makes them 65 times as large.
const MAX_ERROR: f64 = 100.0;
/// Hypotheses at most, and the weight beside the heaviest, at a usual tick, below which one ends.
const MAX_HYPOTHESES: usize = 10;
const MIN_WEIGHT: f64 = 1e-3;
/// A former answer that a beginning displaced has at least this weight ...
const DISPLACED: f64 = 1e-3;
/// ... until it was without a measurement for so long, seconds or usual ticks: false boxes rarely last longer.
const DISPLACED_S: f64 = 20.0;
const DISPLACED_TICKS: f64 = 8.0;
/// Smallest weight of a tick.
const MIN_COUNT: f64 = 1e-3;

/// Measurements of a tick, the most precise first.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tick {
    pub(super) time_s: f64,
    pub(super) measurements: Vec<Measurement>,
    /// How far the rows of the views are from where they should be, pixels; `None` if no views are registered.
    pub(super) row_misfit_px: Option<f64>,
}

impl Tick {
    /// The most precise measurement.
    pub(super) fn best(&self) -> Option<&Measurement> {
        let best = self.measurements.first()?;
        best.distance_m.is_finite().then_some(best)
    }

    /// The other measurements of single views.
    pub(super) fn others(&self) -> impl Iterator<Item = &Measurement> {
        let others = self.measurements.iter().skip(1);
        others.filter(|measurement| measurement.of_one_view)
    }

    /// How much of a usual tick one is that follows after some seconds.
    pub(super) fn count(model: Model, seconds: f64) -> f64 {
        (seconds / model.tick_s).clamp(MIN_COUNT, 1.0)
    }
}

/// The fits whose errors are unknowns of a flight, ascending.
pub(super) fn fits_of(ticks: &[Tick]) -> Vec<usize> {
    let used = |tick: &Tick| -> Vec<usize> {
        let used = tick.best().into_iter().chain(tick.others());
        used.map(|measurement| measurement.fit).collect()
    };
    let mut fits: Vec<usize> = ticks.iter().flat_map(used).collect();
    fits.sort_unstable();
    fits.dedup();
    fits
}

/// A flight by its ticks so far and by all of them.
pub(super) struct Filtered {
    /// What is known of the motion after each tick; `None` before the first measurement.
    pub(super) known: Vec<Option<Known>>,
    /// Decision at each tick of the hypothesis that is the likeliest by all ticks.
    pub(super) decisions: Vec<Decision>,
}

/// Filters a flight.
pub(super) fn filter(model: Model, ticks: &[Tick]) -> Filtered {
    let mut filter = Filter::new(model, fits_of(ticks));
    filter.decided = Some(Vec::new());
    Filtered {
        known: ticks.iter().map(|tick| filter.take(model, tick)).collect(),
        decisions: filter.decisions(ticks.len()),
    }
}

/// Levels of new errors, up to the largest ones of the most precise fit.
fn levels(model: Model) -> u8 {
    let new_share = model.errors.first().map_or(1.0, |error| error.new_share);
    (MAX_ERROR / new_share.sqrt())
        .log2()
        .ceil()
        .clamp(0.0, 10.0) as u8
}

/// A hypothesis among others.
#[derive(Clone)]
struct Weighed {
    hypothesis: Hypothesis,
    /// Logarithm of the weight beside the heaviest.
    log_weight: f64,
    /// Logarithm of the weight by all ticks, also of a former answer whose weight was raised.
    log_whole: f64,
    /// Number of the tick at which it began.
    began: usize,
    /// True if the heaviest hypothesis once began there.
    was_answer: bool,
    /// Time of the last measurement that was taken, seconds.
    taken_s: f64,
    /// Its last entry in [`Filter::decided`].
    decided: usize,
}

/// A decision of a hypothesis, and the entry before it.
#[derive(Clone)]
struct Decided {
    decision: Decision,
    tick: usize,
    before: Option<usize>,
}

/// One way in which a hypothesis continues.
struct Way {
    /// Number of the hypothesis.
    of: usize,
    decision: Decision,
    log_weight: f64,
    /// What this tick adds to it.
    log_change: f64,
    is_displaced: bool,
}

/// The filter after some ticks. Unless decisions are kept, its memory does not grow with their number.
#[derive(Clone)]
pub(super) struct Filter {
    /// The fits whose errors are unknowns, ascending.
    fits: Vec<usize>,
    /// Highest level of new errors.
    levels: u8,
    /// Time of the last tick, seconds.
    time_s: f64,
    /// The last step, and its seconds: ticks are equally far apart, but for rounding.
    step: Option<(f64, Step)>,
    /// The heaviest first.
    hypotheses: Vec<Weighed>,
    /// Number of ticks so far.
    ticks: usize,
    /// All decisions, if a smoother needs them.
    decided: Option<Vec<Decided>>,
}

impl Filter {
    /// Before the first tick.
    pub(super) fn new(model: Model, fits: Vec<usize>) -> Self {
        Self {
            levels: levels(model),
            fits,
            time_s: 0.0,
            step: None,
            hypotheses: Vec::new(),
            ticks: 0,
            decided: None,
        }
    }

    /// State of the motion after the next tick; `None` before the first measurement.
    pub(super) fn take(&mut self, model: Model, tick: &Tick) -> Option<Known> {
        let number = self.ticks;
        self.ticks += 1;
        let seconds = (tick.time_s - self.time_s).max(0.0);
        let count = if self.hypotheses.is_empty() {
            1.0
        } else {
            self.advance(model, seconds);
            Tick::count(model, seconds)
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
        for measurement in tick.others() {
            for of in &mut self.hypotheses {
                of.hypothesis.learn(model, &self.fits, measurement, count);
            }
        }
        self.merge();
        let is_measured = tick.best().is_some();
        let states = self.hypotheses.iter().map(|of| {
            let is_outlier = of.hypothesis.is_outlier;
            let is_taken = is_measured && !is_outlier;
            State {
                weight: of.log_weight.exp(),
                known: &of.hypothesis.known,
                inflation: of.hypothesis.inflation(is_taken, count),
                is_outlier,
            }
        });
        let motion = mixed(&states.collect::<Vec<_>>(), is_measured)?;
        let weights = || self.hypotheses.iter().map(|of| of.log_weight.exp());
        let levels = self.hypotheses.iter().zip(weights());
        let levels = levels.map(|(of, weight)| weight * f64::from(of.hypothesis.level));
        let level = levels.sum::<f64>() / weights().sum::<f64>();
        Some(Known { motion, level })
    }

    fn decide(&mut self, decision: Decision, tick: usize, before: Option<usize>) -> usize {
        let Some(decided) = &mut self.decided else {
            return 0;
        };
        decided.push(Decided {
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

    /// The first measurement, with new errors of any size.
    fn begin(&mut self, model: Model, number: usize, best: &Measurement) {
        for level in 0..=self.levels {
            let decided = self.decide(Decision::Begun { level }, number, None);
            self.hypotheses.push(Weighed {
                hypothesis: Hypothesis::begun(model, &self.fits, best, level),
                // Each level is half as likely as the one below.
                log_weight: -f64::from(level) * std::f64::consts::LN_2,
                log_whole: -f64::from(level) * std::f64::consts::LN_2,
                began: number,
                was_answer: true,
                taken_s: self.time_s,
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
            self.ways(model, of, &readings[of], count, &mut ways);
        }
        let ways = Self::heaviest(ways, count);
        let before = std::mem::take(&mut self.hypotheses);
        for way in ways {
            let mut next = before[way.of].clone();
            next.log_weight = way.log_weight;
            next.log_whole += way.log_change;
            next.decided = self.decide(way.decision, number, Some(next.decided));
            match way.decision {
                Decision::Unmeasured => {}
                Decision::Taken { level } => {
                    next.hypothesis.take(&readings[way.of], level, count);
                    next.taken_s = self.time_s;
                }
                Decision::Outlier => next.hypothesis.is_outlier = true,
                Decision::Begun { level } => {
                    next.hypothesis = Hypothesis::begun(model, &self.fits, best, level);
                    next.began = number;
                    next.was_answer = false;
                    next.taken_s = self.time_s;
                }
            }
            self.hypotheses.push(next);
        }
    }

    /// The ways in which a hypothesis continues.
    fn ways(&self, model: Model, of: usize, reading: &Levelled, count: f64, ways: &mut Vec<Way>) {
        let Weighed {
            hypothesis,
            log_weight,
            was_answer,
            began,
            taken_s,
            ..
        } = &self.hypotheses[of];
        let longest_s = DISPLACED_S.max(DISPLACED_TICKS * model.tick_s);
        let heaviest = &self.hypotheses[0];
        let is_displaced =
            *was_answer && *began != heaviest.began && self.time_s - taken_s <= longest_s;
        // Chances are per usual tick.
        let outlier = if hypothesis.is_outlier {
            1.0 - (1.0 - NEXT_OUTLIER) * count
        } else {
            OUTLIER * count
        };
        let mut way = |decision, chance: f64, log_likelihood: f64| {
            let log_change = count * log_likelihood + chance.ln();
            ways.push(Way {
                of,
                decision,
                log_weight: log_weight + log_change,
                log_change,
                is_displaced: is_displaced && !matches!(decision, Decision::Begun { .. }),
            });
        };
        let level = hypothesis.level;
        let change = LEVEL_CHANGE * count;
        for (next, chance) in [
            (level.checked_sub(1), change),
            (Some(level), 1.0 - 2.0 * change),
            ((level < self.levels).then_some(level + 1), change),
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

    /// The heaviest ways, and the heaviest one of a former answer; weights are beside the heaviest.
    fn heaviest(mut ways: Vec<Way>, count: f64) -> Vec<Way> {
        ways.retain(|way| !way.log_weight.is_nan());
        ways.sort_by(|a, b| b.log_weight.total_cmp(&a.log_weight));
        let Some(highest) = ways.first().map(|way| way.log_weight) else {
            return ways;
        };
        let least = highest + (MIN_WEIGHT * count).ln();
        let within = ways.partition_point(|way| way.log_weight >= least);
        let mut others = ways.split_off(within.min(MAX_HYPOTHESES));
        if !ways.iter().any(|way| way.is_displaced)
            && let Some(displaced) = others.iter().position(|way| way.is_displaced)
        {
            ways.push(others.swap_remove(displaced));
        }
        for way in &mut ways {
            way.log_weight -= highest;
        }
        if let Some(displaced) = ways.iter_mut().find(|way| way.is_displaced) {
            displaced.log_weight = displaced.log_weight.max(DISPLACED.ln());
        }
        ways
    }

    /// Makes hypotheses that have become alike one, and sorts them.
    fn merge(&mut self) {
        let mut merged: Vec<Weighed> = Vec::with_capacity(self.hypotheses.len());
        self.hypotheses
            .sort_by(|a, b| b.log_weight.total_cmp(&a.log_weight));
        for of in self.hypotheses.drain(..) {
            match merged
                .iter_mut()
                .find(|heavier| heavier.hypothesis.is_like(&of.hypothesis))
            {
                Some(heavier) => {
                    if of.log_whole > heavier.log_whole {
                        heavier.decided = of.decided;
                    }
                    heavier.log_weight = log_sum(heavier.log_weight, of.log_weight);
                    heavier.log_whole = log_sum(heavier.log_whole, of.log_whole);
                }
                None => merged.push(of),
            }
        }
        merged.sort_by(|a, b| b.log_weight.total_cmp(&a.log_weight));
        if let Some(Weighed {
            log_weight, began, ..
        }) = merged.first()
        {
            let (highest, began) = (*log_weight, *began);
            for of in &mut merged {
                of.log_weight -= highest;
                of.was_answer |= of.began == began;
            }
        }
        self.hypotheses = merged;
    }

    /// The decisions of the hypothesis that is the likeliest by all ticks.
    fn decisions(&self, ticks: usize) -> Vec<Decision> {
        let mut decisions = vec![Decision::Unmeasured; ticks];
        let decided = self.decided.as_deref().unwrap_or_default();
        let by_all_ticks = |a: &&Weighed, b: &&Weighed| a.log_whole.total_cmp(&b.log_whole);
        let likeliest = self.hypotheses.iter().max_by(by_all_ticks);
        let mut next = likeliest.map(|of| of.decided);
        while let Some(Decided {
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

/// Logarithm of the sum of two numbers, by their logarithms.
fn log_sum(a: f64, b: f64) -> f64 {
    a.max(b) + (-(a - b).abs()).exp().ln_1p()
}
