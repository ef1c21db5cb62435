//! The last linear layer in closed form.
//!
//! Once everything before it is fixed, the last layer of a regression is a least-squares problem with one solution. Gradient
//! descent approaches it only slowly, because the hidden values are strongly correlated; the closed form removes the remaining
//! error in a fraction of a second.

use burn::module::Param;
use burn::nn::Linear;
use burn::tensor::{Device, TensorData};
use dataset::numbers::least_squares::NormalEquations;

/// Strength of the ridge, relative to the mean square of the hidden values: enough to keep the solution small if they are redundant, small
/// enough not to affect the result.
const RIDGE: f64 = 1e-9;

/// Accumulates the normal equations of `target = weights . hidden + bias`.
pub(crate) struct HeadRefit {
    inputs: usize,
    normal: NormalEquations,
}

impl HeadRefit {
    /// For a layer with this many inputs.
    pub(crate) fn new(inputs: usize) -> Self {
        Self {
            inputs,
            // Hidden values and the constant 1 of the bias.
            normal: NormalEquations::new(inputs + 1),
        }
    }

    /// Adds samples: `hidden` is row-major with as many values a row as the layer has inputs.
    pub(crate) fn add(&mut self, hidden: &[f32], targets: &[f32], weights: &[f32]) {
        let mut row = vec![1.0; self.inputs + 1];
        let samples = hidden.chunks_exact(self.inputs).zip(targets).zip(weights);
        for ((values, &target), &weight) in samples {
            for (to, &value) in row.iter_mut().zip(values) {
                *to = f64::from(value);
            }
            self.normal.add(&row, f64::from(target), f64::from(weight));
        }
    }

    /// The layer that solves them; `None` if there is no solution (no samples, or values that are not finite).
    pub(crate) fn solve(mut self, device: &Device) -> Option<Linear> {
        self.normal
            .add_to_diagonal(RIDGE * self.normal.mean_diagonal());
        let solution = self.normal.solve()?;
        let values: Vec<f32> = solution.iter().map(|&value| value as f32).collect();
        let (weight, bias) = values.split_at(self.inputs);
        Some(Linear {
            weight: Param::from_data(TensorData::new(weight.to_vec(), [self.inputs, 1]), device),
            bias: Some(Param::from_data(
                TensorData::new(bias.to_vec(), [1]),
                device,
            )),
        })
    }
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
