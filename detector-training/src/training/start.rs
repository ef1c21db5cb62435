//! Initial weights from a detector of this project.
//!
//! Input: an ONNX model that [`crate::export`] wrote. Output: the network in it.

use std::path::Path;

use burn::module::Param;
use burn::tensor::{Device, Tensor, TensorData};
use dataset::files::outside_file::{self, FileKind};
use onnx_graph::proto::{ModelProto, TensorProto};
use prost::Message;

use crate::error::{Error, Result};
use crate::network::convolution::Convolution;
use crate::network::{INPUT_GAIN, Network};

/// Layers besides those for the strength of contrast, in the order of the graph: the first, then the ones of [`layers`].
const LAYERS: usize = 13;
const STRENGTHS: usize = 3;

/// The network in the model at `path`.
pub(crate) fn start_from(path: &Path, device: &Device) -> Result<Network> {
    let onnx = outside_file::read(path, FileKind::MODEL)?;
    network_of(&onnx, device).ok_or_else(|| {
        Error::Input(format!(
            "{}: is no detector that `dtd train-detector` wrote, so that training cannot start from its weights; start from such a model, \
             or from none",
            path.display()
        ))
    })
}

/// A kernel `[channels out, channels in, side, side]` and its bias.
struct Weights<'a> {
    kernel: &'a TensorProto,
    bias: &'a TensorProto,
}

fn network_of(onnx: &[u8], device: &Device) -> Option<Network> {
    let graph = ModelProto::decode(onnx).ok()?.graph?;
    let constant = |name: &str| graph.initializer.iter().find(|c| c.name == name);
    let (mut found, mut strengths) = (Vec::new(), Vec::new());
    for node in graph.node.iter().filter(|node| node.op_type == "Conv") {
        let [_, kernel, bias] = node.input.as_slice() else {
            return None;
        };
        let weights = Weights {
            kernel: constant(kernel)?,
            bias: constant(bias)?,
        };
        match weights.kernel.dims.as_slice() {
            [1, ..] => {} // the mean of a normalisation
            [_, 1, ..] => strengths.push(weights),
            _ => found.push(weights),
        }
    }
    if found.len() != LAYERS || strengths.len() != STRENGTHS {
        return None;
    }
    let mut network = Network::new(device, 0);
    let (stem, rest) = found.split_first()?;
    // The exported weights have no mean left to take out.
    let weight = stem.rows(network.stem.dims())?.div_scalar(INPUT_GAIN);
    network.stem = Param::from_data(weight.into_data(), device);
    network.stem_bias = Param::from_data(stem.bias(network.stem_bias.dims())?, device);
    for (layer, weights) in layers(&mut network).into_iter().zip(rest) {
        weights.put_into(layer, device)?;
    }
    for (layer, weights) in strength_layers(&mut network).into_iter().zip(&strengths) {
        weights.put_into(layer, device)?;
    }
    Some(network)
}

/// The layers behind the first, in the order of the graph.
fn layers(network: &mut Network) -> Vec<&mut Convolution> {
    let mut all = vec![
        &mut network.down_8,
        &mut network.at_8,
        &mut network.down_16,
        &mut network.at_16,
        &mut network.down_32,
    ];
    all.extend(&mut network.at_32);
    all.extend([
        &mut network.lateral_16,
        &mut network.neck_16,
        &mut network.lateral_8,
        &mut network.neck_8,
        &mut network.head,
    ]);
    all
}

fn strength_layers(network: &mut Network) -> [&mut Convolution; STRENGTHS] {
    [
        &mut network.strength_8,
        &mut network.strength_16,
        &mut network.strength_32,
    ]
}

impl Weights<'_> {
    fn put_into(&self, layer: &mut Convolution, device: &Device) -> Option<()> {
        layer.weight = Param::from_data(self.rows(layer.weight.dims())?.into_data(), device);
        layer.bias = Param::from_data(self.bias(layer.bias.dims())?, device);
        Some(())
    }

    /// The kernel as rows `[side * side * channels in, channels out]`, if those are its dimensions.
    fn rows(&self, dims: [usize; 2]) -> Option<Tensor<2>> {
        let [out, into, down, across] = *self.kernel.dims.as_slice() else {
            return None;
        };
        let shape = [out, into, down, across].map(|length| length as usize);
        let [out, into, down, across] = shape;
        let values = self.kernel.float_values()?;
        if dims != [down * across * into, out] || values.len() != dims[0] * out {
            return None;
        }
        let kernel: Tensor<4> = Tensor::from_data(TensorData::new(values, shape), &Device::flex());
        Some(kernel.permute([2, 3, 1, 0]).reshape(dims))
    }

    fn bias(&self, dims: [usize; 1]) -> Option<TensorData> {
        let values = self.bias.float_values()?;
        (dims == [values.len()]).then(|| TensorData::new(values, dims))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::{model, onnx_bytes};
    use crate::network::convolution::{GatherTables, normal_weights};
    use crate::network::patches::PatchBatch;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    fn output(network: &Network) -> Vec<f32> {
        let mut batch = PatchBatch::new(1, 64, 64);
        let picture: Vec<f32> = (0..64 * 64 * 3)
            .map(|i| (i * 7 % 256) as f32 / 255.0)
            .collect();
        batch.fill(0, &picture);
        let map = network.forward(&batch, &mut GatherTables::new(&Device::flex()));
        map.rows.into_data().try_into_vec().unwrap()
    }

    fn trained() -> Network {
        let device = Device::flex();
        let mut rng = ChaCha8Rng::seed_from_u64(31);
        let mut network = Network::new(&device, 31);
        network.head.weight = normal_weights(network.head.weight.dims(), 0.2, &device, &mut rng);
        for layer in strength_layers(&mut network) {
            layer.weight = normal_weights(layer.weight.dims(), 0.2, &device, &mut rng);
        }
        network
    }

    fn assert_same(a: &[f32], b: &[f32]) {
        let largest = a
            .iter()
            .zip(b)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f32::max);
        assert!(largest < 1e-4, "{largest}");
    }

    #[test]
    fn a_network_comes_back_from_its_model() {
        let network = trained();
        let back = network_of(&onnx_bytes(&network), &Device::flex()).unwrap();
        assert_same(&output(&back), &output(&network));
    }

    #[test]
    fn something_else_is_no_start() {
        assert!(network_of(b"", &Device::flex()).is_none());
        let mut other = model(&trained());
        other
            .graph
            .as_mut()
            .unwrap()
            .node
            .retain(|node| node.op_type != "Relu");
        other.graph.as_mut().unwrap().node.truncate(6);
        assert!(network_of(&other.encode_to_vec(), &Device::flex()).is_none());
    }
}
