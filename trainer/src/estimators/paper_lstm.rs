//! Stage two, `paper_lstm`: a stacked LSTM over the views' feature vectors, and a regression on the last output.
//!
//! The sequence runs over views, not over time: its length is the number of views that saw the aircraft. The calibration networks
//! are frozen. Whole views are dropped at random per mini-batch (see [`crate::networks::view_dropout`]).

pub(crate) mod calibration_training;
pub(crate) mod gap_balance;
pub(crate) mod white_features;

use burn::module::Module;
use burn::optim::GradientsParams;
use burn::tensor::{Device, Tensor};
use rand_chacha::ChaCha12Rng;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::config::{EstimatorConfig, Optimisation, Target};
use crate::error::Result;
use crate::estimators::paper_lstm::calibration_training::CalibrationNetworks;
use crate::networks::dense::{Dense, widths};
use crate::networks::encoded::{Encoded, EncodedSides, column, draw, mape_pct, numbers};
use crate::networks::estimator_graph::EstimatorGraph;
use crate::networks::lstm::{StackedLstm, ViewFeatures};
use crate::networks::row_parts::{BatchLoss, loss_of_parts};
use crate::networks::running_mean::RunningMean;
use crate::networks::stage::cycle_of;
use crate::networks::training_loop::{Companions, Learned, Setup, Task, learn};
use crate::networks::view_dropout::{BatchKind, ViewDropout, ViewSelection};

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

    /// The distance in metres, with these calibration networks, in an ONNX graph.
    pub(crate) fn to_onnx(
        &self,
        calibration: &CalibrationNetworks,
        loss: Target,
        graph: &mut EstimatorGraph,
    ) -> String {
        let views: Vec<[String; 2]> = (0..graph.views())
            .map(|view| {
                let boxes = graph.features(view);
                let features = calibration.features_to_onnx(&mut graph.graph, view, &boxes);
                [features, graph.presence(view)]
            })
            .collect();
        let last = self.lstm.to_onnx(&mut graph.graph, &views);
        let predicted = self.head.to_onnx(&mut graph.graph, &last);
        let distance = graph.distance(predicted, loss);
        graph.metres(&distance)
    }
}

/// Entry of the convergence log.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct EstimatorLogEntry {
    /// Steps done.
    pub step: usize,
    /// Loss that was minimised, mean over the batches since the entry before.
    pub training_loss: Option<f64>,
    /// Error in the batches of all views since then, percent; `null` if there was none.
    pub training_mape_pct: Option<f64>,
    /// Error over all validation samples, percent.
    pub validation_mape_pct: f64,
}

/// Trains the estimator on the features, vectors of length `features`, of trained calibration networks: from a random one or `start`.
pub(crate) fn train_estimator(
    start: Option<&PaperLstm>,
    calibration: &CalibrationNetworks,
    sides: &EncodedSides,
    config: &EstimatorConfig,
    features: usize,
    mut setup: Setup,
    companions: &mut Companions,
) -> Result<(Learned<PaperLstm>, Vec<EstimatorLogEntry>)> {
    let random = PaperLstm::new(features, config, &mut setup.random, &setup.device);
    let estimator = start.map_or(random, |start| start.clone().train());
    let mut task = EstimatorTask {
        calibration,
        dropout: ViewDropout::new(&sides.training),
        training: &sides.training,
        validation: &sides.validation,
        config,
        state: EstimatorState::default(),
        setup,
    };
    let learned = learn(&mut task, estimator, &config.optimisation, companions)?;
    Ok((learned, task.state.log))
}

struct EstimatorTask<'a> {
    calibration: &'a CalibrationNetworks,
    dropout: ViewDropout,
    training: &'a Encoded,
    validation: &'a Encoded,
    config: &'a EstimatorConfig,
    state: EstimatorState,
    setup: Setup,
}

#[derive(Clone, Default, Serialize, Deserialize)]
struct EstimatorState {
    /// Means over the batches since the last entry.
    loss: RunningMean,
    error_pct: RunningMean,
    log: Vec<EstimatorLogEntry>,
}

impl Task for EstimatorTask<'_> {
    type Network = PaperLstm;
    const NAME: &'static str = "paper_lstm";
    const STAGE: &'static str = "distance estimator";

    fn judged_every(&self) -> usize {
        self.config.log_every
    }

    fn setup(&mut self) -> &mut Setup {
        &mut self.setup
    }

    fn state(&self) -> serde_json::Result<Value> {
        serde_json::to_value(&self.state)
    }

    fn restore(&mut self, state: &Value) -> serde_json::Result<()> {
        self.state = EstimatorState::deserialize(state)?;
        Ok(())
    }

    fn gradients(&mut self, estimator: &PaperLstm, step: usize) -> GradientsParams {
        let plain_device = self.setup.plain_device();
        let Setup {
            loss,
            device,
            random,
            plateau,
        } = &mut self.setup;
        let Optimisation {
            steps, batch_size, ..
        } = self.config.optimisation;
        let first_cycle = cycle_of(0, steps, *plateau).len();
        let only_together = (step as f64) < self.config.together_first * first_cycle as f64;
        let samples = self.training;
        let BatchKind { selection, from } = (self.dropout.together())
            .filter(|_| only_together)
            .unwrap_or_else(|| self.dropout.draw(random));
        let batch = draw(from, batch_size, random);
        let size = batch.len() as f32 / kind_weight(*selection, self.config);
        let BatchLoss {
            value,
            gradients,
            predictions,
        } = loss_of_parts(estimator, batch.len(), device, |estimator, rows| {
            let batch = &batch[rows];
            let views = features_of(self.calibration, samples, batch, *selection, &plain_device);
            let views: Vec<_> = views.into_iter().map(ViewFeatures::with_autodiff).collect();
            let predicted = estimator.forward(&views);
            let error = samples.squared_error(predicted.clone(), batch, size, *loss, device);
            (error, numbers(predicted.inner()))
        });
        self.state.loss.add(value.into());
        if *selection == ViewSelection::All {
            let predicted = predictions.into_iter().flatten();
            let pairs = predicted.map(|p| loss.distance(p)).zip(&batch);
            let error_pct = mape_pct(pairs.map(|(p, &sample)| (p, samples.distance(sample))));
            self.state.error_pct.add(error_pct.unwrap_or(f64::NAN));
        }
        gradients
    }

    fn errors_pct(&self, estimator: &PaperLstm) -> Vec<Option<f64>> {
        let predicted = predict(
            self.calibration,
            &estimator.valid(),
            self.validation,
            self.setup.loss,
            &self.setup.plain_device(),
        );
        let pairs = predicted
            .into_iter()
            .enumerate()
            .map(|(sample, p)| (p, self.validation.distance(sample)));
        vec![mape_pct(pairs)]
    }

    fn record(&mut self, done: usize, errors_pct: Vec<Option<f64>>) -> String {
        let EstimatorState {
            loss,
            error_pct,
            log,
        } = &mut self.state;
        let entries = errors_pct.into_iter().flatten();
        let entries = entries.map(|validation_mape_pct| EstimatorLogEntry {
            step: done,
            training_loss: loss.take(),
            training_mape_pct: error_pct.take(),
            validation_mape_pct,
        });
        log.extend(entries);
        let error = log.last().map(|entry| entry.validation_mape_pct);
        error.map_or_else(String::new, |error| format!("MAPE {error:.3} %"))
    }
}

/// Loss weight by kind of batch.
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
    loss: Target,
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

/// Features of the selected views; on an autodiff device, with gradients for the networks that train.
pub(crate) fn features_of(
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
