//! Hand-written gradients of the stacked LSTM.
//!
//! burn's autodiff computes the same on one core: it keeps and walks a graph of some eighty small operations per view, each with a separate
//! tensor, and with a batch of 256 few products are large enough for two cores. Here the gates of a layer are one product, what follows it
//! is one pass over its rows, and the rows of a batch are divided into [parts that cores share](row_parts).

use std::sync::Arc;

use burn::module::Param;
use burn::optim::GradientsParams;
use burn::tensor::{Device, Tensor, TensorData};
use rayon::prelude::*;

use super::{Gate, Layer, StackedLstm, ViewFeatures};
use crate::networks::encoded::numbers;
use crate::networks::row_parts::row_parts;

/// The gates of a layer side by side, the one that the first view has no use for last.
struct Weights {
    /// `[inputs, 4 width]`
    input: Tensor<2>,
    /// `4 width`
    bias: Vec<f32>,
    /// `[width, 4 width]`
    hidden: Tensor<2>,
    width: usize,
}

/// Output and cell of a layer for some rows, `[rows, width]` each.
#[derive(Clone)]
struct State {
    hidden: Tensor<2>,
    cell: Arc<Vec<f32>>,
}

/// Values of one step of a layer that the backward pass needs.
struct Step {
    input: Tensor<2>,
    before: Option<State>,
    /// Gates of a row side by side, as many as there are.
    gates: Vec<f32>,
    /// `tanh` of the cell.
    shown: Vec<f32>,
    present: Option<Arc<Vec<f32>>>,
}

/// Some rows of a batch on their way.
struct Part {
    rows: usize,
    /// By view and layer.
    steps: Vec<Vec<Step>>,
    output: Tensor<2>,
}

/// A batch that went through the layers, ready to go back.
pub(crate) struct Traced<'a> {
    lstm: &'a StackedLstm,
    weights: Vec<Weights>,
    parts: Vec<Part>,
}

/// Sums over rows of what a layer's weights change.
struct LayerGradients {
    input: Tensor<2>,
    bias: Vec<f32>,
    /// `None` if there was one view only.
    hidden: Option<Tensor<2>>,
}

impl StackedLstm {
    /// The same as [`StackedLstm::forward`], and what gradients need. Networks and features must be without autodiff.
    pub(crate) fn trace(&self, views: &[ViewFeatures]) -> Traced<'_> {
        let weights: Vec<Weights> = self.layers.iter().map(Weights::of).collect();
        let [rows, _] = views[0].features.dims();
        let parts = row_parts(rows).into_par_iter().map(|rows| {
            let (from, count) = (rows.start, rows.len());
            let views = views.iter().map(|view| ViewFeatures {
                features: view.features.clone().narrow(0, from, count),
                present: view.present.clone().map(|p| p.narrow(0, from, count)),
            });
            Part::of(&weights, views, count)
        });
        Traced {
            parts: parts.collect(),
            lstm: self,
            weights,
        }
    }
}

impl Traced<'_> {
    /// Output of the last layer after the last view, `[batch, width]`.
    pub(crate) fn output(&self) -> Tensor<2> {
        let outputs = self.parts.iter().map(|part| part.output.clone());
        Tensor::cat(outputs.collect(), 0)
    }

    /// Adds the gradients of all weights, for this gradient of the output. Weights that had no use get none, as by autodiff.
    pub(crate) fn add_gradients(self, output: Tensor<2>, into: &mut GradientsParams) {
        let Self {
            lstm,
            weights,
            parts,
        } = self;
        let mut from = 0;
        let parts: Vec<(Part, Tensor<2>)> = parts
            .into_iter()
            .map(|part| {
                let rows = from..from + part.rows;
                from = rows.end;
                (part, output.clone().slice([rows]))
            })
            .collect();
        let of_parts = parts.into_par_iter();
        let of_parts: Vec<_> = of_parts
            .map(|(part, output)| part.back(&weights, output))
            .collect();
        // In their order: sums of floats depend on it.
        let total = of_parts.into_iter().reduce(|mut sum, part| {
            for (sum, part) in sum.iter_mut().zip(part) {
                sum.add(part);
            }
            sum
        });
        for (layer, gradients) in lstm.layers.iter().zip(total.into_iter().flatten()) {
            layer.register(gradients, into);
        }
    }
}

