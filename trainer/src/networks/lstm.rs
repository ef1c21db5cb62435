//! Stacked LSTM over views; an empty view leaves the state unchanged.
//!
//! burn's own `nn::Lstm` multiplies by a hidden state that is zero at the first step, which with two steps is a quarter of all
//! work, and has no mask. Gates have separate weights, as saved runs have them, and `tanh(x) = 2 sigmoid(2 x) - 1`, which is faster
//! here.

use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::{Device, Tensor};
use onnx_graph::Graph;
use rand_chacha::ChaCha12Rng;

use crate::networks::dense::{linear, linear_to_onnx};

/// Gate: the input part (with bias) and the recurrent part.
#[derive(Module, Debug)]
struct Gate {
    input: Linear,
    hidden: Linear,
}

impl Gate {
    fn new(inputs: usize, width: usize, random: &mut ChaCha12Rng, device: &Device) -> Self {
        // PyTorch bounds all LSTM weights by the output width.
        let gain = (inputs as f64 / width as f64).sqrt();
        let hidden = Linear {
            bias: None,
            ..linear(width, width, 1.0, random, device)
        };
        Self {
            input: linear(inputs, width, gain, random, device),
            hidden,
        }
    }

    fn forward(&self, input: Tensor<2>, hidden: Option<Tensor<2>>) -> Tensor<2> {
        let sum = self.input.forward(input);
        match hidden {
            Some(hidden) => sum + self.hidden.forward(hidden),
            None => sum,
        }
    }

    fn to_onnx(&self, graph: &mut Graph, input: &str, hidden: Option<&str>) -> String {
        let sum = linear_to_onnx(&self.input, graph, input);
        match hidden {
            Some(hidden) => {
                let from_hidden = linear_to_onnx(&self.hidden, graph, hidden);
                graph.plain("Add", &[&sum, &from_hidden])
            }
            None => sum,
        }
    }
}

/// LSTM layer.
#[derive(Module, Debug)]
struct Layer {
    input_gate: Gate,
    forget_gate: Gate,
    cell_gate: Gate,
    output_gate: Gate,
}

/// Layer state, `[batch, width]` each.
#[derive(Clone)]
struct State {
    hidden: Tensor<2>,
    cell: Tensor<2>,
}

impl Layer {
    fn new(inputs: usize, width: usize, random: &mut ChaCha12Rng, device: &Device) -> Self {
        let mut gate = || Gate::new(inputs, width, random, device);
        Self {
            input_gate: gate(),
            forget_gate: gate(),
            cell_gate: gate(),
            output_gate: gate(),
        }
    }

    /// Advances by a view; rows masked out by `present` (1 or 0, `[batch, 1]`) keep their state.
    fn step(&self, input: Tensor<2>, state: Option<State>, present: Option<&Tensor<2>>) -> State {
        let last = state.as_ref().map(|state| state.hidden.clone());
        let write = sigmoid(self.input_gate.forward(input.clone(), last.clone()))
            * tanh(self.cell_gate.forward(input.clone(), last.clone()));
        let cell = match &state {
            Some(state) => {
                write
                    + sigmoid(self.forget_gate.forward(input.clone(), last.clone()))
                        * state.cell.clone()
            }
            None => write,
        };
        let hidden = sigmoid(self.output_gate.forward(input, last)) * tanh(cell.clone());
        let kept = |new: Tensor<2>, old: Option<Tensor<2>>| match (present, old) {
            (None, _) => new,
            (Some(present), None) => new * present.clone(),
            (Some(present), Some(old)) => old.clone() + (new - old) * present.clone(),
        };
        let (old_hidden, old_cell) = state.map(|state| (state.hidden, state.cell)).unzip();
        State {
            hidden: kept(hidden, old_hidden),
            cell: kept(cell, old_cell),
        }
    }
}

/// Layer state in an ONNX graph.
#[derive(Clone)]
struct OnnxState {
    hidden: String,
    cell: String,
}

