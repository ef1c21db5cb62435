//! Weighted least squares with a few unknowns.

/// Solves `a x = b` by elimination with pivots; `None` if `a` is singular.
pub fn solve<const N: usize>(mut a: [[f64; N]; N], mut b: [f64; N]) -> Option<[f64; N]> {
    let largest = a
        .iter()
        .flatten()
        .fold(0.0_f64, |most, v| most.max(v.abs()));
    for column in 0..N {
        let largest_below =
            (column..N).max_by(|i, j| a[*i][column].abs().total_cmp(&a[*j][column].abs()))?;
        a.swap(column, largest_below);
        b.swap(column, largest_below);
        let pivot = a[column];
        let lead = pivot[column];
        if !lead.is_finite() || lead.abs() <= 1e-14 * largest {
            return None;
        }
        for row in column + 1..N {
            let factor = a[row][column] / lead;
            for (value, above) in a[row].iter_mut().zip(pivot).skip(column) {
                *value -= factor * above;
            }
            b[row] -= factor * b[column];
        }
    }
    for row in (0..N).rev() {
        let known: f64 = (row + 1..N).map(|k| a[row][k] * b[k]).sum();
        b[row] = (b[row] - known) / a[row][row];
    }
    Some(b)
}

/// Inverse of symmetric matrices; `None` if it is singular.
pub fn inverse<const N: usize>(a: [[f64; N]; N]) -> Option<[[f64; N]; N]> {
    let mut inverse = [[0.0; N]; N];
    for (k, row) in inverse.iter_mut().enumerate() {
        let mut unit = [0.0; N];
        unit[k] = 1.0;
        // Row for column: the inverse is symmetric like the matrix.
        *row = solve(a, unit)?;
    }
    Some(inverse)
}

/// Normal equations of weighted least squares, filled row by row.
#[derive(Debug, Clone, Copy)]
pub struct Normal<const N: usize> {
    /// Sum of `w j j^T`, up to the diagonal.
    lower: [[f64; N]; N],
    /// Sum of `w j r`.
    right: [f64; N],
}

impl<const N: usize> Default for Normal<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Normal<N> {
    /// No equation yet.
    pub fn new() -> Self {
        Self {
            lower: [[0.0; N]; N],
            right: [0.0; N],
        }
    }

    /// Adds the equation `row . unknowns = value`.
    pub fn add(&mut self, row: &[f64; N], value: f64, weight: f64) {
        for (i, a) in row.iter().enumerate() {
            let weighted = weight * a;
            for (j, b) in row.iter().enumerate().take(i + 1) {
                self.lower[i][j] += weighted * b;
            }
            self.right[i] += weighted * value;
        }
    }

    /// Adds knowledge of all unknowns: their values, with an information matrix.
    pub fn add_information(&mut self, information: &[[f64; N]; N], values: &[f64; N]) {
        for (i, row) in information.iter().enumerate() {
            for (j, part) in row.iter().enumerate() {
                if j <= i {
                    self.lower[i][j] += part;
                }
                self.right[i] += part * values[j];
            }
        }
    }

    /// Sum of `w j j^T`.
    pub fn matrix(&self) -> [[f64; N]; N] {
        std::array::from_fn(|i| std::array::from_fn(|j| self.lower[i.max(j)][i.min(j)]))
    }

    /// The unknowns; `None` if the equations do not determine them.
    pub fn solve(&self) -> Option<[f64; N]> {
        solve(self.matrix(), self.right)
    }

    /// The covariance of the solution for weights that are inverse variances.
    pub fn inverse(&self) -> Option<[[f64; N]; N]> {
        inverse(self.matrix())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_system_is_solved_and_a_singular_one_is_not() {
        let a = [[0.0, 2.0, 1.0], [1.0, 1.0, 0.0], [3.0, 0.0, 1.0]];
        let x = solve(a, [7.0, 3.0, 6.0]).unwrap();
        for (found, expected) in x.iter().zip([1.0, 2.0, 3.0]) {
            assert!((found - expected).abs() < 1e-12, "{x:?}");
        }
        assert_eq!(solve([[1.0, 2.0], [2.0, 4.0]], [1.0, 2.0]), None);
        assert_eq!(
            inverse([[2.0, 0.0], [0.0, 4.0]]),
            Some([[0.5, 0.0], [0.0, 0.25]])
        );
    }
}
