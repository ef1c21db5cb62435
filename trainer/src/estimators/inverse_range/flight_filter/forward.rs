//! Forward filter of a flight: the state after each tick, given the ticks so far.
//!
//! The most precise measurement of a tick corrects the aircraft's motion. Single views, which are far less precise, only learn their own
//! errors from it, so that they are of use when the others are missing.
//!
//! The part of an error that is new at each tick of the training is not new thirty times per second: video compression, pixel phase and the
//! air change more slowly. So if ticks follow each other faster, each counts for proportionally less.

use crate::estimators::inverse_range::{Measurement, scale_m};

use super::correlated_error::CorrelatedError;
use super::gaussian::{Gaussian, Reading, Step};
use super::motion::Motion;

/// Relative standard deviation of the distance before the first measurement.
const FIRST_DEVIATION: f64 = 0.3;
/// A measurement that is off by more standard deviations is of something else.
const LARGEST_MISFIT: f64 = 5.0;
/// So many of them in a row, and the filter is off.
const MOST_REFUSED: f64 = 3.0;
/// Smallest weight of a tick, and the weight below which ticks are faster than usual.
const LEAST_COUNT: f64 = 1e-3;
const FASTER_COUNT: f64 = 0.75;
/// Weight, in ticks, of the usual size of errors when the size of a flight's errors is estimated.
const USUAL_TICKS: f64 = 10.0;

/// Measurements of a tick, the most precise first.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tick {
    pub(super) time_s: f64,
    pub(super) measurements: Vec<Measurement>,
}

impl Tick {
    /// The measurements that count: the most precise one, and all of single views.
    fn used(&self) -> impl Iterator<Item = (bool, &Measurement)> {
        let numbered = self.measurements.iter().enumerate();
        numbered
            .map(|(number, measurement)| (number == 0, measurement))
            .filter(|(is_best, measurement)| *is_best || measurement.of_one_view)
    }
}

/// State after a tick.
#[derive(Debug, Clone)]
pub(super) struct Moment {
    /// Transition since the previous tick; `None` where the filter started.
    pub(super) step: Option<Step>,
    /// State predicted from the previous ticks.
    pub(super) expected: Gaussian,
    /// What is known with this tick: motion first, then the smooth errors of the fits.
    pub(super) known: Gaussian,
    /// Variances of this flight over the usual ones, by the misfits so far.
    pub(super) inflation: f64,
}

/// The usual motion and the usual errors.
#[derive(Debug, Clone, Copy)]
pub(super) struct Model<'a> {
    pub(super) motion: &'a Motion,
    /// By number of the fit.
    pub(super) errors: &'a [CorrelatedError],
    /// Time between ticks whose errors are as new as `errors` has them, seconds.
    pub(super) tick_s: f64,
}

/// State after each tick; `None` before the first measurement.
pub(super) fn filter(model: Model, ticks: &[Tick]) -> Vec<Option<Moment>> {
    let mut fits: Vec<usize> = ticks
        .iter()
        .flat_map(Tick::used)
        .map(|(_, measurement)| measurement.fit)
        .collect();
    fits.sort_unstable();
    fits.dedup();
    let mut filter = Filter {
        model,
        fits,
        last: None,
        refused: 0.0,
        refused_fit: usize::MAX,
        squares: USUAL_TICKS,
        ticks: USUAL_TICKS,
    };
    ticks
        .iter()
        .map(|tick| {
            filter.take(tick);
            filter.last.as_ref().map(|(_, moment)| moment.clone())
        })
        .collect()
}

struct Filter<'a> {
    model: Model<'a>,
    /// Fits whose errors are unknowns, in the order of these.
    fits: Vec<usize>,
    /// Time of the last tick, and what is known after it.
    last: Option<(f64, Moment)>,
    /// Best measurements that were refused in a row, in usual ticks.
    refused: f64,
    /// The most precise fit of them. An accepted measurement of a single view does not clear a refusal of both views together.
    refused_fit: usize,
    /// Squared misfits in their variances, and the number of usual ticks that they are from.
    squares: f64,
    ticks: f64,
}

