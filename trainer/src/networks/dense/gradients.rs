//! Gradients of stacks of linear layers, by hand, for some rows of a batch.
//!
//! Bias and LeakyReLU are one pass over the rows, where autodiff keeps a tensor for each of half a dozen operations. Layers must be without
//! autodiff.

use burn::nn::Linear;
use burn::optim::GradientsParams;
use burn::tensor::{Tensor, TensorData};

use super::{Dense, LEAKY_SLOPE};
use crate::networks::encoded::numbers;

/// Values of the forward pass that the backward pass needs.
pub(crate) struct DenseTrace<'a> {
    dense: &'a Dense,
    /// Of each layer, `[rows, inputs]`.
    inputs: Vec<Tensor<2>>,
}

/// Sums over rows of what the weights of a layer change.
pub(crate) struct LinearGradients {
    weight: Tensor<2>,
    /// `[1, outputs]`.
    bias: Tensor<2>,
}

impl Dense {
    /// The same as [`Dense::forward`], and what gradients need.
    pub(crate) fn trace(&self, input: Tensor<2>) -> (Tensor<2>, DenseTrace<'_>) {
        let last = self.layers.len() - 1;
        let mut inputs = Vec::with_capacity(self.layers.len());
        let output = (self.layers.iter().enumerate()).fold(input, |value, (number, layer)| {
            let product = value.clone().matmul(layer.weight.val());
            inputs.push(value);
            let slope = if number == last { 1.0 } else { LEAKY_SLOPE };
            with_bias(product, layer, slope as f32)
        });
        let dense = self;
        (output, DenseTrace { dense, inputs })
    }

    /// Gives the weights these gradients, one for each layer.
    pub(crate) fn register(&self, gradients: Vec<LinearGradients>, into: &mut GradientsParams) {
        for (layer, gradients) in self.layers.iter().zip(gradients) {
            gradients.register(layer, into);
        }
    }
}

impl DenseTrace<'_> {
    /// Gradients of each layer, and of the input, for this gradient of the output.
    pub(crate) fn back(self, output: Tensor<2>) -> (Vec<LinearGradients>, Tensor<2>) {
        let mut of_layers = Vec::with_capacity(self.inputs.len());
        let mut gradient = output;
        let layers = self.dense.layers.iter().zip(self.inputs).enumerate();
        for (number, (layer, input)) in layers.rev() {
            of_layers.push(LinearGradients::of(&input, &gradient));
            gradient = gradient.matmul(layer.weight.val().transpose());
            if number > 0 {
                gradient = before_activation(gradient, input);
            }
        }
        of_layers.reverse();
        (of_layers, gradient)
    }
}

impl LinearGradients {
    /// Of a layer, from its input and the gradient of its output.
    pub(crate) fn of(input: &Tensor<2>, output: &Tensor<2>) -> Self {
        Self {
            weight: input.clone().transpose().matmul(output.clone()),
            bias: output.clone().sum_dim(0),
        }
    }

    pub(crate) fn plus(self, other: Self) -> Self {
        Self {
            weight: self.weight + other.weight,
            bias: self.bias + other.bias,
        }
    }

    pub(crate) fn register(self, layer: &Linear, into: &mut GradientsParams) {
        into.register(layer.weight.id, self.weight);
        if let Some(bias) = &layer.bias {
            let outputs = self.bias.dims()[1];
            into.register(bias.id, self.bias.reshape([outputs]));
        }
    }
}

/// Adds the bias of a layer to its product, and multiplies what is below zero by the slope.
fn with_bias(product: Tensor<2>, layer: &Linear, slope: f32) -> Tensor<2> {
    let (dims, device) = (product.dims(), product.device());
    let bias = layer.bias.as_ref();
    let bias = bias.map_or_else(
        || vec![0.0; dims[1]],
        |bias| numbers(bias.val().unsqueeze()),
    );
    let mut values = numbers(product);
    for row in values.chunks_exact_mut(dims[1]) {
        for (value, bias) in row.iter_mut().zip(&bias) {
            let sum = *value + bias;
            *value = if sum < 0.0 { slope * sum } else { sum };
        }
    }
    Tensor::from_data(TensorData::new(values, dims), &device)
}

/// Gradient of a LeakyReLU's input, from the gradient of its output and the output.
fn before_activation(gradient: Tensor<2>, activated: Tensor<2>) -> Tensor<2> {
    let (dims, device) = (gradient.dims(), gradient.device());
    let mut values = numbers(gradient);
    for (value, activated) in values.iter_mut().zip(numbers(activated)) {
        *value *= if activated < 0.0 {
            LEAKY_SLOPE as f32
        } else {
            1.0
        };
    }
    Tensor::from_data(TensorData::new(values, dims), &device)
}
