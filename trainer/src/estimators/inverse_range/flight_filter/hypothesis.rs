//! One account of a flight so far: the measurements that are outliers, the size of the other errors, and the state that follows.
//!
//! With this decided, a Kalman filter is exact. All variances have a common factor that the flight itself determines: its misfits in their
//! variances, together with some usual ones. So the likelihood of a misfit is Student's t.

pub(crate) mod mixture;

use crate::estimators::inverse_range::{Measurement, scale_m};

use super::correlated_error::CorrelatedError;
use super::gaussian::{Gaussian, Reading, Step};
use super::motion::Motion;

/// Relative standard deviation of the distance before the first measurement.
const FIRST_DEVIATION: f64 = 0.3;
/// A measurement of a single view beside a better one is left out if it is off by more standard deviations, and the misfit of a better one
/// counts as this much in the size of errors.
const MAX_MISFIT: f64 = 5.0;
/// Outliers are as likely to be off by one factor as by another, from this many standard deviations ...
const MIN_OUTLIER: f64 = 3.0;
/// ... to this part of the distance.
const MAX_OUTLIER: f64 = 0.5;
/// Weight, in ticks, of the usual size of errors when the size of a flight's errors is estimated.
const USUAL_TICKS: f64 = 10.0;
/// Weight below which ticks are faster than usual.
const FASTER_COUNT: f64 = 0.75;
/// Distance, in standard deviations, and relative difference of variances, within which states are the same.
const SAME_MEAN: f64 = 0.1;
const SAME_VARIANCE: f64 = 0.1;

/// The usual motion and the usual errors.
#[derive(Debug, Clone, Copy)]
pub(super) struct Model<'a> {
    pub(super) motion: &'a Motion,
    /// By number of the fit.
    pub(super) errors: &'a [CorrelatedError],
    /// Time between ticks whose errors are as new as `errors` has them, seconds.
    pub(super) tick_s: f64,
}

/// The meaning of the best measurement of a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Decision {
    /// There is none.
    Unmeasured,
    /// It is of the aircraft, and errors that are new at each tick are `2^level` times as large as usual.
    Taken { level: u8 },
    /// It is of something else.
    Outlier,
    /// It is of the aircraft, and what was known is of something else.
    Begun { level: u8 },
}

/// State after a tick.
#[derive(Debug, Clone)]
pub(super) struct Hypothesis {
    /// Motion first, then the smooth errors of the fits.
    pub(super) known: Gaussian,
    /// Errors that are new at each tick are `2^level` times as large as usual.
    pub(super) level: u8,
    /// True if the last best measurement was an outlier.
    pub(super) is_outlier: bool,
    /// Squared misfits in their variances, and the number of usual ticks that they are from.
    squares: f64,
    ticks: f64,
}

impl Hypothesis {
    /// A beginning at a measurement, with all errors unknown. `fits`: the fits whose errors are unknowns, ascending.
    pub(super) fn begun(
        model: Model,
        fits: &[usize],
        measurement: &Measurement,
        level: u8,
    ) -> Self {
        let mut variances = model.motion.variances().to_vec();
        variances[0] = (FIRST_DEVIATION * scale_m(measurement.distance_m)).powi(2);
        for &fit in fits {
            variances.extend(model.errors[fit].variances());
        }
        let mut mean = vec![0.0; variances.len()];
        mean[0] = measurement.distance_m;
        let mut begun = Self {
            known: Gaussian::independent(mean, &variances),
            level,
            is_outlier: false,
            squares: USUAL_TICKS,
            ticks: USUAL_TICKS,
        };
        if let Some(reading) = begun.reading(model, fits, measurement) {
            begun.known.correct(&reading.at(level, 1.0), |_| true);
        }
        begun
    }

    pub(super) fn advance(&mut self, model: Model, step: &Step, seconds: f64) {
        self.known = self.known.advanced(step);
        self.known.mean[0] -= model.motion.mean_speed_mps * seconds;
    }

    /// What a measurement is to the state; `None` without the fit's error among the unknowns.
    pub(super) fn reading(
        &self,
        model: Model,
        fits: &[usize],
        measurement: &Measurement,
    ) -> Option<Levelled> {
        let number = fits.binary_search(&measurement.fit).ok()?;
        let error = &model.errors[measurement.fit];
        let place = place(number);
        let distance_m = self.known.mean[0];
        let [of_smooth_m, new_m] = error.parts_m(measurement, distance_m);
        let reading = Reading {
            parts: [(0, 1.0), (place, of_smooth_m)],
            misfit: measurement.distance_m - distance_m - of_smooth_m * self.known.mean[place],
            variance: 0.0,
        };
        Some(Levelled {
            of_state: self.known.variance_of(&reading),
            usual: new_m.powi(2),
            reading,
            distance_m: scale_m(measurement.distance_m),
        })
    }

