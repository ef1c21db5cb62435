//! Weighted linear least squares with a few unknowns, by their normal equations.

/// A pivot below this part of the diagonal element is pure rounding error: the unknown follows from the others.
const SINGULAR: f64 = 1e-14;

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
        let unknowns = self.right.len();
        let lines = self.matrix.chunks_exact_mut(unknowns.max(1));
        for (i, ((line, right), &a)) in lines.zip(&mut self.right).zip(row).enumerate() {
            let weighted = weight * a;
            *right += weighted * value;
            for (sum, &b) in line[i..].iter_mut().zip(&row[i..]) {
                *sum += weighted * b;
            }
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

    /// The vector that the matrix takes to `x`; `None` if it is not finite.
    pub fn solve(&self, mut x: Vec<f64>) -> Option<Vec<f64>> {
        let n = self.unknowns;
        for i in 0..n {
            let known: f64 = (0..i).map(|k| self.matrix[k * n + i] * x[k]).sum();
            x[i] = (x[i] - known) / self.matrix[i * n + i];
        }
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
