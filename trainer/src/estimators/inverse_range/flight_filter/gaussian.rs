//! Normal distribution with a few unknowns: prediction and scalar updates (Kalman 1960), and backward smoothing (Rauch, Tung and Striebel
//! 1965).

use std::ops::{Index, IndexMut};

use dataset::numbers::least_squares::{CholeskyFactor, dot};
use sight::sight::CERTAIN_SD;

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Gaussian {
    pub(super) mean: Vec<f64>,
    pub(super) covariance: Matrix,
}

/// Transition over a time step, in diagonal blocks.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Step {
    transition: Matrix,
    /// Added covariance.
    noise: Matrix,
    /// Start and end of each block.
    blocks: Vec<(usize, usize)>,
}

impl Step {
    pub(super) fn of_block<const N: usize>((transition, noise): &Block<N>) -> Self {
        let mut step = Self::zero(N);
        step.set_block(0, &(*transition, *noise));
        step
    }

    /// A step without blocks.
    pub(super) fn zero(size: usize) -> Self {
        Self {
            transition: Matrix::zero(size),
            noise: Matrix::zero(size),
            blocks: Vec::new(),
        }
    }

    pub(super) fn set_block<const N: usize>(&mut self, at: usize, (transition, noise): &Block<N>) {
        self.transition.set_block(at, transition);
        self.noise.set_block(at, noise);
        self.blocks.push((at, at + N));
    }

    /// Mean after the step.
    pub(super) fn moved(&self, unknowns: &[f64]) -> Vec<f64> {
        self.transition.times_vector(unknowns)
    }

    /// Transition times covariance, block by block: most transition elements are 0.
    fn times(&self, covariance: &Matrix) -> Matrix {
        let size = covariance.size;
        let mut product = Matrix::zero(size);
        for &(from, to) in &self.blocks {
            for i in from..to {
                let sums = &mut product.values[i * size..(i + 1) * size];
                for k in from..to {
                    let factor = self.transition[(i, k)];
                    let row = &covariance.values[k * size..(k + 1) * size];
                    for (sum, value) in sums.iter_mut().zip(row) {
                        *sum += factor * value;
                    }
                }
            }
        }
        product
    }

    /// Transition times covariance times transposed transition, plus noise.
    fn advanced(&self, covariance: &Matrix) -> Matrix {
        let moved = self.times(covariance);
        let mut advanced = self.noise.clone();
        let rows = advanced.values.chunks_exact_mut(covariance.size);
        for (row, moved) in rows.zip(moved.rows()) {
            for &(from, to) in &self.blocks {
                for (j, value) in (from..to).zip(&mut row[from..to]) {
                    let transition = &self.transition.values[j * covariance.size..];
                    *value += dot(&moved[from..to], &transition[from..to]);
                }
            }
        }
        advanced
    }
}

/// Transition and noise for a block.
pub(super) type Block<const N: usize> = ([[f64; N]; N], [[f64; N]; N]);

/// A linear function of two unknowns with an error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Reading {
    /// Unknowns with their factors.
    pub(super) parts: [(usize, f64); 2],
    /// Measured minus expected number.
    pub(super) misfit: f64,
    /// Error variance.
    pub(super) variance: f64,
}

impl Gaussian {
    pub(super) fn independent(mean: Vec<f64>, variances: &[f64]) -> Self {
        let mut covariance = Matrix::zero(mean.len());
        for (i, &variance) in variances.iter().enumerate() {
            covariance[(i, i)] = variance;
        }
        Self { mean, covariance }
    }

    /// Marginal distribution of the first unknowns, with a variance factor.
    pub(super) fn first(&self, unknowns: usize, factor: f64) -> Self {
        let mut first = Self::independent(self.mean[..unknowns].to_vec(), &[]);
        for i in 0..unknowns {
            for j in 0..unknowns {
                first.covariance[(i, j)] = factor * self.covariance[(i, j)];
            }
        }
        first
    }

    pub(super) fn advanced(&self, step: &Step) -> Self {
        Self {
            mean: step.moved(&self.mean),
            covariance: step.advanced(&self.covariance),
        }
    }

    /// Misfit variance for a reading.
    pub(super) fn variance_of(&self, reading: &Reading) -> f64 {
        let [(a, from_a), (b, from_b)] = reading.parts;
        let of = |i, j| self.covariance[(i, j)];
        let shared = 2.0 * from_a * from_b * of(a, b);
        from_a * from_a * of(a, a) + shared + from_b * from_b * of(b, b) + reading.variance
    }

