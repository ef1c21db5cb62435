//! Weighted linear least squares with a few unknowns, by their normal equations, and robust ones, in which outliers count less.

use crate::numbers::spread::deviation_from_zero;

/// A pivot below this part of the diagonal element is pure rounding error: the unknown follows from the others.
const SINGULAR: f64 = 1e-14;
/// Residual with half the maximum weight in a robust fit, in standard deviations.
pub const HALF_WEIGHT: f64 = 2.0;

/// The normal equations of `value = row . unknowns`, filled row by row.
#[derive(Debug, Clone)]
pub struct NormalEquations {
    /// Row-major and symmetric; only the upper triangle is filled.
    matrix: Vec<f64>,
    right: Vec<f64>,
}

impl NormalEquations {
    /// For this many unknowns, without any row.
    pub fn new(unknowns: usize) -> Self {
        Self {
            matrix: vec![0.0; unknowns * unknowns],
            right: vec![0.0; unknowns],
        }
    }

    /// Adds an equation; `row` has a number for each unknown.
    #[inline]
    pub fn add(&mut self, row: &[f64], value: f64, weight: f64) {
        // Loops over a row of fixed length are unrolled; loops over lines of the matrix would take twice as long.
        let unknowns = row.len();
        let matrix = &mut self.matrix[..unknowns * unknowns];
        let right = &mut self.right[..unknowns];
        for (j, a) in row.iter().enumerate() {
            let weighted = weight * a;
            right[j] += weighted * value;
            for (i, b) in row.iter().enumerate().take(j + 1) {
                matrix[i * unknowns + j] += weighted * b;
            }
        }
    }

    /// Adds knowledge of all unknowns: their values, with an information matrix.
    pub fn add_information<const N: usize>(
        &mut self,
        information: &[[f64; N]; N],
        values: &[f64; N],
    ) {
        for (sum, part) in self.matrix.iter_mut().zip(information.as_flattened()) {
            *sum += part;
        }
        for (right, row) in self.right.iter_mut().zip(information) {
            *right += dot(row, values);
        }
    }

    /// Adds a ridge, which keeps the unknowns small where the rows do not determine them.
    pub fn add_to_diagonal(&mut self, ridge: f64) {
        let unknowns = self.right.len();
        for element in self.matrix.iter_mut().step_by(unknowns + 1) {
            *element += ridge;
        }
    }

    /// The unknowns with the least sum of weighted squares; `None` if the rows do not determine them, or are not finite.
    pub fn solve(&self) -> Option<Vec<f64>> {
        let factor = CholeskyFactor::of(self.matrix.clone(), self.right.len())?;
        factor.solve(self.right.clone())
    }

    /// Like [`Self::solve`] for a known number of unknowns.
    pub fn solve_for<const N: usize>(&self) -> Option<[f64; N]> {
        self.solve()?.try_into().ok()
    }

    /// The inverse of the matrix, row by row: the covariance of the unknowns, but for the variance of the values.
    pub fn inverse(&self) -> Option<Vec<Vec<f64>>> {
        let unknowns = self.right.len();
        let factor = CholeskyFactor::of(self.matrix.clone(), unknowns)?;
        // Row for column: the inverse is symmetric like the matrix.
        let row = |k: usize| {
            let mut unit = vec![0.0; unknowns];
            unit[k] = 1.0;
            factor.solve(unit)
        };
        (0..unknowns).map(row).collect()
    }

    /// Like [`Self::inverse`] for a known number of unknowns.
    pub fn inverse_for<const N: usize>(&self) -> Option<[[f64; N]; N]> {
        let inverse = self.inverse()?;
        (inverse.len() == N)
            .then(|| std::array::from_fn(|i| std::array::from_fn(|j| inverse[i][j])))
    }
}

/// A point of a robust fit: a row with a number for each unknown, the value, and the scale of its error.
pub type Point<R> = (R, f64, f64);

/// Result of [`robust_fit`].
#[derive(Debug, Clone)]
pub struct RobustFit {
    /// Unknowns of `value = row . unknowns`.
    pub unknowns: Vec<f64>,
    /// Scaled residual of each point.
    pub residuals: Vec<f64>,
    /// Standard deviation of the scaled residuals, at least a minimum.
    pub deviation: f64,
    equations: NormalEquations,
}