impl Layer {
    /// [`Layer::step`] as an ONNX graph.
    fn to_onnx(
        &self,
        graph: &mut Graph,
        input: &str,
        state: Option<OnnxState>,
        present: &str,
    ) -> OnnxState {
        let last = state.as_ref().map(|state| state.hidden.as_str());
        let mut gate = |gate: &Gate, function: &str| {
            let sum = gate.to_onnx(graph, input, last);
            graph.plain(function, &[&sum])
        };
        let write_gate = gate(&self.input_gate, "Sigmoid");
        let candidate = gate(&self.cell_gate, "Tanh");
        let forget = state.is_some().then(|| gate(&self.forget_gate, "Sigmoid"));
        let output = gate(&self.output_gate, "Sigmoid");
        let write = graph.plain("Mul", &[&write_gate, &candidate]);
        let cell = match (&state, &forget) {
            (Some(state), Some(forget)) => {
                let kept = graph.plain("Mul", &[forget, &state.cell]);
                graph.plain("Add", &[&write, &kept])
            }
            _ => write,
        };
        let shown = graph.plain("Tanh", &[&cell]);
        let hidden = graph.plain("Mul", &[&output, &shown]);
        let mut kept = |new: &str, old: Option<&str>| match old {
            None => graph.plain("Mul", &[new, present]),
            Some(old) => {
                let change = graph.plain("Sub", &[new, old]);
                let change = graph.plain("Mul", &[&change, present]);
                graph.plain("Add", &[old, &change])
            }
        };
        OnnxState {
            hidden: kept(&hidden, state.as_ref().map(|state| state.hidden.as_str())),
            cell: kept(&cell, state.as_ref().map(|state| state.cell.as_str())),
        }
    }
}

/// Sigmoid whose gradient is computed from the output: burn's autodiff would evaluate the exponential function, the largest cost here,
/// again.
fn sigmoid(x: Tensor<2>) -> Tensor<2> {
    if !x.is_autodiff() {
        return burn::tensor::activation::sigmoid(x);
    }
    let constant = x.clone().inner();
    let output = constant.clone().neg().exp().add_scalar(1.0).recip();
    let slope = output.clone() * output.clone().neg().add_scalar(1.0);
    // The difference is 0, with gradient 1.
    (x - constant) * slope + output
}

fn tanh(x: Tensor<2>) -> Tensor<2> {
    sigmoid(x.mul_scalar(2.0)).mul_scalar(2.0).sub_scalar(1.0)
}

/// Features per view for a batch.
#[derive(Clone)]
pub(crate) struct ViewFeatures {
    /// `[batch, features]`.
    pub features: Tensor<2>,
    /// 1 where the view saw the aircraft and 0 elsewhere, `[batch, 1]`; `None` if it did in the whole batch.
    pub present: Option<Tensor<2>>,
}

impl ViewFeatures {
    /// Constants for a network with autodiff.
    pub(crate) fn with_autodiff(self) -> Self {
        Self {
            features: Tensor::from_inner(self.features),
            present: self.present.map(Tensor::from_inner),
        }
    }
}

/// Stacked LSTM layers.
#[derive(Module, Debug)]
pub(crate) struct StackedLstm {
    layers: Vec<Layer>,
}

impl StackedLstm {
    /// Untrained layers over `inputs` features.
    pub(crate) fn new(
        inputs: usize,
        widths: &[usize],
        random: &mut ChaCha12Rng,
        device: &Device,
    ) -> Self {
        let from = std::iter::once(inputs).chain(widths.iter().copied());
        Self {
            layers: from
                .zip(widths)
                .map(|(from, &to)| Layer::new(from, to, random, device))
                .collect(),
        }
    }

    /// Output of the last layer after the last view, `[batch, width]`. An empty view is skipped, so a sequence is as long as its number of
    /// detections. At least one view must be given.
    pub(crate) fn forward(&self, views: &[ViewFeatures]) -> Tensor<2> {
        let mut states: Vec<Option<State>> = vec![None; self.layers.len()];
        let mut output = None;
        for view in views {
            let mut value = view.features.clone();
            for (layer, state) in self.layers.iter().zip(&mut states) {
                let new = layer.step(value, state.take(), view.present.as_ref());
                value = new.hidden.clone();
                *state = Some(new);
            }
            output = Some(value);
        }
        output.expect("a sequence has at least one view")
    }

