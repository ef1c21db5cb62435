//! A hypothesis about a flight: outliers, the size of other errors, and the resulting state.
//!
//! Given these decisions, a Kalman filter is exact. All variances share a factor that the flight itself determines: the squared normalised
//! misfits, with some usual ones as prior. So misfits have Student's t as likelihood.

use sight::sight::{CERTAIN_SD, CONTRADICTS_SD};

use crate::estimators::inverse_range::{Measurement, scale_m};

use super::correlated_error::CorrelatedError;
use super::gaussian::{Gaussian, Reading, Step};
use super::motion::Motion;

/// Relative standard deviation of the distance before the first measurement.
const FIRST_DEVIATION: f64 = 0.3;
/// Maximum outlier relative to the distance. Outliers are log-uniform in size, from [`CONTRADICTS_SD`] on.
const MAX_OUTLIER: f64 = 0.5;
/// Prior weight of the usual error size, in ticks.
const USUAL_TICKS: f64 = 10.0;
/// Weight below which ticks count as faster than usual.
const FASTER_COUNT: f64 = 0.75;
/// Maximum difference between equal states: means in standard deviations, and variances in relative terms.
const SAME_STATE: f64 = 0.1;

/// Usual motion and errors.
#[derive(Debug, Clone, Copy)]
pub(super) struct Model<'a> {
    pub(super) motion: &'a Motion,
    /// Per fit.
    pub(super) errors: &'a [CorrelatedError],
    /// Usual time between ticks, seconds.
    pub(super) tick_s: f64,
}

/// Interpretation of the best measurement at a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Decision {
    /// No measurement.
    Unmeasured,
    /// Accepted, with new errors `2^level` times as large as usual.
    Taken { level: u8 },
    /// A different object.
    Outlier,
    /// A new track: the previous state belongs to a different object.
    Begun { level: u8 },
}

#[derive(Debug, Clone)]
pub(super) struct Hypothesis {
    /// Motion first, then the fits' smooth errors.
    pub(super) known: Gaussian,
    /// New errors are `2^level` times as large as usual.
    pub(super) level: u8,
    /// True if the last best measurement was an outlier.
    pub(super) is_outlier: bool,
    /// Sum of squared normalised misfits, and its number of usual ticks.
    squares: f64,
    ticks: f64,
}

impl Hypothesis {
    /// Starts at a measurement, with all errors unknown. `fits`: fits with unknown errors, ascending.
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
            begun.known.correct(&reading.at(level, 1.0));
        }
        begun
    }

    pub(super) fn advance(&mut self, model: Model, step: &Step, seconds: f64) {
        self.known = self.known.advanced(step);
        self.known.mean[0] -= model.motion.mean_speed_mps * seconds;
    }

    /// A measurement relative to the state; `None` if the fit's error is not among the unknowns.
    pub(super) fn reading(
        &self,
        model: Model,
        fits: &[usize],
        measurement: &Measurement,
    ) -> Option<ScaledReading> {
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
        Some(ScaledReading {
            of_state: self.known.variance_of(&reading),
            usual: new_m.powi(2),
            reading,
            distance_m: scale_m(measurement.distance_m),
        })
    }

    /// Log likelihood of the best measurement if it is accepted at this error level.
    pub(super) fn log_taken(&self, read: &ScaledReading, level: u8) -> f64 {
        let variance = self.factor() * read.variance(level);
        let square = read.reading.misfit.powi(2) / variance;
        // Student's t has this normalisation in addition to the normal distribution's.
        let constant = (std::f64::consts::TAU * variance).ln() + 0.5 / self.ticks;
        -0.5 * (constant + (self.ticks + 1.0) * (square / self.ticks).ln_1p())
    }

    /// Log likelihood of the best measurement if it is an outlier.
    pub(super) fn log_outlier(&self, read: &ScaledReading) -> f64 {
        let least_m = CONTRADICTS_SD * (self.factor() * read.variance(self.level)).sqrt();
        let largest_m = (MAX_OUTLIER * read.distance_m).max(least_m);
        let sizes = 1.0 + (largest_m / least_m).ln();
        -(2.0 * sizes * read.reading.misfit.abs().max(least_m)).ln()
    }

    /// Accepts the best measurement. `count`: its weight relative to a usual tick.
    pub(super) fn take(&mut self, read: &ScaledReading, level: u8, count: f64) {
        let square = read.reading.misfit.powi(2) / read.variance(level);
        self.squares += count * square.min(CERTAIN_SD.powi(2) * self.factor());
        self.ticks += count;
        self.known.correct(&read.at(level, count));
        self.level = level;
        self.is_outlier = false;
    }

    fn factor(&self) -> f64 {
        self.squares / self.ticks
    }

    /// Factor for all variances. `is_measured`: the best measurement at this tick was accepted.
    pub(super) fn inflation(&self, is_measured: bool, count: f64) -> f64 {
        // Motion without a measurement does not become more certain with small errors. Ticks with common errors have smaller misfits than
        // these errors.
        if is_measured && count >= FASTER_COUNT {
            self.factor()
        } else {
            self.factor().max(1.0)
        }
    }

    /// True if both hypotheses have the same future, except for rounding.
    pub(super) fn is_like(&self, other: &Self) -> bool {
        let alike = |unknown: usize| {
            let [a, b] = [self, other].map(|h| h.known.covariance[(unknown, unknown)]);
            let apart = self.known.mean[unknown] - other.known.mean[unknown];
            apart.powi(2) <= SAME_STATE.powi(2) * a.min(b) && (a - b).abs() <= SAME_STATE * a.min(b)
        };
        self.level == other.level && self.is_outlier == other.is_outlier && alike(0) && alike(1)
    }
}

/// A measurement relative to a state.
#[derive(Debug, Clone, Copy)]
pub(super) struct ScaledReading {
    /// Reading without variance.
    reading: Reading,
    /// Variance of the misfit due to state and smooth error, and variance of new errors at the usual size.
    of_state: f64,
    usual: f64,
    /// Measured reference for relative errors, metres.
    distance_m: f64,
}

impl ScaledReading {
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

pub(super) fn step(model: Model, fits: &[usize], seconds: f64) -> Step {
    let mut step = Step::zero(place(fits.len()));
    step.set_block(0, &model.motion.step(seconds));
    for (number, &fit) in fits.iter().enumerate() {
        step.set_block(place(number), &model.errors[fit].step(seconds));
    }
    step
}

/// Index for a fit's error among the unknowns.
fn place(number: usize) -> usize {
    Motion::UNKNOWNS + CorrelatedError::UNKNOWNS * number
}