    /// Update by a reading.
    pub(super) fn correct(&mut self, reading: &Reading) {
        let total = self.variance_of(reading);
        let [(a, from_a), (b, from_b)] = reading.parts;
        // The covariance is symmetric.
        let spread: Vec<f64> = (self.covariance.row(a).iter().zip(self.covariance.row(b)))
            .map(|(a, b)| from_a * a + from_b * b)
            .collect();
        let rows = self.covariance.values.chunks_exact_mut(spread.len());
        for ((mean, row), spread_i) in self.mean.iter_mut().zip(rows).zip(&spread) {
            let gain = spread_i / total;
            *mean += gain * reading.misfit;
            for (value, spread_j) in row.iter_mut().zip(&spread) {
                *value -= gain * spread_j;
            }
        }
    }

    /// Smoothed state: `self` is the filtered state, `predicted` the prediction for the next tick, and `next` the smoothed state at the
    /// next tick. `None` if the prediction is singular.
    pub(super) fn smoothed(&self, step: &Step, predicted: &Self, next: &Self) -> Option<Self> {
        let size = self.mean.len();
        let factor = CholeskyFactor::of(predicted.covariance.values.clone(), size)?;
        // Row by row: the gain P F^T A^-1 is the transposed solution of A X = F P.
        let cross = step.times(&self.covariance).transposed();
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

/// Log likelihood for a sequence with times and numbers, each the first unknown with this error variance; without constants.
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
    let mut sum = 0.0;
    for &(time_s, number) in sequence {
        if time_s > last_s {
            known = known.advanced(&step(time_s - last_s));
            last_s = time_s;
        }
        let reading = Reading {
            misfit: number - known.mean[0],
            parts: [(0, 1.0), (0, 0.0)],
            variance,
        };
        let total = known.variance_of(&reading);
        // One outlier must not decide a fit.
        let surprise = (reading.misfit.powi(2) / total).min(CERTAIN_SD.powi(2));
        sum -= 0.5 * (total.ln() + surprise);
        known.correct(&reading);
    }
    sum
}

/// Row-major square matrix.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Matrix {
    pub(super) size: usize,
    pub(super) values: Vec<f64>,
}

impl Matrix {
    pub(super) fn zero(size: usize) -> Self {
        Self {
            size,
            values: vec![0.0; size * size],
        }
    }

    /// Sets a diagonal block that starts at `(at, at)`.
    pub(super) fn set_block<const N: usize>(&mut self, at: usize, block: &[[f64; N]; N]) {
        for (i, row) in block.iter().enumerate() {
            let start = (at + i) * self.size + at;
            self.values[start..start + N].copy_from_slice(row);
        }
    }

    pub(super) fn rows(&self) -> impl Iterator<Item = &[f64]> {
        self.values.chunks_exact(self.size)
    }

    pub(super) fn row(&self, number: usize) -> &[f64] {
        &self.values[number * self.size..(number + 1) * self.size]
    }

    pub(super) fn times_vector(&self, vector: &[f64]) -> Vec<f64> {
        self.rows().map(|row| dot(row, vector)).collect()
    }

    pub(super) fn times(&self, other: &Self) -> Self {
        let mut product = Self::zero(self.size);
        for (row, sums) in self.rows().zip(product.values.chunks_exact_mut(other.size)) {
            for (&factor, other_row) in row.iter().zip(other.rows()) {
                for (sum, value) in sums.iter_mut().zip(other_row) {
                    *sum += factor * value;
                }
            }
        }
        product
    }

    pub(super) fn transposed(&self) -> Self {
        let mut transposed = Self::zero(self.size);
        for i in 0..self.size {
            for j in 0..self.size {
                transposed[(j, i)] = self[(i, j)];
            }
        }
        transposed
    }

    /// `self + sign * other`.
    pub(super) fn plus(mut self, sign: f64, other: &Self) -> Self {
        for (value, other) in self.values.iter_mut().zip(&other.values) {
            *value += sign * other;
        }
        self
    }
}

impl Index<(usize, usize)> for Matrix {
    type Output = f64;

    fn index(&self, (row, column): (usize, usize)) -> &f64 {
        &self.values[row * self.size + column]
    }
}

impl IndexMut<(usize, usize)> for Matrix {
    fn index_mut(&mut self, (row, column): (usize, usize)) -> &mut f64 {
        &mut self.values[row * self.size + column]
    }
}
