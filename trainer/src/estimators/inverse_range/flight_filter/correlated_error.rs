//! Error model for one fit of `inverse_range`: size by distance, and correlation in time.
//!
//! A filter that assumes independent errors becomes overconfident with each tick. A part of the error is new at every tick; the rest is a
//! smooth process (Matérn's with 3/2, a second-order Gauss-Markov process), because it comes from flying beside or above the usual path, or
//! from the aspect angle.

use dataset::numbers::spread::deviation_from_zero;
use serde::{Deserialize, Serialize};
use sight::sight::CERTAIN_SD;

use super::gaussian::{Block, Gaussian, Step, log_likelihood};
use crate::estimators::inverse_range::{MIN_DEVIATION, Measurement, scale_m};

/// Ticks per measured deviation, and maximum number of distances.
const TICKS_PER_DISTANCE: usize = 40;
const MAX_DISTANCES: usize = 10;
/// Maximum number of ticks for fitting the correlation; more do not change it.
const MAX_TICKS: usize = 50_000;
/// Candidates.
const NEW_SHARES: [f64; 9] = [0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 0.5, 0.7, 0.9];
const HALF_TIMES_S: [f64; 10] = [0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0];
/// Argument at which Matérn's correlation `(1 + x) exp(-x)` is a half.
const HALF: f64 = 1.678_346_990_016_661;

/// Relative errors of the distance, normalised to the best precision.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct CorrelatedError {
    /// Distances, ascending, metres.
    pub(super) distances_m: Vec<f64>,
    /// Standard deviations at these distances.
    pub(super) deviations: Vec<f64>,
    /// New share of the variance per tick.
    pub(super) new_share: f64,
    /// Correlation half-life for the rest, seconds.
    pub(super) half_time_s: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ErrorSample {
    pub(super) time_s: f64,
    pub(super) distance_m: f64,
    pub(super) error: f64,
}

impl CorrelatedError {
    /// Number of unknowns: the smooth part in its standard deviations, and its rate.
    pub(super) const UNKNOWNS: usize = 2;

    /// Default model for a fit with only its deviation in training.
    pub(super) fn of_deviation(deviation: f64) -> Self {
        Self {
            distances_m: vec![1.0],
            deviations: vec![deviation.max(MIN_DEVIATION)],
            new_share: 0.5,
            half_time_s: 16.0,
        }
    }

    /// Maximum-likelihood fit to errors; `None` without any.
    pub(super) fn fit(flights: &[Vec<ErrorSample>]) -> Option<Self> {
        let (distances_m, deviations) = deviations_by_distance(flights)?;
        let mut best = Self {
            distances_m,
            deviations,
            new_share: 0.5,
            half_time_s: 16.0,
        };
        let mut ticks = 0;
        let few = flights.iter().take_while(|flight| {
            ticks += flight.len();
            ticks <= MAX_TICKS || ticks == flight.len()
        });
        let scaled: Vec<Vec<(f64, f64)>> = few.map(|flight| best.scaled(flight)).collect();
        let mut highest = f64::NEG_INFINITY;
        for new_share in NEW_SHARES {
            for half_time_s in HALF_TIMES_S {
                let candidate = Self {
                    new_share,
                    half_time_s,
                    ..best.clone()
                };
                let likelihood = scaled.iter().map(|flight| candidate.log_likelihood(flight));
                let likelihood = likelihood.sum();
                if likelihood > highest {
                    highest = likelihood;
                    best = candidate;
                }
            }
        }
        Some(best)
    }

    /// Copy with error sizes from other flights.
    pub(super) fn with_deviations_of(&self, flights: &[Vec<ErrorSample>]) -> Self {
        match deviations_by_distance(flights) {
            None => self.clone(),
            Some((distances_m, deviations)) => Self {
                distances_m,
                deviations,
                ..*self
            },
        }
    }

    /// Errors in standard deviations.
    fn scaled(&self, flight: &[ErrorSample]) -> Vec<(f64, f64)> {
        let scaled = |observed: &ErrorSample| {
            let error = observed.error / self.deviation_at(observed.distance_m);
            (observed.time_s, error.clamp(-CERTAIN_SD, CERTAIN_SD))
        };
        flight.iter().map(scaled).collect()
    }

