//! The last linear layer in closed form.
//!
//! Once everything before it is fixed, the last layer of a regression is a least-squares problem with one solution. Gradient
//! descent approaches it only slowly, because the hidden values are strongly correlated; the closed form removes the remaining
//! error in a fraction of a second.

use burn::module::Param;
use burn::nn::Linear;
use burn::tensor::{Device, TensorData};

/// Strength of the ridge, relative to the mean square of the hidden values: enough to keep the solution small where they are
/// redundant, too little to affect the result.
const RIDGE: f64 = 1e-9;

/// Accumulates the normal equations of `target = weights . hidden + bias`.
pub(crate) struct HeadRefit {
    /// Hidden values and the constant 1 of the bias.
    width: usize,
    /// Row-major, symmetric; the upper triangle is stored.
    normal: Vec<f64>,
    right: Vec<f64>,
}

impl HeadRefit {
    /// For a layer with this many inputs.
    pub(crate) fn new(inputs: usize) -> Self {
        let width = inputs + 1;
        Self {
            width,
            normal: vec![0.0; width * width],
            right: vec![0.0; width],
        }
    }

    /// Adds samples: `hidden` is row-major with as many values a row as the layer has inputs.
    pub(crate) fn add(&mut self, hidden: &[f32], targets: &[f32], weights: &[f32]) {
        let inputs = self.width - 1;
        let mut row = vec![1.0; self.width];
        for ((values, &target), &weight) in hidden.chunks_exact(inputs).zip(targets).zip(weights) {
            for (to, &value) in row.iter_mut().zip(values) {
                *to = f64::from(value);
            }
            for i in 0..self.width {
                let weighted = row[i] * f64::from(weight);
                self.right[i] += weighted * f64::from(target);
                let line = &mut self.normal[i * self.width..(i + 1) * self.width];
                for (sum, value) in line[i..].iter_mut().zip(&row[i..]) {
                    *sum += weighted * value;
                }
            }
        }
    }

    /// The layer that solves them; `None` if there is no solution (no samples, or values that are not finite).
    pub(crate) fn solve(mut self, device: &Device) -> Option<Linear> {
        let width = self.width;
        let mean_square =
            (0..width).map(|i| self.normal[i * width + i]).sum::<f64>() / width as f64;
        for i in 0..width {
            self.normal[i * width + i] += RIDGE * mean_square;
        }
        let solution = solve_symmetric(&mut self.normal, &self.right)?;
        let values: Vec<f32> = solution.iter().map(|&value| value as f32).collect();
        let (weight, bias) = values.split_at(width - 1);
        Some(Linear {
            weight: Param::from_data(TensorData::new(weight.to_vec(), [width - 1, 1]), device),
            bias: Some(Param::from_data(
                TensorData::new(bias.to_vec(), [1]),
                device,
            )),
        })
    }
}

/// Solves `matrix x = right` by Cholesky decomposition `R^T R` of the upper triangle; `None` if the matrix is not positive definite.
fn solve_symmetric(matrix: &mut [f64], right: &[f64]) -> Option<Vec<f64>> {
    let n = right.len();
    for i in 0..n {
        for k in 0..i {
            let factor = matrix[k * n + i];
            for j in i..n {
                matrix[i * n + j] -= factor * matrix[k * n + j];
            }
        }
        let pivot = matrix[i * n + i];
        if !(pivot.is_finite() && pivot > 0.0) {
            return None;
        }
        let scale = pivot.sqrt().recip();
        for value in &mut matrix[i * n + i..(i + 1) * n] {
            *value *= scale;
        }
    }
    let mut x = right.to_vec();
    for i in 0..n {
        let known: f64 = (0..i).map(|k| matrix[k * n + i] * x[k]).sum();
        x[i] = (x[i] - known) / matrix[i * n + i];
    }
    for i in (0..n).rev() {
        let known: f64 = (i + 1..n).map(|k| matrix[i * n + k] * x[k]).sum();
        x[i] = (x[i] - known) / matrix[i * n + i];
    }
    x.iter().all(|value| value.is_finite()).then_some(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_linear_law_is_found_and_weights_of_zero_do_not_count() {
        let device = Device::flex();
        let mut refit = HeadRefit::new(2);
        let hidden = [1.0, 2.0, -1.0, 0.5, 3.0, -2.0, 0.0, 1.0, 9.0, 9.0];
        // 3 a - 2 b + 0.5, and a last row that is far off but has no weight.
        let targets = [-0.5, -3.5, 13.5, -1.5, 1e6];
        refit.add(&hidden, &targets, &[1.0, 1.0, 2.0, 0.5, 0.0]);
        let layer = refit.solve(&device).unwrap();
        let weight: Vec<f32> = layer.weight.val().into_data().try_into_vec().unwrap();
        let bias: Vec<f32> = layer
            .bias
            .unwrap()
            .val()
            .into_data()
            .try_into_vec()
            .unwrap();
        for (found, expected) in weight.iter().chain(&bias).zip([3.0, -2.0, 0.5]) {
            assert!((found - expected).abs() < 1e-4, "{weight:?} {bias:?}");
        }
    }

    #[test]
    fn without_samples_there_is_no_solution() {
        assert!(HeadRefit::new(2).solve(&Device::flex()).is_none());
    }
}