impl Layer {
    /// In the order of [`Weights`].
    fn gates(&self) -> [&Gate; 4] {
        [
            &self.input_gate,
            &self.cell_gate,
            &self.output_gate,
            &self.forget_gate,
        ]
    }

    fn register(&self, gradients: LayerGradients, into: &mut GradientsParams) {
        let width = self.input_gate.hidden.weight.dims()[1];
        let used = gradients.bias.len() / width;
        for (number, gate) in self.gates().into_iter().enumerate().take(used) {
            let columns = number * width..(number + 1) * width;
            let mut register = |param: &Param<Tensor<2>>, all: &Tensor<2>| {
                let inputs = all.dims()[0];
                into.register(param.id, all.clone().slice([0..inputs, columns.clone()]));
            };
            register(&gate.input.weight, &gradients.input);
            if let Some(hidden) = &gradients.hidden {
                register(&gate.hidden.weight, hidden);
            }
            if let Some(bias) = &gate.input.bias {
                let numbers = TensorData::new(gradients.bias[columns].to_vec(), [width]);
                into.register(bias.id, Tensor::<1>::from_data(numbers, &bias.device()));
            }
        }
    }
}

impl Weights {
    fn of(layer: &Layer) -> Self {
        let gates = layer.gates();
        let side_by_side =
            |weight: fn(&Gate) -> Tensor<2>| Tensor::cat(gates.map(weight).to_vec(), 1);
        let bias = |gate: &Gate| gate.input.bias.as_ref().map(|bias| bias.val().unsqueeze());
        Self {
            input: side_by_side(|gate| gate.input.weight.val()),
            bias: numbers(Tensor::cat(gates.into_iter().filter_map(bias).collect(), 1)),
            hidden: side_by_side(|gate| gate.hidden.weight.val()),
            width: layer.input_gate.hidden.weight.dims()[1],
        }
    }

    /// The input's part for as many gates as are used.
    fn input(&self, gates: usize) -> Tensor<2> {
        let inputs = self.input.dims()[0];
        self.input.clone().slice([0..inputs, 0..gates * self.width])
    }

    fn step(
        &self,
        input: Tensor<2>,
        before: Option<State>,
        present: Option<Arc<Vec<f32>>>,
    ) -> (State, Step) {
        let [rows, _] = input.dims();
        let (device, width) = (input.device(), self.width);
        let used = if before.is_some() { 4 } else { 3 };
        let mut gates = numbers(input.clone().matmul(self.input(used)));
        let recurrent = before.as_ref();
        let recurrent =
            recurrent.map(|before| numbers(before.hidden.clone().matmul(self.hidden.clone())));
        let mut cell = vec![0.0; rows * width];
        let (mut hidden, mut shown) = (cell.clone(), cell.clone());
        for row in 0..rows {
            let gates = &mut gates[row * used * width..][..used * width];
            let places = row * width..(row + 1) * width;
            for (gate, bias) in gates.iter_mut().zip(&self.bias) {
                *gate += bias;
            }
            if let Some(recurrent) = &recurrent {
                for (gate, more) in gates.iter_mut().zip(&recurrent[row * used * width..]) {
                    *gate += more;
                }
            }
            let (input, others) = gates.split_at_mut(width);
            let (candidate, others) = others.split_at_mut(width);
            for gate in [&mut *input, others] {
                for value in gate {
                    *value = sigmoid(*value);
                }
            }
            for value in &mut *candidate {
                *value = tanh(*value);
            }
            let (output, forget) = others.split_at(width);
            let cell = &mut cell[places.clone()];
            for n in 0..width {
                cell[n] = input[n] * candidate[n];
            }
            if let Some(before) = &before {
                let old = &before.cell[places.clone()];
                for n in 0..width {
                    cell[n] += forget[n] * old[n];
                }
            }
            let (shown, hidden) = (&mut shown[places.clone()], &mut hidden[places]);
            for n in 0..width {
                shown[n] = tanh(cell[n]);
                hidden[n] = output[n] * shown[n];
            }
        }
        if let Some(present) = &present {
            let old_hidden = before.as_ref().map(|before| numbers(before.hidden.clone()));
            keep(&mut hidden, old_hidden.as_deref(), present);
            keep(
                &mut cell,
                before.as_ref().map(|before| &before.cell[..]),
                present,
            );
        }
        let state = State {
            hidden: tensor(hidden, width, &device),
            cell: Arc::new(cell),
        };
        let step = Step {
            input,
            before,
            gates,
            shown,
            present,
        };
        (state, step)
    }
}

