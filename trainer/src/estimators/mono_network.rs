//! The monoscopic baseline as a network: one view's box to distance, each view separately, averaged over the views that saw it.

use std::ops::Range;

use burn::module::Module;
use burn::optim::GradientsParams;
use burn::tensor::{Device, Tensor};
use rand_chacha::ChaCha12Rng;
use serde::{Deserialize, Serialize};

use crate::config::{MonoConfig, Target};
use crate::error::Result;
use crate::networks::dense::{Dense, widths};
use crate::networks::encoded::{Encoded, EncodedSides, draw, numbers};
use crate::networks::estimator_graph::EstimatorGraph;
use crate::networks::normalisation::BOX_FEATURES;
use crate::networks::row_parts::loss_of_parts;
use crate::networks::training_loop::{Companions, Learned, Setup, Task, learn};

/// Steps between two judgements.
const JUDGED_EVERY: usize = 500;
/// Number of centre features, which come first.
const CENTRE: usize = 2;

/// Box features that the network sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum MonoInputs {
    /// Width and height: `mono_network`.
    Size,
    /// Centre: `mono_network_position`.
    Position,
    /// Centre and size: `mono_network_box`.
    Box,
}

impl MonoInputs {
    /// Range of the network's inputs among the box features.
    fn columns(self) -> Range<usize> {
        match self {
            Self::Size => CENTRE..BOX_FEATURES,
            Self::Position => 0..CENTRE,
            Self::Box => 0..BOX_FEATURES,
        }
    }

    fn of(self, features: Tensor<2>) -> Tensor<2> {
        let Range { start, end } = self.columns();
        features.narrow(1, start, end - start)
    }
}

/// Monoscopic networks, one per view.
#[derive(Module, Debug)]
pub(crate) struct MonoNetworks {
    views: Vec<Dense>,
}

impl MonoNetworks {
    /// Untrained networks.
    pub(crate) fn new(
        views: usize,
        inputs: MonoInputs,
        config: &MonoConfig,
        random: &mut ChaCha12Rng,
        device: &Device,
    ) -> Self {
        let widths = widths(inputs.columns().len(), &config.hidden, 1);
        Self {
            views: (0..views)
                .map(|_| Dense::new(&widths, random, device))
                .collect(),
        }
    }

    /// Trains the network of each view on the boxes of that view, starting from random networks or from `start`. Also returns the stages,
    /// `None` for a view without boxes.
    pub(crate) fn train_from(
        start: Option<&Self>,
        inputs: MonoInputs,
        sides: &EncodedSides,
        config: &MonoConfig,
        mut setup: Setup,
        companions: &mut Companions,
    ) -> Result<(Self, Vec<Option<Learned<Dense>>>)> {
        let settings = &config.optimisation;
        let training = &sides.training;
        let views = training.views();
        let random = Self::new(views, inputs, config, &mut setup.random, &setup.device);
        let untrained = start.map_or(random, |start| start.clone().train());
        let mut task = MonoTask {
            inputs,
            training,
            validation: &sides.validation,
            config,
            view: 0,
            seen: Vec::new(),
            setup,
        };
        let (mut trained, mut stages) = (Vec::new(), Vec::new());
        for (view, mut network) in untrained.views.into_iter().enumerate() {
            (task.view, task.seen) = (view, training.seen_by(view));
            let learned = if task.seen.is_empty() {
                None
            } else {
                let learned = learn(&mut task, network.clone(), settings, companions)?;
                network = learned.kept.network.clone();
                Some(learned)
            };
            trained.push(network);
            stages.push(learned);
        }
        Ok((Self { views: trained }, stages))
    }

    /// Mean over the views that saw each sample, units of 10 NM. Networks and device must be without autodiff.
    pub(crate) fn predict(
        &self,
        inputs: MonoInputs,
        samples: &Encoded,
        loss: Target,
        device: &Device,
    ) -> Vec<f32> {
        let mut sums = vec![0.0; samples.len()];
        for (view, network) in self.views.iter().enumerate() {
            let seen = samples.seen_by(view);
            if seen.is_empty() {
                continue;
            }
            let predictions =
                numbers(network.forward(inputs.of(samples.inputs(&seen, view, device))));
            for (sample, prediction) in seen.into_iter().zip(predictions) {
                sums[sample] += loss.distance(prediction) / samples.detections(sample) as f32;
            }
        }
        sums
    }

    /// Adds the mean to an ONNX graph, metres.
    pub(crate) fn to_onnx(
        &self,
        inputs: MonoInputs,
        loss: Target,
        graph: &mut EstimatorGraph,
    ) -> String {
        let (mut distances, mut presences) = (Vec::new(), Vec::new());
        for (view, network) in self.views.iter().enumerate() {
            let features = graph.features(view);
            let features = graph.some_of(&features, inputs.columns());
            let predicted = network.to_onnx(&mut graph.graph, &features);
            let distance = graph.distance(predicted, loss);
            let present = graph.presence(view);
            distances.push(graph.graph.plain("Mul", &[&distance, &present]));
            presences.push(present);
        }
        let [mean, _] = graph.mean_and_count(&distances, &presences);
        graph.metres(&mean)
    }
}

/// Training of a single view's network.
struct MonoTask<'a> {
    inputs: MonoInputs,
    training: &'a Encoded,
    validation: &'a Encoded,
    config: &'a MonoConfig,
    view: usize,
    /// The samples that the view saw.
    seen: Vec<usize>,
    setup: Setup,
}

impl Task for MonoTask<'_> {
    type Network = Dense;
    const NAME: &'static str = "mono_network";
    const STAGE: &'static str = "monoscopic network";

    fn judged_every(&self) -> usize {
        JUDGED_EVERY
    }

    fn setup(&mut self) -> &mut Setup {
        &mut self.setup
    }

    fn gradients(&mut self, network: &Dense, _step: usize) -> GradientsParams {
        let batch_size = self.config.optimisation.batch_size;
        let batch = draw(&self.seen, batch_size, &mut self.setup.random);
        let Setup { loss, device, .. } = &self.setup;
        let size = batch.len() as f32;
        let loss = loss_of_parts(network, batch.len(), device, |network, rows| {
            let batch = &batch[rows];
            let inputs = self.training.inputs(batch, self.view, device);
            let predicted = network.forward(self.inputs.of(inputs));
            let error = (self.training).squared_error(predicted, batch, size, *loss, device);
            (error, ())
        });
        loss.gradients
    }

    fn errors_pct(&self, network: &Dense) -> Vec<Option<f64>> {
        let (network, device) = (network.valid(), self.setup.plain_device());
        let predict = |features| network.forward(self.inputs.of(features));
        let loss = self.setup.loss;
        vec![(self.validation).view_error_pct(self.view, loss, &device, predict)]
    }

    fn record(&mut self, _done: usize, errors_pct: Vec<Option<f64>>) -> String {
        let error = errors_pct.into_iter().flatten().next();
        error.map_or_else(String::new, |error| format!("MAPE {error:.3} %"))
    }
}
