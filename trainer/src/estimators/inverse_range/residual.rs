//! Network on the residual of a formula of registered views: it predicts the remaining error from properties of the registrations.
//!
//! A shift follows the parts of the aircraft that both views show, which depend on the light, on the distance and on the sides that the
//! views see. A formula of positions cannot account for that; scale, gain, correlation and standard deviation of the registrations carry
//! some of this information. The network's inputs are these numbers for each registered view, relative to their usual values at that
//! distance, and the inverse range. It predicts the relative error of the formula in standard deviations, which is subtracted. Inputs are
//! limited, so that a tick unlike all of the training moves the distance no further than training ticks do.
//!
//! One fit has a network: the fit that answers most ticks. Training: [`super::residual_training`]; for a new camera: [`super::new_camera`].
//! The numbers are stored with the formulas.

use burn::tensor::Device;
use dataset::geometry::camera::Camera;
use dataset::numbers::least_squares::NormalEquations;
use dataset::numbers::spread::deviation_from_zero;
use onnx_graph::proto::{AttributeProto, DOUBLE, FLOAT};
use serde::{Deserialize, Serialize};

use super::measurement::{Measurement, scale_m};
use super::robust_fit::NEAREST_M;
use super::{Fit, InverseRange};
use crate::networks::dense::{Dense, Layer, forward};
use crate::networks::estimator_graph::EstimatorGraph;
use crate::samples::view_shift::ViewShift;
use crate::samples::{Observation, Sample};

/// Numbers of a registration: logarithms of scale and gain, correlation, logarithm of the standard deviation.
const NUMBERS: usize = 4;
/// Largest input, in standard deviations.
const LARGEST_INPUT: f64 = 4.0;
/// Lower limit of the deviation of a number: smaller variations carry no information.
const LEAST_DEVIATION: f64 = 5e-3;

/// The network, and the normalisation of its inputs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Residual {
    #[serde(flatten)]
    pub(super) inputs: Inputs,
    /// Of the network: linear layers with LeakyReLU between them.
    pub(super) layers: Vec<Layer>,
}

/// Conversion of a tick to the input of a network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Inputs {
    /// Number of the fit.
    pub(super) fit: usize,
    /// Indices of the views whose registrations the network sees, ascending.
    views: Vec<usize>,
    /// Distance of the cameras behind the touchdown target, metres.
    setback_m: f64,
    /// Standard deviation of the relative error of the formula.
    pub(super) deviation: f64,
    /// Mean and standard deviation of the inverse range, 1/m.
    inverse_range_per_m: [f64; 2],
    /// Usual values of the numbers of the registrations, view by view.
    usual: Vec<[Usual; NUMBERS]>,
}

/// Usual value of a number of a registration as a function of the distance.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
struct Usual {
    /// Of 1, the normalised inverse range and its square.
    coefficients: [f64; 3],
    /// Robust standard deviation from that.
    deviation: f64,
}

impl Inputs {
    /// Usual values at these ticks, each given with the measurement of the formula of the fit with this number; `None` if the ticks do not
    /// determine them.
    pub(super) fn of(number: usize, fit: &Fit, ticks: &[(&Sample, Measurement)]) -> Option<Self> {
        let (first, _) = ticks.first()?;
        let views = fit.set.views.iter().copied();
        let views: Vec<usize> = views.filter(|&view| first.shifts[view].is_some()).collect();
        let inverse = |formula: &Measurement| (formula.distance_m + fit.setback_m).recip();
        let inverse_ranges = || ticks.iter().map(|(_, formula)| inverse(formula));
        let count = ticks.len() as f64;
        let mean = inverse_ranges().sum::<f64>() / count;
        let variance = inverse_ranges().map(|v| (v - mean).powi(2)).sum::<f64>() / count;
        let mut inputs = Self {
            fit: number,
            usual: vec![[Usual::default(); NUMBERS]; views.len()],
            views,
            setback_m: fit.setback_m,
            deviation: fit.deviation,
            inverse_range_per_m: [mean, variance.sqrt()],
        };
        let of_tick = |(sample, formula): &(&Sample, Measurement)| {
            Some((inputs.terms(formula.distance_m), inputs.numbers(sample)?))
        };
        let rows: Vec<([f64; 3], Vec<[f64; NUMBERS]>)> = ticks.iter().filter_map(of_tick).collect();
        for (view, usual) in inputs.usual.iter_mut().enumerate() {
            for (number, usual) in usual.iter_mut().enumerate() {
                let rows = || {
                    rows.iter()
                        .map(|(terms, of_views)| (terms, of_views[view][number]))
                };
                let mut normal = NormalEquations::new(3);
                rows().for_each(|(terms, value)| normal.add(terms, value, 1.0));
                usual.coefficients = normal.solve_for()?;
                let apart = rows().map(|(terms, value)| value - usual.at(terms));
                usual.deviation = deviation_from_zero(apart).max(LEAST_DEVIATION);
            }
        }
        Some(inputs)
    }

