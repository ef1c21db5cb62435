//! Stage two, `paper_lstm`: a stacked LSTM over the views' feature vectors, and a regression of its last output.
//!
//! The sequence runs over views, not over time: its length is the number of views that saw the aircraft. The calibration networks
//! are frozen. Whole views are dropped at random per mini-batch (see [`crate::view_dropout`]).

use burn::module::Module;
use burn::optim::GradientsParams;
use burn::tensor::{Device, Tensor};
use rand_chacha::ChaCha12Rng;
use serde::{Deserialize, Serialize};

use crate::calibration_training::CalibrationNetworks;
use crate::config::{EstimatorConfig, Loss};
use crate::dense::{Dense, widths};
use crate::encoded::{Encoded, column, draw, mape_pct, numbers};
use crate::error::{Error, Result};
use crate::head_refit::HeadRefit;
use crate::lstm::{StackedLstm, ViewFeatures};
use crate::schedule::{adam, learning_rate};
use crate::view_dropout::{BatchKind, ViewDropout, ViewSelection};
use dataset::progress::Progress;

/// The estimator behind the calibration networks.
#[derive(Module, Debug)]
pub(crate) struct PaperLstm {
    lstm: StackedLstm,
    head: Dense,
}

impl PaperLstm {
    /// An untrained estimator over feature vectors of length `features`.
    pub(crate) fn new(
        features: usize,
        config: &EstimatorConfig,
        random: &mut ChaCha12Rng,
        device: &Device,
    ) -> Self {
        let last = config.lstm.last().copied().unwrap_or(features);
        Self {
            lstm: StackedLstm::new(features, &config.lstm, random, device),
            head: Dense::new(&widths(last, &config.head_hidden, 1), random, device),
        }
    }

    /// Distances in the coordinate of the loss, `[batch, 1]`.
    pub(crate) fn forward(&self, views: &[ViewFeatures]) -> Tensor<2> {
        self.head.forward(self.lstm.forward(views))
    }
}

/// One entry of the convergence log.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct EstimatorLogEntry {
    /// Steps done.
    pub step: usize,
    /// Error over all validation samples, percent.
    pub validation_mape_pct: f64,
}

/// The training samples of the estimator.
pub(crate) struct TrainingSets<'a> {
    /// For batches of one view.
    pub alone: &'a Encoded,
    /// For batches of all views.
    pub together: &'a Encoded,
}

/// Trains the estimator on the features of trained calibration networks.
#[expect(
    clippy::too_many_arguments,
    reason = "two data sides, two settings, and what every training needs"
)]
pub(crate) fn train_estimator(
    calibration: &CalibrationNetworks,
    training: &TrainingSets,
    validation: &Encoded,
    config: &EstimatorConfig,
    features: usize,
    loss: Loss,
    random: &mut ChaCha12Rng,
    device: &Device,
    progress: &mut dyn Progress,
) -> Result<(PaperLstm, Vec<EstimatorLogEntry>)> {
    let steps = config.optimisation.steps;
    progress.begin("distance estimator", steps as u64);
    let plain_device = device.clone().inner();
    let dropout = ViewDropout::new(training.alone, training.together);
    let mut estimator = PaperLstm::new(features, config, random, device);
    let mut optimiser = adam();
    let mut log = Vec::new();
    for step in 0..steps {
        let only_together = (step as f64) < config.together_first * steps as f64;
        let kind = dropout
            .together()
            .filter(|_| only_together)
            .unwrap_or_else(|| dropout.draw(random));
        let BatchKind {
            selection,
            samples,
            from,
        } = kind;
        let batch = draw(from, config.optimisation.batch_size, random);
        let views: Vec<ViewFeatures> =
            features_of(calibration, samples, &batch, *selection, &plain_device)
                .into_iter()
                .map(|view| ViewFeatures {
                    features: Tensor::from_inner(view.features),
                    present: view.present.map(Tensor::from_inner),
                })
                .collect();
        let size = batch.len() as f32 / kind_weight(*selection, config);
        let weights = batch
            .iter()
            .map(|&sample| loss.weight(samples.distance(sample)) / size)
            .collect();
        let apart = estimator.forward(&views) - samples.target_column(&batch, loss, device);
        let gradients = (apart.square() * column(weights, device)).sum().backward();
        let gradients = GradientsParams::from_grads(gradients, &estimator);
        estimator = optimiser.step(
            learning_rate(&config.optimisation, step),
            estimator,
            gradients,
        );
        let done = step + 1;
        if done % config.log_every == 0 || done == steps {
            if done == steps && config.refit_head {
                estimator = refit_head(
                    calibration,
                    estimator.valid(),
                    &dropout,
                    config,
                    loss,
                    &plain_device,
                );
            }
            let predicted = predict(
                calibration,
                &estimator.valid(),
                validation,
                loss,
                &plain_device,
            );
            let pairs = predicted
                .into_iter()
                .enumerate()
                .map(|(sample, p)| (p, validation.distance(sample)));
            let Some(error) = mape_pct(pairs).filter(|error| error.is_finite()) else {
                return Err(Error::Diverged {
                    network: "paper_lstm".into(),
                    step: done,
                });
            };
            progress.advance(done as u64, &format!("MAPE {error:.3} %"));
            log.push(EstimatorLogEntry {
                step: done,
                validation_mape_pct: error,
            });
        }
    }
    Ok((estimator, log))
}