    /// [`StackedLstm::forward`] as an ONNX graph; `views` are pairs of features and presence (1 or 0).
    pub(crate) fn to_onnx(&self, graph: &mut Graph, views: &[[String; 2]]) -> String {
        let mut states: Vec<Option<OnnxState>> = vec![None; self.layers.len()];
        let mut output = String::new();
        for [features, present] in views {
            output.clone_from(features);
            for (layer, state) in self.layers.iter().zip(&mut states) {
                let new = layer.to_onnx(graph, &output, state.take(), present);
                output.clone_from(&new.hidden);
                *state = Some(new);
            }
        }
        output
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::TensorData;
    use rand::SeedableRng;

    fn lstm() -> (StackedLstm, Device) {
        let device = Device::flex();
        (
            StackedLstm::new(3, &[5, 4], &mut ChaCha12Rng::seed_from_u64(0), &device),
            device,
        )
    }

    fn values(tensor: Tensor<2>) -> Vec<f32> {
        tensor.into_data().try_into_vec().unwrap()
    }

    fn view(rows: Vec<f32>, present: Option<Vec<f32>>, device: &Device) -> ViewFeatures {
        let batch = rows.len() / 3;
        ViewFeatures {
            features: Tensor::from_data(TensorData::new(rows, [batch, 3]), device),
            present: present.map(|p| Tensor::from_data(TensorData::new(p, [batch, 1]), device)),
        }
    }

    #[test]
    fn a_masked_view_is_the_same_as_a_view_that_is_not_in_the_sequence() {
        let (lstm, device) = lstm();
        let (a, b) = (vec![0.3, -1.0, 2.0], vec![1.5, 0.2, -0.7]);
        for (masked, single) in [([0.0, 1.0], &b), ([1.0, 0.0], &a)] {
            let both = [
                view(a.clone(), Some(vec![masked[0]]), &device),
                view(b.clone(), Some(vec![masked[1]]), &device),
            ];
            let expected = values(lstm.forward(&[view(single.clone(), None, &device)]));
            let found = values(lstm.forward(&both));
            assert!(
                expected
                    .iter()
                    .zip(&found)
                    .all(|(e, f)| (e - f).abs() < 1e-6),
                "{expected:?} {found:?}"
            );
        }
    }

    #[test]
    fn the_sigmoid_has_the_same_output_and_gradient_as_burn_s() {
        let device = Device::flex().autodiff();
        let numbers = vec![-90.0_f32, -3.0, -0.1, 0.0, 0.7, 5.0, 90.0];
        let at = |function: fn(Tensor<2>) -> Tensor<2>| {
            let data = TensorData::new(numbers.clone(), [1, 7]);
            let x = Tensor::<2>::from_data(data, &device).require_grad();
            let output = function(x.clone());
            let gradient = x.grad(&output.clone().backward()).unwrap();
            [output.inner(), gradient].map(values)
        };
        let [found, expected] = [at(sigmoid), at(burn::tensor::activation::sigmoid)];
        for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
            assert!((found - expected).abs() < 1e-6, "{found} {expected}");
        }
    }

    #[test]
    fn one_cell_computes_the_textbook_equations() {
        let (lstm, device) = lstm();
        let layer = &lstm.layers[0];
        let x = [0.3_f32, -1.0, 2.0];
        let gate = |gate: &Gate, h: &[f32]| -> Vec<f32> {
            let weight = |l: &Linear| l.weight.val().into_data().try_into_vec::<f32>().unwrap();
            let (w, u) = (weight(&gate.input), weight(&gate.hidden));
            let b = gate
                .input
                .bias
                .as_ref()
                .unwrap()
                .val()
                .into_data()
                .try_into_vec::<f32>()
                .unwrap();
            (0..5)
                .map(|o| {
                    let from_x: f32 = (0..3).map(|i| x[i] * w[i * 5 + o]).sum();
                    let from_h: f32 = (0..5).map(|i| h[i] * u[i * 5 + o]).sum();
                    b[o] + from_x + from_h
                })
                .collect()
        };
        let sigmoid = |v: f32| 1.0 / (1.0 + (-v).exp());
        let (mut h, mut c) = (vec![0.0_f32; 5], vec![0.0_f32; 5]);
        for _ in 0..2 {
            let (i, f) = (gate(&layer.input_gate, &h), gate(&layer.forget_gate, &h));
            let (g, o) = (gate(&layer.cell_gate, &h), gate(&layer.output_gate, &h));
            for n in 0..5 {
                c[n] = sigmoid(f[n]) * c[n] + sigmoid(i[n]) * g[n].tanh();
                h[n] = sigmoid(o[n]) * c[n].tanh();
            }
        }
        let input = view(x.to_vec(), None, &device).features;
        let first = layer.step(input.clone(), None, None);
        let found = values(layer.step(input, Some(first), None).hidden);
        assert!(
            h.iter().zip(&found).all(|(e, f)| (e - f).abs() < 1e-6),
            "{h:?} {found:?}"
        );
    }
}