    fn log_likelihood(&self, scaled: &[(f64, f64)]) -> f64 {
        let variances = self.variances();
        let smooth = 1.0 - self.new_share;
        let start = Gaussian::independent(vec![0.0; 2], &variances.map(|v| smooth * v));
        log_likelihood(&start, scaled, self.new_share, |seconds| {
            let (transition, noise) = self.step(seconds);
            Step::of_block(&(transition, noise.map(|row| row.map(|v| smooth * v))))
        })
    }

    /// Standard deviation of the relative error, interpolated in its logarithm.
    pub(super) fn deviation_at(&self, distance_m: f64) -> f64 {
        let after = self.distances_m.partition_point(|&d| d < distance_m);
        let at = |index: usize| self.deviations.get(index).copied();
        let before = after.checked_sub(1);
        match (before.and_then(at), at(after)) {
            (Some(near), Some(far)) => {
                let [from_m, to_m] = [after - 1, after].map(|index| self.distances_m[index]);
                let part = (distance_m - from_m) / (to_m - from_m).max(f64::MIN_POSITIVE);
                near * (far / near).powf(part)
            }
            (near, far) => near.or(far).unwrap_or(MIN_DEVIATION),
        }
    }

    /// Measurement error as standard deviations, metres: smooth part, and new part per tick.
    pub(super) fn parts_m(&self, measurement: &Measurement, distance_m: f64) -> [f64; 2] {
        let least_m = self.deviation_at(distance_m) * scale_m(distance_m);
        let whole_m = least_m / measurement.precision;
        // Less certain shifts add new errors. The formula for one view far from its training stays wrong.
        let with_smooth_m = if measurement.of_one_view {
            whole_m
        } else {
            least_m
        };
        let smooth_m = with_smooth_m * (1.0 - self.new_share).sqrt();
        [
            smooth_m,
            (whole_m.powi(2) - smooth_m.powi(2)).max(0.0).sqrt(),
        ]
    }

    pub(super) fn variances(&self) -> [f64; Self::UNKNOWNS] {
        [1.0, self.rate_per_s().powi(2)]
    }

    /// Transition over `seconds`.
    pub(super) fn step(&self, seconds: f64) -> Block<{ Self::UNKNOWNS }> {
        let rate = self.rate_per_s();
        let part = rate * seconds;
        let kept = (-part).exp();
        let transition = [
            [kept * (1.0 + part), kept * seconds],
            [-kept * part * rate, kept * (1.0 - part)],
        ];
        // Noise that keeps the variances constant: V - F V F^T.
        let variances = self.variances();
        let mut noise = [[0.0; Self::UNKNOWNS]; Self::UNKNOWNS];
        for (i, row) in noise.iter_mut().enumerate() {
            for (j, value) in row.iter_mut().enumerate() {
                let stays: f64 = (0..Self::UNKNOWNS)
                    .map(|k| transition[i][k] * variances[k] * transition[j][k])
                    .sum();
                *value = if i == j { variances[i] - stays } else { -stays };
            }
        }
        (transition, noise)
    }

    fn rate_per_s(&self) -> f64 {
        HALF / self.half_time_s
    }
}

/// Distances, ascending, with standard deviations; `None` without any error.
fn deviations_by_distance(flights: &[Vec<ErrorSample>]) -> Option<(Vec<f64>, Vec<f64>)> {
    let mut all: Vec<ErrorSample> = flights.concat();
    all.sort_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
    let parts = (all.len() / TICKS_PER_DISTANCE).clamp(1, MAX_DISTANCES);
    let parts = all.chunks(all.len().div_ceil(parts).max(1)).map(|part| {
        let sum = part.iter().map(|observed| observed.distance_m).sum::<f64>();
        (sum / part.len() as f64, deviation(part))
    });
    let (distances_m, deviations): (Vec<f64>, Vec<f64>) = parts.unzip();
    (!all.is_empty()).then_some((distances_m, deviations))
}

fn deviation(part: &[ErrorSample]) -> f64 {
    let errors = || part.iter().map(|observed| observed.error);
    let largest = (CERTAIN_SD * deviation_from_zero(errors())).max(MIN_DEVIATION);
    let squares = errors().map(|error| error.clamp(-largest, largest).powi(2));
    (squares.sum::<f64>() / part.len().max(1) as f64)
        .sqrt()
        .max(MIN_DEVIATION)
}