impl RobustFit {
    /// Covariance of the unknowns for scaled residuals with a deviation of 1, row by row.
    pub fn covariance(&self) -> Option<Vec<Vec<f64>>> {
        self.equations.inverse()
    }

    /// Sum of the losses of all points, each in squares of its scale (Cauchy).
    pub fn loss(&self) -> f64 {
        let of = |residual: &f64| HALF_WEIGHT.powi(2) * (residual / HALF_WEIGHT).powi(2).ln_1p();
        self.residuals.iter().map(of).sum()
    }
}

/// Least squares in which a residual of two deviations gets half the weight (Cauchy), reweighted for some rounds. `prior`: the information
/// that an unknown is 0, by its index and the sum of the points' weights. `None` if points and prior do not determine all unknowns, or if
/// a number is not finite.
pub fn robust_fit<R: AsRef<[f64]>>(
    points: &[Point<R>],
    prior: impl Fn(usize, f64) -> f64,
    min_deviation: f64,
    rounds: usize,
) -> Option<RobustFit> {
    let unknowns = points.first()?.0.as_ref().len();
    let mut weights = vec![1.0; points.len()];
    let mut fitted = None;
    for _ in 0..rounds {
        let mut equations = NormalEquations::new(unknowns);
        let mut sum = 0.0;
        for ((row, value, scale), weight) in points.iter().zip(&weights) {
            let weight = weight / (scale * scale);
            equations.add(row.as_ref(), *value, weight);
            sum += weight;
        }
        for unknown in 0..unknowns {
            equations.matrix[unknown * (unknowns + 1)] += prior(unknown, sum);
        }
        let unknowns = equations.solve()?;
        let residual =
            |(row, value, scale): &Point<R>| (value - dot(row.as_ref(), &unknowns)) / scale;
        let residuals: Vec<f64> = points.iter().map(residual).collect();
        let deviation = deviation_from_zero(residuals.iter().copied()).max(min_deviation);
        for (weight, residual) in weights.iter_mut().zip(&residuals) {
            *weight = (1.0 + (residual / (HALF_WEIGHT * deviation)).powi(2)).recip();
        }
        fitted = Some(RobustFit {
            unknowns,
            residuals,
            deviation,
            equations,
        });
    }
    fitted
}

/// Scalar product.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Inverse of a symmetric matrix; `None` if it is not positive definite.
pub fn inverse<const N: usize>(matrix: &[[f64; N]; N]) -> Option<[[f64; N]; N]> {
    let mut equations = NormalEquations::new(N);
    equations.add_information(matrix, &[0.0; N]);
    equations.inverse_for()
}

/// Cholesky's factor R of the matrix `R^T R`, in its upper triangle.
#[derive(Debug, Clone)]
pub struct CholeskyFactor {
    matrix: Vec<f64>,
    unknowns: usize,
}

impl CholeskyFactor {
    /// Factorises a symmetric matrix, given row by row; only the upper triangle is read; `None` if it is not positive definite.
    pub fn of(mut matrix: Vec<f64>, unknowns: usize) -> Option<Self> {
        let n = unknowns;
        for i in 0..n {
            let diagonal = matrix[i * n + i];
            for k in 0..i {
                let factor = matrix[k * n + i];
                for j in i..n {
                    matrix[i * n + j] -= factor * matrix[k * n + j];
                }
            }
            let pivot = matrix[i * n + i];
            if !(pivot.is_finite() && pivot > SINGULAR * diagonal) {
                return None;
            }
            let scale = pivot.sqrt().recip();
            for value in &mut matrix[i * n + i..(i + 1) * n] {
                *value *= scale;
            }
        }
        Some(Self { matrix, unknowns })
    }

    /// Replaces `x` by the vector that `R^T` takes to it. If the matrix is the covariance of `x`, its elements become independent, with
    /// variances of 1.
    pub fn whiten(&self, x: &mut [f64]) {
        let n = self.unknowns;
        for i in 0..n {
            let known: f64 = (0..i).map(|k| self.matrix[k * n + i] * x[k]).sum();
            x[i] = (x[i] - known) / self.matrix[i * n + i];
        }
    }

