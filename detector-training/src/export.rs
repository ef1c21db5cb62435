//! Exports the trained network as an ONNX model that any runtime can run.
//!
//! Input: a network. Output: bytes of a model with
//! - input `images` `[batch, 3, height, width]`: RGB, 0 to 1, both sides any multiple of 32;
//! - output `output` `[batch, cells, 6]`: one row per cell of 8x8 px: centre right, centre down, width, height (pixels of the input,
//!   pixel (0, 0) is the centre of the top-left pixel), objectness 0 to 1, and 1 where the cell is a peak of its neighbourhood,
//!   else 0 (so that objectness times class, as readers of YOLO outputs compute it, is a score that needs almost no suppression).
//!
//! The decoding of `grid` is part of the graph.

use burn::tensor::Tensor;
use onnx_graph::proto::{AttributeProto, Dimension, FLOAT, ModelProto, ValueInfoProto};
use onnx_graph::{Graph, ModelTexts};

use super::grid::{ANCHOR_PX, MAX_LOG_SIZE, MAX_LOGIT, NEIGHBOURHOOD, STRIDE_PX, cell_center_px};
use super::network::convolution::Convolution;
use super::network::patches::PATCH_SIDE_PX;
use super::network::{NORMALISATION_FLOOR, Network};

/// Bytes of the ONNX model.
pub(crate) fn onnx_bytes(network: &Network) -> Vec<u8> {
    model(network).bytes()
}

/// The ONNX model.
pub fn model(network: &Network) -> ModelProto {
    let mut graph = Layers::default();
    let map = graph.stem(network);
    let map = graph.rectified(&network.down_8, &map);
    let fine = graph.normalised(&network.at_8, &network.strength_8, &map);
    let map = graph.rectified(&network.down_16, &fine);
    let middle = graph.normalised(&network.at_16, &network.strength_16, &map);
    let map = graph.rectified(&network.down_32, &middle);
    let mut coarse = graph.normalised(&network.at_32[0], &network.strength_32, &map);
    for layer in &network.at_32[1..] {
        coarse = graph.rectified(layer, &coarse);
    }
    let middle = graph.upsampled_onto(&network.lateral_16, &coarse, &middle);
    let middle = graph.rectified(&network.neck_16, &middle);
    let fine = graph.upsampled_onto(&network.lateral_8, &middle, &fine);
    let fine = graph.rectified(&network.neck_8, &fine);
    let raw = graph.convolution(&network.head, &fine);
    graph.decode(&raw);
    graph.into_model()
}

/// The graph of the detector, layer by layer.
#[derive(Default)]
struct Layers {
    graph: Graph,
}

impl Layers {
    fn stem(&mut self, network: &Network) -> String {
        let side = PATCH_SIDE_PX as i64;
        let weight = self.kernel(network.stem_weight(), PATCH_SIDE_PX);
        let bias = self.vector(network.stem_bias.val());
        let attributes = vec![
            AttributeProto::ints("kernel_shape", &[side, side]),
            AttributeProto::ints("strides", &[side, side]),
        ];
        let inputs = ["images", &weight, &bias];
        let map = self.graph.node("Conv", &inputs, attributes);
        self.graph.plain("Relu", &[&map])
    }

    fn convolution(&mut self, layer: &Convolution, map: &str) -> String {
        let (side, stride) = (layer.kernel as i64, layer.stride as i64);
        let weight = self.kernel(layer.weight.val(), layer.kernel);
        let bias = self.vector(layer.bias.val());
        let attributes = vec![
            AttributeProto::ints("kernel_shape", &[side, side]),
            AttributeProto::ints("strides", &[stride, stride]),
            AttributeProto::ints("pads", &[side / 2; 4]),
        ];
        self.graph.node("Conv", &[map, &weight, &bias], attributes)
    }

    fn rectified(&mut self, layer: &Convolution, map: &str) -> String {
        let map = self.convolution(layer, map);
        self.graph.plain("Relu", &[&map])
    }