    /// Logarithm of the likelihood of the best measurement if it is taken, errors being as large as at this level.
    pub(super) fn log_taken(&self, read: &Levelled, level: u8) -> f64 {
        let variance = self.factor() * read.variance(level);
        let square = read.reading.misfit.powi(2) / variance;
        // The constant of Student's t is the one of the normal distribution up to this.
        let constant = (std::f64::consts::TAU * variance).ln() + 0.5 / self.ticks;
        -0.5 * (constant + (self.ticks + 1.0) * (square / self.ticks).ln_1p())
    }

    /// The same if it is an outlier.
    pub(super) fn log_outlier(&self, read: &Levelled) -> f64 {
        let least_m = MIN_OUTLIER * (self.factor() * read.variance(self.level)).sqrt();
        let largest_m = (MAX_OUTLIER * read.distance_m).max(least_m);
        let sizes = 1.0 + (largest_m / least_m).ln();
        -(2.0 * sizes * read.reading.misfit.abs().max(least_m)).ln()
    }

    /// Takes the best measurement. `count`: how much of a usual tick this one is.
    pub(super) fn take(&mut self, read: &Levelled, level: u8, count: f64) {
        let square = read.reading.misfit.powi(2) / read.variance(level);
        self.squares += count * square.min(MAX_MISFIT.powi(2) * self.factor());
        self.ticks += count;
        self.known.correct(&read.at(level, count), |_| true);
        self.level = level;
        self.is_outlier = false;
    }

    /// Learns the error of a single view beside a better measurement: the motion stays.
    pub(super) fn learn(
        &mut self,
        model: Model,
        fits: &[usize],
        measurement: &Measurement,
        count: f64,
    ) {
        let Some(read) = self.reading(model, fits, measurement) else {
            return;
        };
        let square = read.reading.misfit.powi(2) / (self.factor() * read.variance(self.level));
        // NaN is not below.
        if square <= MAX_MISFIT.powi(2) {
            let [_, (place, _)] = read.reading.parts;
            let own = place..place + CorrelatedError::UNKNOWNS;
            let reading = read.at(self.level, count);
            self.known
                .correct(&reading, |unknown| own.contains(&unknown));
        }
    }

    fn factor(&self) -> f64 {
        self.squares / self.ticks
    }

    /// Factor of all variances. `is_measured`: this tick has a best measurement, which was taken.
    pub(super) fn inflation(&self, is_measured: bool, count: f64) -> f64 {
        // Motion that no measurement corrects is not smaller because errors are. The misfits of ticks that share their errors are smaller
        // than these errors.
        if is_measured && count >= FASTER_COUNT {
            self.factor()
        } else {
            self.factor().max(1.0)
        }
    }

    /// True if the future of both is the same, but for rounding.
    pub(super) fn is_like(&self, other: &Self) -> bool {
        let alike = |unknown: usize| {
            let [a, b] = [self, other].map(|h| h.known.covariance[(unknown, unknown)]);
            let apart = self.known.mean[unknown] - other.known.mean[unknown];
            apart.powi(2) <= SAME_MEAN.powi(2) * a.min(b)
                && (a - b).abs() <= SAME_VARIANCE * a.min(b)
        };
        self.level == other.level && self.is_outlier == other.is_outlier && alike(0) && alike(1)
    }
}

/// Mean and covariance of the motion after a tick.
pub(super) struct Known {
    pub(super) motion: Gaussian,
    /// Errors that are new at each tick are `2^level` times as large as usual, on average over hypotheses.
    pub(super) level: f64,
}

/// A measurement beside a state.
#[derive(Debug, Clone, Copy)]
pub(super) struct Levelled {
    /// Without variance.
    reading: Reading,
    /// Variances of the misfit: of the state and the smooth error, and of errors that are new, of the usual size.
    of_state: f64,
    usual: f64,
    /// Measured, the reference of relative errors, metres.
    distance_m: f64,
}

impl Levelled {
    fn new_variance(&self, level: u8) -> f64 {
        self.usual * 4.0_f64.powi(i32::from(level))
    }

    fn variance(&self, level: u8) -> f64 {
        self.of_state + self.new_variance(level)
    }

    fn at(&self, level: u8, count: f64) -> Reading {
        Reading {
            variance: self.new_variance(level) / count,
            ..self.reading
        }
    }
}

/// Transition of all unknowns over `seconds`.
pub(super) fn step(model: Model, fits: &[usize], seconds: f64) -> Step {
    let mut step = Step::zero(place(fits.len()));
    step.set_block(0, &model.motion.step(seconds));
    for (number, &fit) in fits.iter().enumerate() {
        step.set_block(place(number), &model.errors[fit].step(seconds));
    }
    step
}

/// Index of a fit's error among the unknowns.
fn place(number: usize) -> usize {
    Motion::UNKNOWNS + CorrelatedError::UNKNOWNS * number
}