    /// A row of R, from its diagonal element on.
    pub fn row(&self, i: usize) -> &[f64] {
        &self.matrix[i * self.unknowns + i..(i + 1) * self.unknowns]
    }

    /// The vector that the matrix takes to `x`; `None` if it is not finite.
    pub fn solve(&self, mut x: Vec<f64>) -> Option<Vec<f64>> {
        let n = self.unknowns;
        self.whiten(&mut x);
        for i in (0..n).rev() {
            let known: f64 = (i + 1..n).map(|k| self.matrix[i * n + k] * x[k]).sum();
            x[i] = (x[i] - known) / self.matrix[i * n + i];
        }
        x.iter().all(|value| value.is_finite()).then_some(x)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_linear_law_is_found_and_weights_of_zero_do_not_count() {
        let mut normal = NormalEquations::new(3);
        for (a, b, weight) in [
            (1.0, 2.0, 1.0),
            (-1.0, 0.5, 1.0),
            (3.0, -2.0, 2.0),
            (0.0, 1.0, 0.5),
        ] {
            normal.add(&[a, b, 1.0], 3.0 * a - 2.0 * b + 0.5, weight);
        }
        normal.add(&[9.0, 9.0, 1.0], 1e6, 0.0);
        let found = normal.solve_for::<3>().unwrap();
        for (found, expected) in found.iter().zip([3.0, -2.0, 0.5]) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
        assert_eq!(normal.solve_for::<2>(), None, "another number of unknowns");
    }

    #[test]
    fn what_the_rows_do_not_determine_has_no_solution_without_a_ridge() {
        let mut normal = NormalEquations::new(2);
        assert_eq!(normal.solve(), None, "no rows");
        for x in [1.0, 2.0, 0.3] {
            normal.add(&[x, 3.0 * x], x, 1.0);
        }
        assert_eq!(normal.solve(), None, "one unknown is three times the other");
        normal.add_to_diagonal(1e-9);
        let [a, b] = normal.solve_for().unwrap();
        assert!((a + 3.0 * b - 1.0).abs() < 1e-6, "{a} {b}");
        normal.add(&[f64::NAN, 1.0], 1.0, 1.0);
        assert_eq!(normal.solve(), None, "no number");
    }

    #[test]
    fn outliers_do_not_bend_a_robust_line() {
        let points: Vec<_> = (0..20)
            .map(|step| {
                let x = f64::from(step) / 10.0;
                let off = if step % 5 == 3 {
                    50.0
                } else {
                    0.01 * (f64::from(step) * 2.4).sin()
                };
                ([1.0, x], 2.0 - 3.0 * x + off, 1.0)
            })
            .collect();
        let fit = robust_fit(&points, |_, _| 0.0, 1e-3, 30).unwrap();
        let (found, deviation) = (&fit.unknowns, fit.deviation);
        assert!(
            (found[0] - 2.0).abs() < 0.02 && (found[1] + 3.0).abs() < 0.02,
            "{found:?}"
        );
        assert!((0.005..0.02).contains(&deviation), "{deviation}");
        let alone = [points[0]; 3];
        assert!(robust_fit(&alone, |_, _| 0.0, 1e-3, 30).is_none());
        let of_slope = |unknown, sum| if unknown == 1 { 1e-4 * sum } else { 0.0 };
        let flat = robust_fit(&alone, of_slope, 1e-3, 30).unwrap().unknowns;
        assert!(flat[1].abs() < 1e-6, "{flat:?}");
    }

    #[test]
    fn the_inverse_is_that_of_the_sums_of_products() {
        let mut normal = NormalEquations::new(2);
        normal.add(&[1.0, 0.0], 0.0, 2.0);
        normal.add(&[0.0, 2.0], 0.0, 1.0);
        let inverse = normal.inverse().unwrap();
        for (found, expected) in inverse.concat().iter().zip([0.5, 0.0, 0.0, 0.25]) {
            assert!((found - expected).abs() < 1e-15, "{inverse:?}");
        }
    }
}