impl Filter<'_> {
    fn take(&mut self, tick: &Tick) {
        let is_lost = self.refused >= MOST_REFUSED;
        let first = match self.last {
            Some(_) if !is_lost => None,
            _ => self.first(tick),
        };
        let mut count = 1.0;
        let expected = || {
            let (last_s, last) = self.last.as_ref()?;
            let seconds = (tick.time_s - last_s).max(0.0);
            count = (seconds / self.model.tick_s).clamp(LEAST_COUNT, 1.0);
            Some(self.advanced(&last.known, seconds))
        };
        let Some(mut moment) = first.or_else(expected) else {
            return;
        };
        for (is_best, measurement) in tick.used() {
            self.correct(&mut moment.known, is_best, measurement, count);
        }
        moment.inflation = self.squares / self.ticks;
        if count < FASTER_COUNT {
            // The misfits of ticks that share their errors are smaller than these errors.
            moment.inflation = moment.inflation.max(1.0);
        }
        self.last = Some((tick.time_s, moment));
    }

    /// A beginning at the best measurement of a tick, with all errors unknown.
    fn first(&mut self, tick: &Tick) -> Option<Moment> {
        let distance_m = tick.measurements.first()?.distance_m;
        self.forget_refused();
        let mut variances = self.model.motion.variances().to_vec();
        variances[0] = (FIRST_DEVIATION * scale_m(distance_m)).powi(2);
        for &fit in &self.fits {
            variances.extend(self.model.errors[fit].variances());
        }
        let mut mean = vec![0.0; variances.len()];
        mean[0] = distance_m;
        let known = Gaussian::independent(mean, &variances);
        Some(Moment {
            step: None,
            expected: known.clone(),
            known,
            inflation: 1.0,
        })
    }

    fn forget_refused(&mut self) {
        self.refused = 0.0;
        self.refused_fit = usize::MAX;
    }

    fn advanced(&self, known: &Gaussian, seconds: f64) -> Moment {
        let mut step = Step::zero(known.mean.len());
        step.set_block(0, &self.model.motion.step(seconds));
        for (number, &fit) in self.fits.iter().enumerate() {
            step.set_block(place(number), &self.model.errors[fit].step(seconds));
        }
        let mut expected = known.advanced(&step);
        expected.mean[0] -= self.model.motion.mean_speed_mps * seconds;
        Moment {
            step: Some(step),
            known: expected.clone(),
            expected,
            inflation: 1.0,
        }
    }

    /// `count`: how much of a usual tick this one is.
    fn correct(
        &mut self,
        known: &mut Gaussian,
        is_best: bool,
        measurement: &Measurement,
        count: f64,
    ) {
        let error = &self.model.errors[measurement.fit];
        let Ok(number) = self.fits.binary_search(&measurement.fit) else {
            return;
        };
        let place = place(number);
        let scale_m = scale_m(known.mean[0]);
        let sd_m = error.deviation_at(known.mean[0]) * scale_m / measurement.precision;
        let mut row = vec![0.0; known.mean.len()];
        row[0] = 1.0;
        row[place] = sd_m * (1.0 - error.new_share).sqrt();
        let mut reading = Reading {
            misfit: measurement.distance_m - known.mean[0] - row[place] * known.mean[place],
            row,
            variance: sd_m.powi(2) * error.new_share,
        };
        let square = reading.misfit.powi(2) / known.variance_of(&reading);
        // NaN is not below.
        let is_taken = square <= LARGEST_MISFIT.powi(2) * self.squares / self.ticks;
        if is_best {
            if !is_taken {
                self.refused += count;
                self.refused_fit = self.refused_fit.min(measurement.fit);
            } else if measurement.fit <= self.refused_fit {
                self.forget_refused();
            }
        }
        if !is_taken {
            return;
        }
        reading.variance /= count;
        if is_best {
            self.squares += count * square;
            self.ticks += count;
            known.correct(&reading, |_| true);
        } else {
            let own = place..place + CorrelatedError::UNKNOWNS;
            known.correct(&reading, |unknown| own.contains(&unknown));
        }
    }
}

/// Index of a fit's error among the unknowns.
fn place(number: usize) -> usize {
    Motion::UNKNOWNS + CorrelatedError::UNKNOWNS * number
}
