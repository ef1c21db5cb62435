//! The monoscopic baseline as a network: one view's box to distance, each view separately, averaged over the views that saw it.

use burn::module::Module;
use burn::optim::GradientsParams;
use burn::tensor::{Device, Tensor};
use rand_chacha::ChaCha12Rng;
use serde::{Deserialize, Serialize};

use crate::config::{Loss, MonoConfig};
use crate::error::Result;
use crate::networks::dense::{Dense, widths};
use crate::networks::encoded::{Encoded, draw, numbers};
use crate::networks::estimator_graph::EstimatorGraph;
use crate::networks::normalisation::BOX_FEATURES;
use crate::networks::training_loop::{Companions, Setup, Task, learn};

/// Box features that the network sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum MonoInputs {
    /// Width and height: `mono_network`.
    Size,
    /// Centre and size: `mono_network_box`.
    Box,
}

impl MonoInputs {
    fn first_feature(self) -> usize {
        match self {
            Self::Size => 2,
            Self::Box => 0,
        }
    }

    fn of(self, features: Tensor<2>) -> Tensor<2> {
        let first = self.first_feature();
        features.narrow(1, first, BOX_FEATURES - first)
    }
}

/// One network per view.
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
        let widths = widths(BOX_FEATURES - inputs.first_feature(), &config.hidden, 1);
        Self {
            views: (0..views)
                .map(|_| Dense::new(&widths, random, device))
                .collect(),
        }
    }

    /// Trains the network of each view on the boxes of that view, starting from random networks or from `start`.
    pub(crate) fn train_from(
        start: Option<&Self>,
        inputs: MonoInputs,
        training: &Encoded,
        config: &MonoConfig,
        mut setup: Setup,
        companions: &mut Companions,
    ) -> Result<Self> {
        let settings = &config.optimisation;
        let views = training.views();
        let random = Self::new(views, inputs, config, &mut setup.random, &setup.device);
        let untrained = start.map_or(random, |start| start.clone().train());
        let mut task = MonoTask {
            inputs,
            training,
            batch_size: settings.batch_size,
            view: 0,
            seen: Vec::new(),
            last_error: 0.0,
            setup,
        };
        let mut trained = Vec::new();
        for (view, mut network) in untrained.views.into_iter().enumerate() {
            (task.view, task.seen) = (view, training.seen_by(view));
            if !task.seen.is_empty() {
                network = learn(&mut task, network, settings, companions)?.network;
            }
            trained.push(network);
        }
        Ok(Self { views: trained })
    }

    /// Mean over the views that saw each sample, units of 10 NM. Networks and device must be without autodiff.
    pub(crate) fn predict(
        &self,
        inputs: MonoInputs,
        samples: &Encoded,
        loss: Loss,
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
}

impl MonoNetworks {
    /// The mean in metres, in an ONNX graph.
    pub(crate) fn to_onnx(
        &self,
        inputs: MonoInputs,
        loss: Loss,
        graph: &mut EstimatorGraph,
    ) -> String {
        let (mut distances, mut presences) = (Vec::new(), Vec::new());
        for (view, network) in self.views.iter().enumerate() {
            let features = graph.features(view);
            let features = graph.some_of(&features, inputs.first_feature()..BOX_FEATURES);
            let predicted = network.to_onnx(&mut graph.graph, &features);
            let distance = graph.distance(predicted, loss);
            let present = graph.presence(view);
            distances.push(graph.graph.plain("Mul", &[&distance, &present]));
            presences.push(present);
        }
        let mut sum = |values: &[String]| {
            let values: Vec<&str> = values.iter().map(String::as_str).collect();
            graph.graph.plain("Sum", &values)
        };
        let (sum, count) = (sum(&distances), sum(&presences));
        let mean = graph.graph.plain("Div", &[&sum, &count]);
        graph.metres(&mean)
    }
}

/// The network of one view.
struct MonoTask<'a> {
    inputs: MonoInputs,
    training: &'a Encoded,
    batch_size: usize,
    view: usize,
    /// The samples that the view saw.
    seen: Vec<usize>,
    /// Of the last batch: these networks are not tuned on the validation side.
    last_error: f32,
    setup: Setup,
}

impl Task for MonoTask<'_> {
    type Network = Dense;
    type State = ();
    const NAME: &'static str = "mono_network";
    const STAGE: &'static str = "monoscopic network";

    fn judged_every(&self) -> usize {
        100
    }

    fn random(&mut self) -> &mut ChaCha12Rng {
        &mut self.setup.random
    }

    fn state(&self) {}

    fn restore(&mut self, (): ()) {}

    fn gradients(&mut self, network: &Dense, _step: usize) -> GradientsParams {
        let batch = draw(&self.seen, self.batch_size, &mut self.setup.random);
        let Setup { loss, device, .. } = &self.setup;
        let inputs = self.training.inputs(&batch, self.view, device);
        let predicted = network.forward(self.inputs.of(inputs));
        let size = batch.len() as f32;
        let error = (self.training).squared_error(predicted, &batch, size, *loss, device);
        self.last_error = error.clone().into_scalar();
        GradientsParams::from_grads(error.backward(), network)
    }

    fn errors_pct(&self, _network: &Dense) -> Vec<Option<f64>> {
        vec![Some(f64::from(self.last_error))]
    }

    fn record(&mut self, _done: usize, _errors_pct: Vec<Option<f64>>) -> String {
        String::new()
    }
}