impl Part {
    fn of(weights: &[Weights], views: impl Iterator<Item = ViewFeatures>, rows: usize) -> Self {
        let mut states: Vec<Option<State>> = weights.iter().map(|_| None).collect();
        let mut steps = Vec::new();
        let mut output = None;
        for view in views {
            let present = view.present.map(|present| Arc::new(numbers(present)));
            let mut value = view.features;
            let of_view = weights.iter().zip(&mut states).map(|(weights, state)| {
                let (new, step) = weights.step(value.clone(), state.take(), present.clone());
                value = new.hidden.clone();
                *state = Some(new);
                step
            });
            steps.push(of_view.collect());
            output = Some(value);
        }
        Self {
            rows,
            steps,
            output: output.expect("a sequence has at least one view"),
        }
    }

    /// Gradients of each layer, for this gradient of the output.
    fn back(self, weights: &[Weights], output: Tensor<2>) -> Vec<LayerGradients> {
        let mut gradients: Vec<Option<LayerGradients>> = weights.iter().map(|_| None).collect();
        // Gradients of the states after a view, by layer: only the last output contributes.
        let nothing = |weights: &Weights| vec![0.0; self.rows * weights.width];
        let mut hidden: Vec<Vec<f32>> = weights.iter().map(nothing).collect();
        let mut cell = hidden.clone();
        if let Some(last) = hidden.last_mut() {
            *last = numbers(output);
        }
        for steps in self.steps.into_iter().rev() {
            let mut from_above: Option<Vec<f32>> = None;
            for (layer, step) in steps.into_iter().enumerate().rev() {
                if let Some(more) = from_above.take() {
                    add(&mut hidden[layer], &more);
                }
                let weights = &weights[layer];
                let gates = step.back(weights.width, &mut hidden[layer], &mut cell[layer]);
                let used = gates.dims()[1] / weights.width;
                let sum = LayerGradients {
                    input: step.input.clone().transpose().matmul(gates.clone()),
                    bias: numbers(gates.clone().sum_dim(0)),
                    hidden: step
                        .before
                        .as_ref()
                        .map(|before| before.hidden.clone().transpose().matmul(gates.clone())),
                };
                match &mut gradients[layer] {
                    Some(later) => later.add(sum),
                    none => *none = Some(sum),
                }
                if step.before.is_some() {
                    let back = gates.clone().matmul(weights.hidden.clone().transpose());
                    add(&mut hidden[layer], &numbers(back));
                }
                if layer > 0 {
                    let back = gates.matmul(weights.input(used).transpose());
                    from_above = Some(numbers(back));
                }
            }
        }
        gradients.into_iter().flatten().collect()
    }
}