    /// The same for a new camera of this view in place of an old one, which show the aircraft of these ticks in different sizes. That the
    /// scale follows from the camera is all that is known; what else is different is learned.
    pub(super) fn for_new_camera(
        &self,
        view: usize,
        [old, new]: [Camera; 2],
        ticks: &[&Sample],
    ) -> Self {
        let mut inputs = self.clone();
        let larger = |sample: &Sample| {
            let aircraft_m = sample.position.to_ecef();
            let [old, new] = [old, new].map(|camera| {
                let ahead_m = camera.to_camera(aircraft_m).z;
                (ahead_m > 0.0).then(|| camera.focal_px / ahead_m)
            });
            Some((new? / old?).ln())
        };
        let mut normal = NormalEquations::new(3);
        for sample in ticks {
            if let Some(larger) = larger(sample) {
                normal.add(&self.terms(sample.dtd_m), larger, 1.0);
            }
        }
        let Some(larger) = normal.solve_for::<3>() else {
            return inputs;
        };
        let is_reference = !self.views.contains(&view);
        let sign = if is_reference { -1.0 } else { 1.0 };
        for (&other, [scale, ..]) in self.views.iter().zip(&mut inputs.usual) {
            if is_reference || other == view {
                for (coefficient, larger) in scale.coefficients.iter_mut().zip(larger) {
                    *coefficient += sign * larger;
                }
            }
        }
        inputs
    }

    /// Number of inputs.
    pub(super) fn len(&self) -> usize {
        1 + NUMBERS * self.views.len()
    }

    fn terms(&self, distance_m: f64) -> [f64; 3] {
        let [mean, deviation] = self.inverse_range_per_m;
        let normalised = ((distance_m + self.setback_m).recip() - mean) / deviation;
        [1.0, normalised, normalised * normalised]
    }

    /// The numbers of all registrations; `None` if one is missing, or impossible.
    fn numbers(&self, observed: &Observation) -> Option<Vec<[f64; NUMBERS]>> {
        let is_possible = |numbers: &[f64; NUMBERS]| numbers.iter().all(|n| n.is_finite());
        let of_view = |&view: &usize| {
            let numbers = observed.shifts[view].as_ref().map(numbers);
            numbers.filter(is_possible)
        };
        self.views.iter().map(of_view).collect()
    }

    /// The input at a tick, where the formula gives this distance; `None` if a registration is missing or has impossible numbers.
    pub(super) fn at(&self, observed: &Observation, distance_m: f64) -> Option<Vec<f32>> {
        let terms = self.terms(distance_m);
        let of_views = self.numbers(observed)?;
        let pairs = of_views.iter().flatten().zip(self.usual.iter().flatten());
        let relative = pairs.map(|(number, usual)| (number - usual.at(&terms)) / usual.deviation);
        let inputs: Vec<f64> = std::iter::once(terms[1]).chain(relative).collect();
        let is_possible = inputs.iter().all(|input| input.is_finite());
        is_possible.then(|| {
            inputs
                .iter()
                .map(|input| input.clamp(-LARGEST_INPUT, LARGEST_INPUT) as f32)
                .collect()
        })
    }