    /// A layer over a map `[.., channels, ..]` divided by its mean, plus one over the logarithm of that mean.
    fn normalised(&mut self, layer: &Convolution, of_strength: &Convolution, map: &str) -> String {
        let channels = layer.weight.dims()[0] / layer.kernel.pow(2);
        // The mean over channels as a 1x1 convolution, with the floor as its bias: ONNX Runtime keeps its blocked layout then.
        let shares = vec![1.0 / channels as f32; channels];
        let weight = self.graph.floats(&[1, channels as i64, 1, 1], &shares);
        let floor = self.graph.floats(&[1], &[NORMALISATION_FLOOR]);
        let attributes = vec![AttributeProto::ints("kernel_shape", &[1, 1])];
        let mean = (self.graph).node("Conv", &[map, &weight, &floor], attributes);
        let shape = self.graph.plain("Div", &[map, &mean]);
        let shape = self.convolution(layer, &shape);
        let floor = self.graph.number(f64::from(NORMALISATION_FLOOR));
        let strength = self.graph.plain("Div", &[&mean, &floor]);
        let strength = self.graph.plain("Log", &[&strength]);
        let strength = self.convolution(of_strength, &strength);
        let sum = self.graph.plain("Add", &[&shape, &strength]);
        self.graph.plain("Relu", &[&sum])
    }

    fn upsampled_onto(&mut self, lateral: &Convolution, coarse: &str, finer: &str) -> String {
        let map = self.rectified(lateral, coarse);
        let scales = self.graph.floats(&[4], &[1.0, 1.0, 2.0, 2.0]);
        let attributes = vec![
            AttributeProto::text("mode", "nearest"),
            AttributeProto::text("nearest_mode", "floor"),
            AttributeProto::text("coordinate_transformation_mode", "asymmetric"),
        ];
        let map = self.graph.node("Resize", &[&map, "", &scales], attributes);
        self.graph.plain("Add", &[&map, finer])
    }

    /// Equivalent of `grid::peaks`, for all cells at once.
    fn decode(&mut self, raw: &str) {
        let logit = self.graph.slice(raw, 0..1, 1);
        let logit = self.clipped(&logit, MAX_LOGIT);
        let score = self.graph.plain("Sigmoid", &[&logit]);

        let offset = self.graph.slice(raw, 1..3, 1);
        let stride = self.graph.number(STRIDE_PX as f64);
        let offset = self.graph.plain("Mul", &[&offset, &stride]);
        let centers = self.centers(&score);
        let center = self.graph.plain("Add", &[&offset, &centers]);

        let size = self.graph.slice(raw, 3..5, 1);
        let size = self.clipped(&size, MAX_LOG_SIZE);
        let size = self.graph.plain("Exp", &[&size]);
        let anchor_px = ANCHOR_PX.map(|px| px as f32);
        let anchor = self.graph.floats(&[1, 2, 1, 1], &anchor_px);
        let size = self.graph.plain("Mul", &[&size, &anchor]);

        let boxes = self.graph.concat(&[&center, &size], 1);
        let weighted = self.graph.plain("Mul", &[&boxes, &score]);
        let sum = self.pool("AveragePool", &weighted);
        let weight = self.pool("AveragePool", &score);
        let mean = self.graph.plain("Div", &[&sum, &weight]);

        let largest = self.pool("MaxPool", &score);
        let below = self.graph.plain("Less", &[&score, &largest]);
        let peak = self.graph.plain("Not", &[&below]);
        let peak = self.graph.cast(&peak, FLOAT);

        let rows = self.graph.concat(&[&mean, &score, &peak], 1);
        let shape = self.graph.integers(&[0, 6, -1]);
        let rows = self.graph.plain("Reshape", &[&rows, &shape]);
        let attributes = vec![AttributeProto::ints("perm", &[0, 2, 1])];
        self.graph.node("Transpose", &[&rows], attributes);
        self.graph.name_last("output");
    }

    fn clipped(&mut self, value: &str, most: f64) -> String {
        let [least, most] = [-most, most].map(|end| self.graph.number(end));
        self.graph.plain("Clip", &[value, &least, &most])
    }

    /// Cell centres of a map with one channel, pixels: `[batch, 2, rows, columns]`, right and down. Counted in the graph, so that the input
    /// may have any size.
    fn centers(&mut self, map: &str) -> String {
        let stride_px = STRIDE_PX as f64;
        let numbers = [stride_px, cell_center_px(0) - stride_px, 0.0, 1.0];
        let [stride, before_first, nothing, one] = numbers.map(|number| self.graph.number(number));
        let zeros = self.graph.plain("Mul", &[map, &nothing]);
        let ones = self.graph.plain("Add", &[&zeros, &one]);
        let [right, down] = [3, 2].map(|axis| {
            let axis = self.graph.integer(axis);
            let count = self.graph.plain("CumSum", &[&ones, &axis]);
            let pixels = self.graph.plain("Mul", &[&count, &stride]);
            self.graph.plain("Add", &[&pixels, &before_first])
        });
        self.graph.concat(&[&right, &down], 1)
    }

