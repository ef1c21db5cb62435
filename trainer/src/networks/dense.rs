//! Stacks of linear layers with LeakyReLU between: calibration networks, regression heads and the monoscopic baselines.
//!
//! Initial weights come from the caller's generator, not from burn's global one, so that a seed gives the same network whatever
//! else runs in the process.

use burn::module::{Module, Param};
use burn::nn::Linear;
use burn::tensor::activation::leaky_relu;
use burn::tensor::{Device, Tensor, TensorData};
use dataset::numbers::least_squares::CholeskyFactor;
use onnx_graph::Graph;
use onnx_graph::proto::AttributeProto;
use rand::RngExt;
use rand_chacha::ChaCha12Rng;

use crate::networks::encoded::numbers;

/// Slope of LeakyReLU below zero, as in PyTorch.
pub(crate) const LEAKY_SLOPE: f64 = 0.01;

/// Random linear layer: weights and biases are uniform within `+-gain / sqrt(inputs)` (PyTorch: gain 1).
pub(crate) fn linear(
    inputs: usize,
    outputs: usize,
    gain: f64,
    random: &mut ChaCha12Rng,
    device: &Device,
) -> Linear {
    let bound = (gain / (inputs as f64).sqrt()) as f32;
    let mut draw = |count: usize| {
        (0..count)
            .map(|_| random.random_range(-bound..=bound))
            .collect::<Vec<f32>>()
    };
    let weights = draw(inputs * outputs);
    linear_of(weights, draw(outputs), device)
}

/// Linear layer with weights in the order of the inputs, and a bias per output.
fn linear_of(weights: Vec<f32>, biases: Vec<f32>, device: &Device) -> Linear {
    let outputs = biases.len();
    let weights_of = [weights.len() / outputs, outputs];
    Linear {
        weight: Param::from_data(TensorData::new(weights, weights_of), device),
        bias: Some(Param::from_data(TensorData::new(biases, [outputs]), device)),
    }
}

/// Weights, biases and device, as in [`linear_of`].
fn numbers_of(layer: &Linear) -> (Vec<f32>, Vec<f32>, Device) {
    let bias = layer.bias.as_ref().expect("a layer has a bias");
    let device = layer.weight.device();
    let biases = numbers(bias.val().unsqueeze());
    (numbers(layer.weight.val()), biases, device)
}

/// Adds a linear layer to an ONNX graph.
pub(crate) fn linear_to_onnx(layer: &Linear, graph: &mut Graph, input: &str) -> String {
    let dims = layer.weight.dims().map(|length| length as i64);
    let weight = graph.floats(&dims, &numbers(layer.weight.val()));
    let product = graph.plain("MatMul", &[input, &weight]);
    match &layer.bias {
        None => product,
        Some(bias) => {
            let bias = numbers(bias.val().unsqueeze());
            let bias = graph.floats(&[bias.len() as i64], &bias);
            graph.plain("Add", &[&product, &bias])
        }
    }
}

/// Linear layers with LeakyReLU between them and none after the last.
#[derive(Module, Debug)]
pub(crate) struct Dense {
    layers: Vec<Linear>,
}

impl Dense {
    /// `widths` begins with the input's width and has at least two entries.
    pub(crate) fn new(widths: &[usize], random: &mut ChaCha12Rng, device: &Device) -> Self {
        Self {
            layers: widths
                .windows(2)
                .map(|pair| linear(pair[0], pair[1], 1.0, random, device))
                .collect(),
        }
    }

    /// `[batch, first width]` to `[batch, last width]`.
    pub(crate) fn forward(&self, input: Tensor<2>) -> Tensor<2> {
        let hidden = self.hidden(input);
        self.last().forward(hidden)
    }

    /// Input of the last layer, `[batch, last width but one]`.
    pub(crate) fn hidden(&self, input: Tensor<2>) -> Tensor<2> {
        let before_last = &self.layers[..self.layers.len() - 1];
        before_last.iter().fold(input, |value, layer| {
            leaky_relu(layer.forward(value), LEAKY_SLOPE)
        })
    }

    /// [`Dense::forward`] as an ONNX graph.
    pub(crate) fn to_onnx(&self, graph: &mut Graph, input: &str) -> String {
        let before_last = &self.layers[..self.layers.len() - 1];
        let hidden = before_last.iter().fold(input.to_owned(), |value, layer| {
            let value = linear_to_onnx(layer, graph, &value);
            let slope = AttributeProto::float("alpha", LEAKY_SLOPE as f32);
            graph.node("LeakyRelu", &[&value], vec![slope])
        });
        linear_to_onnx(self.last(), graph, &hidden)
    }

    /// Subtracts `means` from the outputs and whitens them, within the last layer.
    pub(crate) fn with_white_outputs(mut self, means: &[f64], factor: &CholeskyFactor) -> Self {
        let last = self.layers.pop().expect("a stack has a layer");
        let (weights, mut biases, device) = numbers_of(&last);
        let white = |row: &mut [f64]| {
            factor.whiten(row);
            row.iter().map(|&value| value as f32).collect::<Vec<_>>()
        };
        let weights = (weights.chunks_exact(means.len()))
            .flat_map(|row| white(&mut row.iter().map(|&w| f64::from(w)).collect::<Vec<_>>()));
        let weights = weights.collect();
        let centred = biases.iter().zip(means);
        let mut centred: Vec<_> = centred
            .map(|(&bias, mean)| f64::from(bias) - mean)
            .collect();
        biases = white(&mut centred);
        self.layers.push(linear_of(weights, biases, &device));
        self
    }

    /// Counterpart of [`Dense::with_white_outputs`]: same outputs from whitened inputs.
    pub(crate) fn with_white_inputs(mut self, means: &[f64], factor: &CholeskyFactor) -> Self {
        let (weights, mut biases, device) = numbers_of(&self.layers[0]);
        let outputs = biases.len();
        for (of_input, mean) in weights.chunks_exact(outputs).zip(means) {
            for (weight, bias) in of_input.iter().zip(&mut biases) {
                *bias += *mean as f32 * weight;
            }
        }
        let coloured = |(input, output): (usize, usize)| {
            let row = factor.row(input).iter().zip(input..);
            let products = row.map(|(r, of)| r * f64::from(weights[of * outputs + output]));
            products.sum::<f64>() as f32
        };
        let places = (0..means.len()).flat_map(|input| (0..outputs).map(move |o| (input, o)));
        let weights = places.map(coloured).collect();
        self.layers[0] = linear_of(weights, biases, &device);
        self
    }

    fn last(&self) -> &Linear {
        self.layers.last().expect("a stack has a layer")
    }
}

/// Widths from input to output.
pub(crate) fn widths(input: usize, hidden: &[usize], output: usize) -> Vec<usize> {
    std::iter::once(input)
        .chain(hidden.iter().copied())
        .chain([output])
        .collect()
}