    /// The same in an ONNX graph, `[batch, inputs]`, in double precision and not limited.
    fn to_onnx(&self, graph: &mut EstimatorGraph, distance: &str) -> String {
        let numbers = self.numbers_to_onnx(graph);
        let graph = &mut graph.graph;
        let [mean, deviation] = self.inverse_range_per_m.map(|number| graph.double(number));
        let setback = graph.double(self.setback_m);
        let range = graph.plain("Add", &[distance, &setback]);
        let inverse = graph.plain("Reciprocal", &[&range]);
        let moved = graph.plain("Sub", &[&inverse, &mean]);
        let normalised = graph.plain("Div", &[&moved, &deviation]);
        let square = graph.plain("Mul", &[&normalised, &normalised]);

        let usual = || self.usual.iter().flatten();
        let mut row = |values: Vec<f64>| graph.doubles(&[1, values.len() as i64], &values);
        let deviations = row(usual().map(|usual| usual.deviation).collect());
        let [constant, of_normalised, of_square] =
            [0, 1, 2].map(|term| row(usual().map(|usual| usual.coefficients[term]).collect()));
        let linear = graph.plain("Mul", &[&normalised, &of_normalised]);
        let quadratic = graph.plain("Mul", &[&square, &of_square]);
        let usual = graph.plain("Sum", &[&constant, &linear, &quadratic]);
        let apart = graph.plain("Sub", &[&numbers, &usual]);
        let relative = graph.plain("Div", &[&apart, &deviations]);
        let columns = AttributeProto::int("axis", 1);
        graph.node("Concat", &[&normalised, &relative], vec![columns])
    }

    /// The numbers of all registrations in an ONNX graph, `[batch, numbers]`.
    fn numbers_to_onnx(&self, graph: &mut EstimatorGraph) -> String {
        let [deviations, scale, gain, correlation] =
            [2..4, 4..5, 5..6, 6..7].map(|columns| graph.registrations(&self.views, columns));
        let graph = &mut graph.graph;
        let over_axes = vec![AttributeProto::ints("axes", &[2])];
        let squares = graph.plain("Mul", &[&deviations, &deviations]);
        let variance = graph.node("ReduceMean", &[&squares], over_axes);
        let deviation = graph.plain("Sqrt", &[&variance]);
        let [scale, gain, deviation] =
            [scale, gain, deviation].map(|value| graph.plain("Log", &[&value]));
        let last = AttributeProto::int("axis", 2);
        let numbers = graph.node(
            "Concat",
            &[&scale, &gain, &correlation, &deviation],
            vec![last],
        );
        let row = graph.integers(&[-1, (NUMBERS * self.views.len()) as i64]);
        graph.plain("Reshape", &[&numbers, &row])
    }

    /// The error of a distance as the network should predict it.
    pub(super) fn target(&self, distance_m: f64, true_m: f64) -> f32 {
        ((distance_m - true_m) / (scale_m(distance_m) * self.deviation)) as f32
    }

    /// The distance without an error that the network predicts.
    fn without_error_m(&self, distance_m: f64, predicted: f32) -> f64 {
        distance_m - f64::from(predicted) * scale_m(distance_m) * self.deviation
    }
}

impl Usual {
    fn at(&self, terms: &[f64; 3]) -> f64 {
        let products = self.coefficients.iter().zip(terms);
        products.map(|(coefficient, term)| coefficient * term).sum()
    }
}

fn numbers(shift: &ViewShift) -> [f64; NUMBERS] {
    let deviation_px = shift.variance_px2().sqrt();
    [
        shift.scale.ln(),
        shift.gain.ln(),
        shift.correlation,
        deviation_px.ln(),
    ]
}

impl Residual {
    /// Number of the fit that it is about.
    pub(super) fn fit(&self) -> usize {
        self.inputs.fit
    }

    /// The distance after subtraction of the error that the network predicts for the formula, metres; the formula's distance if a
    /// registration is missing, or if the correction would lead behind the target.
    pub(super) fn corrected_m(&self, observed: &Observation, distance_m: f64) -> f64 {
        let inputs = self.inputs.at(observed, distance_m);
        let corrected = inputs.map(|inputs| {
            let predicted = forward(&self.layers, inputs)[0];
            self.inputs.without_error_m(distance_m, predicted)
        });
        corrected.filter(|&m| m >= 0.0).unwrap_or(distance_m)
    }