impl Step {
    /// The gradient of what goes into the gates, `[rows, gates width]`. Gradients of output and cell after the step become those before it,
    /// but for what goes through the gates.
    fn back(&self, width: usize, hidden: &mut [f32], cell: &mut [f32]) -> Tensor<2> {
        let rows = hidden.len() / width;
        let used = self.gates.len() / hidden.len();
        let mut back = vec![0.0; self.gates.len()];
        for row in 0..rows {
            let places = row * width..(row + 1) * width;
            let (hidden, cell) = (&mut hidden[places.clone()], &mut cell[places.clone()]);
            // A row that the view did not see keeps its state: the gradient bypasses the gates entirely (`present` 0) or not at all (1).
            let present = self.present.as_ref().map_or(1.0, |present| present[row]);
            let shown = &self.shown[places.clone()];
            let gates = &self.gates[row * used * width..][..used * width];
            let back = &mut back[row * used * width..][..used * width];
            let (input, gates) = gates.split_at(width);
            let (candidate, gates) = gates.split_at(width);
            let (output, forget) = gates.split_at(width);
            let (to_input, back) = back.split_at_mut(width);
            let (to_candidate, back) = back.split_at_mut(width);
            let (to_output, to_forget) = back.split_at_mut(width);
            let old = self.before.as_ref().map(|before| &before.cell[places]);
            for n in 0..width {
                let of_hidden = present * hidden[n];
                let of_cell =
                    present * cell[n] + of_hidden * output[n] * (1.0 - shown[n] * shown[n]);
                to_output[n] = of_hidden * shown[n] * output[n] * (1.0 - output[n]);
                to_input[n] = of_cell * candidate[n] * input[n] * (1.0 - input[n]);
                to_candidate[n] = of_cell * input[n] * (1.0 - candidate[n] * candidate[n]);
                hidden[n] *= 1.0 - present;
                cell[n] *= 1.0 - present;
                if let Some(old) = old {
                    to_forget[n] = of_cell * old[n] * forget[n] * (1.0 - forget[n]);
                    cell[n] += of_cell * forget[n];
                }
            }
        }
        tensor(back, used * width, &self.input.device())
    }
}

impl LayerGradients {
    /// Adds gradients, possibly of fewer gates: missing ones count as 0.
    fn add(&mut self, other: Self) {
        let [rows, columns] = other.input.dims();
        let wide = self.input.clone();
        // The first view uses fewer gates than the others.
        self.input = if columns == wide.dims()[1] {
            wide + other.input
        } else {
            let places = [0..rows, 0..columns];
            let sum = wide.clone().slice(places.clone()) + other.input;
            wide.slice_assign(places, sum)
        };
        add(&mut self.bias, &other.bias);
        self.hidden = match (self.hidden.take(), other.hidden) {
            (Some(a), Some(b)) => Some(a + b),
            (a, b) => a.or(b),
        };
    }
}

fn tensor(numbers: Vec<f32>, columns: usize, device: &Device) -> Tensor<2> {
    let rows = numbers.len() / columns;
    Tensor::from_data(TensorData::new(numbers, [rows, columns]), device)
}

fn add(sum: &mut [f32], more: &[f32]) {
    for (sum, more) in sum.iter_mut().zip(more) {
        *sum += more;
    }
}

/// Rows that are not present keep the old numbers, or zeros.
fn keep(new: &mut [f32], old: Option<&[f32]>, present: &[f32]) {
    let width = new.len() / present.len();
    for (row, (new, present)) in new.chunks_exact_mut(width).zip(present).enumerate() {
        for (n, new) in new.iter_mut().enumerate() {
            let old = old.map_or(0.0, |old| old[row * width + n]);
            *new = old + (*new - old) * present;
        }
    }
}

fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + exp(-x))
}

fn tanh(x: f32) -> f32 {
    2.0 * sigmoid(2.0 * x) - 1.0
}

/// The exponential function to a relative 2e-7, which the compiler turns into instructions on several numbers at once, as it cannot do
/// with a call of the library's: Cephes' polynomial, after the power of two is split off.
fn exp(x: f32) -> f32 {
    /// Adding it leaves an integer in the last bits.
    const ROUND: f32 = 12_582_912.0;
    const LN_2: [f32; 2] = [0.693_359_4, -2.121_944_4e-4];
    const COEFFICIENTS: [f32; 6] = [
        1.987_569_1e-4,
        1.398_199_9e-3,
        8.333_452e-3,
        4.166_579_6e-2,
        1.666_666_6e-1,
        0.5,
    ];
    let x = x.clamp(-87.0, 88.0);
    let power = x * std::f32::consts::LOG2_E + ROUND;
    let bits = power.to_bits().wrapping_sub(ROUND.to_bits());
    let whole = power - ROUND;
    let rest = (x - whole * LN_2[0]) - whole * LN_2[1];
    let sum = COEFFICIENTS.iter().fold(0.0, |sum, c| sum * rest + c);
    let of_rest = sum * rest * rest + rest + 1.0;
    of_rest * f32::from_bits(bits.wrapping_add(127) << 23)
}