    fn pool(&mut self, operator: &str, map: &str) -> String {
        let (side, pad) = (2 * NEIGHBOURHOOD as i64 + 1, NEIGHBOURHOOD as i64);
        let attributes = vec![
            AttributeProto::ints("kernel_shape", &[side, side]),
            AttributeProto::ints("pads", &[pad; 4]),
        ];
        self.graph.node(operator, &[map], attributes)
    }

    /// A weight `[kernel * kernel * channels_in, channels_out]` in ONNX's layout: `[channels_out, channels_in, kernel, kernel]`.
    fn kernel(&mut self, weight: Tensor<2>, side: usize) -> String {
        let [rows, channels_out] = weight.dims();
        let channels_in = rows / (side * side);
        let weight = weight
            .reshape([side, side, channels_in, channels_out])
            .permute([3, 2, 0, 1]);
        let dims = [channels_out, channels_in, side, side].map(|length| length as i64);
        let values = values_of(weight);
        self.graph.floats(&dims, &values)
    }

    fn vector(&mut self, bias: Tensor<1>) -> String {
        let values = values_of(bias);
        self.graph.floats(&[values.len() as i64], &values)
    }

    fn into_model(self) -> ModelProto {
        let named = |name: &str| Dimension::Named(name.into());
        let input = [
            named("batch"),
            Dimension::Fixed(3),
            named("height"),
            named("width"),
        ];
        let output = [named("batch"), named("cells"), Dimension::Fixed(6)];
        let words = [
            ("classes", "aircraft"),
            ("input", "RGB, 0 to 1"),
            (
                "output",
                "cx, cy, width, height in input pixels, pixel (0, 0) is the centre of the top-left pixel; objectness; peak",
            ),
        ];
        let texts = ModelTexts {
            name: "aircraft",
            version: env!("CARGO_PKG_VERSION"),
            metadata: &words,
        };
        self.graph.into_model(
            vec![ValueInfoProto::floats("images", &input)],
            vec![ValueInfoProto::floats("output", &output)],
            texts,
        )
    }
}

fn values_of<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor
        .into_data()
        .try_into_vec()
        .expect("a tensor of floats holds floats")
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Device;
    use std::collections::HashSet;

    #[test]
    fn the_model_is_small() {
        let bytes = onnx_bytes(&Network::new(&Device::flex(), 5)).len();
        assert!(bytes < 4_000_000, "{bytes} bytes");
    }

    #[test]
    fn every_value_is_made_once_and_before_it_is_used() {
        let graph = model(&Network::new(&Device::flex(), 5)).graph.unwrap();
        let mut known: HashSet<String> = graph.initializer.iter().map(|c| c.name.clone()).collect();
        assert_eq!(known.len(), graph.initializer.len());
        known.extend(graph.input.iter().map(|i| i.name.clone()));
        known.insert(String::new()); // an input left out
        for node in &graph.node {
            for input in &node.input {
                assert!(
                    known.contains(input),
                    "{} uses {input} before it is made",
                    node.name
                );
            }
            for output in &node.output {
                assert!(known.insert(output.clone()), "{output} is made twice");
            }
        }
        assert!(known.contains("output"));
    }

    #[test]
    fn kernels_are_reordered_and_not_just_reshaped() {
        let network = Network::new(&Device::flex(), 5);
        let mut layers = Layers::default();
        layers.kernel(network.down_8.weight.val(), 3);
        let (_, constants) = layers.graph.parts();
        let (dims, raw) = (&constants[0].dims, &constants[0].raw_data);
        assert_eq!(dims, &[32, 32, 3, 3]);
        let ours = values_of(network.down_8.weight.val());
        let (ky, kx, ci, co) = (2, 1, 7, 11);
        let place = ((co * 32 + ci) * 3 + ky) * 3 + kx;
        let theirs = f32::from_le_bytes(raw[4 * place..][..4].try_into().unwrap());
        assert_eq!(theirs, ours[((ky * 3 + kx) * 32 + ci) * 32 + co]);
    }
}