    /// The same in an ONNX graph, `[batch, 1]`.
    pub(super) fn corrected_to_onnx(&self, graph: &mut EstimatorGraph, distance: &str) -> String {
        let inputs = self.inputs.to_onnx(graph, distance);
        let graph = &mut graph.graph;
        // One that is not finite makes the sum neither, and then this no number.
        let columns = graph.integers(&[1]);
        let sum = graph.plain("ReduceSum", &[&inputs, &columns]);
        let nothing = graph.plain("Sub", &[&sum, &sum]);
        let is_missing = graph.plain("IsNaN", &[&nothing]);
        let (least, most) = (graph.double(-LARGEST_INPUT), graph.double(LARGEST_INPUT));
        let limited = graph.plain("Max", &[&inputs, &least]);
        let limited = graph.plain("Min", &[&limited, &most]);
        let limited = graph.cast(&limited, FLOAT);
        let network = Dense::of_layers(&self.layers, &Device::flex());
        let predicted = network.to_onnx(graph, &limited);
        let predicted = graph.cast(&predicted, DOUBLE);
        let (nearest, unit) = (graph.double(NEAREST_M), graph.double(self.inputs.deviation));
        let scale = graph.plain("Max", &[distance, &nearest]);
        let error = graph.plain("Mul", &[&predicted, &scale]);
        let error = graph.plain("Mul", &[&error, &unit]);
        let corrected = graph.plain("Sub", &[distance, &error]);
        let zero = graph.double(0.0);
        let is_behind = graph.plain("Less", &[&corrected, &zero]);
        let is_useless = graph.plain("Or", &[&is_missing, &is_behind]);
        graph.plain("Where", &[&is_useless, distance, &corrected])
    }

    /// The sample at the distance that a formula must give for the network to correct it to the true one.
    pub(super) fn with_error(&self, sample: &Sample) -> Sample {
        let mut with_error = sample.clone();
        with_error.dtd_m = 2.0 * sample.dtd_m - self.corrected_m(sample, sample.dtd_m);
        with_error
    }

    /// True if this network belongs to the fit, and has layers for its inputs.
    pub(super) fn is_of(&self, fit: &Fit) -> bool {
        let mut inputs = self.inputs.len();
        let goes_on = |layer: &Layer| {
            let outputs = layer.biases.len();
            let is_whole = outputs > 0 && layer.weights.len() == inputs * outputs;
            inputs = outputs;
            is_whole
        };
        let Inputs {
            views,
            usual,
            inverse_range_per_m: [_, deviation],
            ..
        } = &self.inputs;
        let varies = |usual: &Usual| usual.deviation > 0.0;
        fit.set.registered
            && *deviation > 0.0
            && usual.iter().flatten().all(varies)
            && views.iter().all(|view| fit.set.views.contains(view))
            && views.len() == usual.len()
            && self.layers.iter().all(goes_on)
            && self
                .layers
                .last()
                .is_some_and(|last| last.biases.len() == 1)
    }

    /// All of its numbers.
    pub(super) fn constants(&self) -> impl Iterator<Item = f64> {
        let inputs = &self.inputs;
        let [mean, deviation] = inputs.inverse_range_per_m;
        let usual = inputs.usual.iter().flatten();
        let usual = usual.flat_map(|of| of.coefficients.into_iter().chain([of.deviation]));
        let layers = self.layers.iter();
        let layers = layers.flat_map(|layer| layer.weights.iter().chain(&layer.biases));
        [inputs.setback_m, inputs.deviation, mean, deviation]
            .into_iter()
            .chain(usual)
            .chain(layers.map(|&number| f64::from(number)))
    }
}

/// The ticks that the formula of a fit answers.
pub(super) fn answered<'a>(
    fits: &InverseRange,
    fit: usize,
    ticks: &[&'a Sample],
) -> Vec<(&'a Sample, Measurement)> {
    let answered = |&sample: &&'a Sample| Some((sample, fits.formula(fit, sample)?));
    ticks.iter().filter_map(answered).collect()
}