#[cfg(test)]
mod tests {
    use burn::module::Module;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha12Rng;

    use super::*;

    #[test]
    fn exponentials_are_those_of_the_library() {
        for step in -8_700..=8_800 {
            let x = step as f32 * 0.01;
            let (found, expected) = (f64::from(exp(x)), f64::from(x).exp());
            assert!(
                (found / expected - 1.0).abs() < 3e-7,
                "{x}: {found} {expected}"
            );
        }
        assert_eq!([sigmoid(-1e9), sigmoid(1e9)].map(|s| s.round()), [0.0, 1.0]);
        assert!(tanh(f32::NAN).is_nan());
    }

    #[test]
    fn outputs_and_gradients_are_those_of_autodiff_with_any_number_of_views_and_rows_that_they_missed()
     {
        let random = &mut ChaCha12Rng::seed_from_u64(0);
        let device = Device::flex();
        let lstm = StackedLstm::new(3, &[8, 5], random, &device.clone().autodiff());
        let mut draw = |columns: usize| -> Vec<f32> {
            (0..600 * columns)
                .map(|_| random.random_range(-2.0..2.0))
                .collect()
        };
        for (views, masked) in [(1, false), (2, false), (3, true)] {
            let target = tensor(draw(5), 5, &device);
            let views: Vec<ViewFeatures> = (0..views)
                .map(|_| ViewFeatures {
                    features: tensor(draw(3), 3, &device),
                    present: masked.then(|| {
                        tensor(
                            draw(1).iter().map(|x| f32::from(*x > 0.0)).collect(),
                            1,
                            &device,
                        )
                    }),
                })
                .collect();
            let with_autodiff = views.iter().map(|view| ViewFeatures {
                features: Tensor::from_inner(view.features.clone()),
                present: view.present.clone().map(Tensor::from_inner),
            });
            let output = lstm.forward(&with_autodiff.collect::<Vec<_>>());
            let error = (output.clone() - Tensor::from_inner(target.clone()))
                .square()
                .sum();
            let expected = GradientsParams::from_grads(error.backward(), &lstm);

            let plain = lstm.valid();
            let traced = plain.trace(&views);
            assert!(are_near(&traced.output(), &output.inner()));
            let mut found = GradientsParams::new();
            let of_output = (traced.output() - target).mul_scalar(2.0);
            traced.add_gradients(of_output, &mut found);
            assert_eq!(found.len(), expected.len());
            for gate in plain.layers.iter().flat_map(Layer::gates) {
                for weight in [&gate.input.weight, &gate.hidden.weight] {
                    match (found.get::<2>(weight.id), expected.get::<2>(weight.id)) {
                        (Some(found), Some(expected)) => assert!(are_near(&found, &expected)),
                        (found, expected) => assert!(found.is_none() && expected.is_none()),
                    }
                }
                let bias = gate.input.bias.as_ref().unwrap().id;
                let of = |all: &GradientsParams| all.get::<1>(bias).map(|b| b.unsqueeze::<2>());
                if let (Some(found), Some(expected)) = (of(&found), of(&expected)) {
                    assert!(are_near(&found, &expected));
                }
            }
        }
    }

    fn are_near(found: &Tensor<2>, expected: &Tensor<2>) -> bool {
        let [found, expected] = [found, expected].map(|t| numbers(t.clone()));
        let largest = expected.iter().fold(0.0_f32, |most, e| most.max(e.abs()));
        found.len() == expected.len()
            && found
                .iter()
                .zip(&expected)
                .all(|(f, e)| (f - e).abs() <= 1e-5 * largest)
    }
}
