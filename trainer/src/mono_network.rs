//! The monoscopic baseline as a network: one view's box to distance, each view separately, averaged over the views that saw it.

use burn::module::Module;
use burn::optim::GradientsParams;
use burn::tensor::{Device, Tensor};
use rand_chacha::ChaCha12Rng;
use serde::{Deserialize, Serialize};

use crate::config::{Loss, MonoConfig};
use crate::dense::{Dense, widths};
use crate::encoded::{Encoded, column, draw, numbers};
use crate::error::{Error, Result};
use crate::normalisation::BOX_FEATURES;
use crate::schedule::{adam, learning_rate};
use dataset::progress::Progress;

/// Which of a box's features the network sees.
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

    /// Trains the network of each view on what that view saw.
    pub(crate) fn train(
        inputs: MonoInputs,
        training: &Encoded,
        config: &MonoConfig,
        loss: Loss,
        random: &mut ChaCha12Rng,
        device: &Device,
        progress: &mut dyn Progress,
    ) -> Result<Self> {
        let settings = &config.optimisation;
        let untrained = Self::new(training.views(), inputs, config, random, device);
        progress.begin(
            "monoscopic networks",
            (settings.steps * training.views()) as u64,
        );
        let mut trained = Vec::new();
        for (view, mut network) in untrained.views.into_iter().enumerate() {
            let seen = training.seen_by(view);
            let mut optimiser = adam();
            for step in 0..if seen.is_empty() { 0 } else { settings.steps } {
                let batch = draw(&seen, settings.batch_size, random);
                let size = batch.len() as f32;
                let weights = batch
                    .iter()
                    .map(|&sample| loss.weight(training.distance(sample)) / size)
                    .collect();
                let apart = network.forward(inputs.of(training.inputs(&batch, view, device)))
                    - training.target_column(&batch, loss, device);
                let error = (apart.square() * column(weights, device)).sum();
                if step + 1 == settings.steps && !error.clone().into_scalar::<f32>().is_finite() {
                    return Err(Error::Diverged {
                        network: "mono_network".into(),
                        step,
                    });
                }
                let gradients = GradientsParams::from_grads(error.backward(), &network);
                network = optimiser.step(learning_rate(settings, step), network, gradients);
                if step % 100 == 99 {
                    progress.advance((view * settings.steps + step + 1) as u64, "");
                }
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
