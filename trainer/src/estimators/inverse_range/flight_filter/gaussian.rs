//! Normal distribution of a few unknowns, advanced in time, corrected by one number at a time (Kalman 1960), and smoothed backwards (Rauch,
//! Tung and Striebel 1965).

use dataset::numbers::least_squares::CholeskyFactor;

use super::matrix::{Matrix, dot};

/// Squared deviations beyond this count as this much in a likelihood, so that one slip does not decide a fit.
const LARGEST_SURPRISE: f64 = 25.0;

/// A normal distribution.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Gaussian {
    pub(super) mean: Vec<f64>,
    pub(super) covariance: Matrix,
}

/// Transition of the unknowns over a time step.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Step {
    pub(super) transition: Matrix,
    /// Covariance that is added.
    pub(super) noise: Matrix,
}

impl Step {
    pub(super) fn of_block<const N: usize>((transition, noise): &Block<N>) -> Self {
        let mut step = Self::zero(N);
        step.set_block(0, &(*transition, *noise));
        step
    }

    /// For unknowns whose blocks are set one by one.
    pub(super) fn zero(size: usize) -> Self {
        Self {
            transition: Matrix::zero(size),
            noise: Matrix::zero(size),
        }
    }

    pub(super) fn set_block<const N: usize>(&mut self, at: usize, (transition, noise): &Block<N>) {
        self.transition.set_block(at, transition);
        self.noise.set_block(at, noise);
    }
}

/// Transition and noise of unknowns that time does not mix with others.
pub(super) type Block<const N: usize> = ([[f64; N]; N], [[f64; N]; N]);

/// A number that is a linear function of the unknowns, with an error.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Reading {
    /// Contribution of each unknown to it.
    pub(super) row: Vec<f64>,
    /// The number minus its expectation.
    pub(super) misfit: f64,
    /// Variance of its error.
    pub(super) variance: f64,
}

impl Gaussian {
    /// Uncorrelated unknowns.
    pub(super) fn independent(mean: Vec<f64>, variances: &[f64]) -> Self {
        let mut covariance = Matrix::zero(mean.len());
        for (i, &variance) in variances.iter().enumerate() {
            covariance[(i, i)] = variance;
        }
        Self { mean, covariance }
    }

    /// After a step.
    pub(super) fn advanced(&self, step: &Step) -> Self {
        let Step { transition, noise } = step;
        let moved = transition.times(&self.covariance);
        Self {
            mean: transition.times_vector(&self.mean),
            covariance: moved.times(&transition.transposed()).plus(1.0, noise),
        }
    }

    /// Variance of the misfit of a reading.
    pub(super) fn variance_of(&self, reading: &Reading) -> f64 {
        let spread = self.covariance.times_vector(&reading.row);
        dot(&reading.row, &spread) + reading.variance
    }

    /// Takes a reading that only moves some of the unknowns (Schmidt 1966): the others are considered, with their errors, and stay.
    /// The covariance is Joseph's form, which is true for any gain.
    pub(super) fn correct(&mut self, reading: &Reading, moves: impl Fn(usize) -> bool) {
        let Reading {
            row,
            misfit,
            variance,
        } = reading;
        let size = self.mean.len();
        let spread = self.covariance.times_vector(row);
        let total = dot(row, &spread) + variance;
        let gain: Vec<f64> = (0..size)
            .map(|i| if moves(i) { spread[i] / total } else { 0.0 })
            .collect();
        for (mean, gain) in self.mean.iter_mut().zip(&gain) {
            *mean += gain * misfit;
        }
        // (I - K h) P (I - K h)^T + K r K^T, multiplied out: P is symmetric, and h P h^T + r is the total.
        for i in 0..size {
            for j in 0..size {
                self.covariance[(i, j)] +=
                    gain[i] * total * gain[j] - gain[i] * spread[j] - spread[i] * gain[j];
            }
        }
    }

    /// Smoothed state of this moment from all ticks: `self` is its state from the ticks so far, `predicted` the prediction of the next
    /// moment from these, and `next` the smoothed next moment. `None` if the prediction leaves no freedom.
    pub(super) fn smoothed(&self, step: &Step, predicted: &Self, next: &Self) -> Option<Self> {
        let size = self.mean.len();
        let factor = CholeskyFactor::of(predicted.covariance.values.clone(), size)?;
        // Row by row: the gain P F^T A^-1 is the transpose of the solution of A X = F P.
        let cross = self.covariance.times(&step.transition.transposed());
        let mut gain = Matrix::zero(size);
        for (row, values) in cross.rows().zip(gain.values.chunks_exact_mut(size)) {
            values.copy_from_slice(&factor.solve(row.to_vec())?);
        }
        let surprise: Vec<f64> = (next.mean.iter().zip(&predicted.mean))
            .map(|(next, predicted)| next - predicted)
            .collect();
        let moves = gain.times_vector(&surprise);
        let learned = next.covariance.clone().plus(-1.0, &predicted.covariance);
        let change = gain.times(&learned).times(&gain.transposed());
        Some(Self {
            mean: self.mean.iter().zip(moves).map(|(a, b)| a + b).collect(),
            covariance: self.covariance.clone().plus(1.0, &change),
        })
    }
}

/// Logarithm of the likelihood of a sequence of times and numbers, each the first unknown with an error of this variance; without
/// constants.
pub(super) fn log_likelihood(
    start: &Gaussian,
    sequence: &[(f64, f64)],
    variance: f64,
    mut step: impl FnMut(f64) -> Step,
) -> f64 {
    let Some(&(mut last_s, _)) = sequence.first() else {
        return 0.0;
    };
    let mut known = start.clone();
    let mut row = vec![0.0; start.mean.len()];
    row[0] = 1.0;
    let mut sum = 0.0;
    for &(time_s, number) in sequence {
        if time_s > last_s {
            known = known.advanced(&step(time_s - last_s));
            last_s = time_s;
        }
        let reading = Reading {
            misfit: number - known.mean[0],
            row: row.clone(),
            variance,
        };
        let total = known.variance_of(&reading);
        let surprise = (reading.misfit.powi(2) / total).min(LARGEST_SURPRISE);
        sum -= 0.5 * (total.ln() + surprise);
        known.correct(&reading, |_| true);
    }
    sum
}