/// Weight of a batch's loss.
fn kind_weight(selection: ViewSelection, config: &EstimatorConfig) -> f32 {
    match selection {
        ViewSelection::Only(_) => config.alone_weight as f32,
        ViewSelection::All => 1.0,
    }
}

/// Samples predicted at once.
const CHUNK: usize = 2_048;

/// Predictions for all samples, units of 10 NM. Networks and device must be without autodiff.
pub(crate) fn predict(
    calibration: &CalibrationNetworks,
    estimator: &PaperLstm,
    samples: &Encoded,
    loss: Loss,
    device: &Device,
) -> Vec<f32> {
    let all: Vec<usize> = (0..samples.len()).collect();
    all.chunks(CHUNK)
        .flat_map(|batch| {
            numbers(estimator.forward(&features_of(
                calibration,
                samples,
                batch,
                ViewSelection::All,
                device,
            )))
        })
        .map(|predicted| loss.distance(predicted))
        .collect()
}

/// Solves the last layer over all kinds of batches that training draws, each with the same total weight as there.
fn refit_head(
    calibration: &CalibrationNetworks,
    estimator: PaperLstm,
    dropout: &ViewDropout,
    config: &EstimatorConfig,
    loss: Loss,
    device: &Device,
) -> PaperLstm {
    let mut refit = HeadRefit::new(estimator.head.last_inputs());
    for BatchKind {
        selection,
        samples,
        from,
    } in dropout.kinds()
    {
        let weight = kind_weight(*selection, config) / from.len() as f32;
        for batch in from.chunks(CHUNK) {
            let last = estimator.lstm.forward(&features_of(
                calibration,
                samples,
                batch,
                *selection,
                device,
            ));
            let hidden: Vec<f32> = estimator
                .head
                .hidden(last)
                .into_data()
                .try_into_vec()
                .expect("networks compute in f32");
            let of = |f: &dyn Fn(f32) -> f32| {
                batch
                    .iter()
                    .map(|&s| f(samples.distance(s)))
                    .collect::<Vec<_>>()
            };
            refit.add(
                &hidden,
                &of(&|d| loss.target(d)),
                &of(&|d| loss.weight(d) * weight),
            );
        }
    }
    match refit.solve(device) {
        Some(layer) => PaperLstm {
            head: estimator.head.with_last(layer),
            ..estimator
        },
        None => estimator,
    }
}

fn features_of(
    calibration: &CalibrationNetworks,
    samples: &Encoded,
    batch: &[usize],
    selection: ViewSelection,
    device: &Device,
) -> Vec<ViewFeatures> {
    let views = match selection {
        ViewSelection::Only(view) => view..view + 1,
        ViewSelection::All => 0..samples.views(),
    };
    views
        .map(|view| {
            let mask = samples.mask(batch, view);
            let all_present = mask.iter().all(|&present| present > 0.0);
            ViewFeatures {
                features: calibration.features(view, samples.inputs(batch, view, device)),
                present: (!all_present).then(|| column(mask, device)),
            }
        })
        .collect()
}
