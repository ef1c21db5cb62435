//! Stage one: a calibration network per camera and one shared auxiliary head, trained by Algorithm 1.
//!
//! The loss of view i is its prediction error plus the distance from the mean prediction of the other views at the same tick
//! (equation (1)), without a gradient through the others. [`GapBalance`] decides which views train, using the validation side. The paper's
//! full-batch epochs are mini-batches here.
//! The stage ends on its plateau ([`crate::networks::stage`]): with every view within the gap threshold of the best, or with the gap that
//! is left after a cycle of the lagging views alone.

use std::ops::Range;

use burn::module::Module;
use burn::optim::GradientsParams;
use burn::tensor::{Device, Tensor};
use onnx_graph::Graph;
use rand_chacha::ChaCha12Rng;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::config::{CalibrationConfig, Target};
use crate::error::Result;
use crate::estimators::paper_lstm::gap_balance::GapBalance;
use crate::networks::dense::{Dense, widths};
use crate::networks::encoded::{Encoded, column, draw, mape_pct, numbers};
use crate::networks::normalisation::BOX_FEATURES;
use crate::networks::row_parts::{BatchLoss, loss_of_parts};
use crate::networks::running_mean::RunningMean;
use crate::networks::training_loop::{Companions, Learned, Setup, Task, learn};

/// The networks of stage one.
#[derive(Module, Debug)]
pub(crate) struct CalibrationNetworks {
    /// Networks from box features to feature vectors, one per view.
    views: Vec<Dense>,
    /// The shared auxiliary head, feature vector to distance.
    head: Dense,
}

impl CalibrationNetworks {
    /// Untrained networks.
    pub(crate) fn new(
        views: usize,
        config: &CalibrationConfig,
        random: &mut ChaCha12Rng,
        device: &Device,
    ) -> Self {
        Self {
            views: (0..views)
                .map(|_| {
                    Dense::new(
                        &widths(BOX_FEATURES, &config.hidden, config.features),
                        random,
                        device,
                    )
                })
                .collect(),
            head: Dense::new(
                &widths(config.features, &config.head_hidden, 1),
                random,
                device,
            ),
        }
    }

    /// Untrained networks of two views with 7 features.
    #[cfg(test)]
    pub(crate) fn narrow(device: &Device) -> Self {
        use rand::SeedableRng;

        let config = CalibrationConfig {
            hidden: vec![12, 9],
            features: 7,
            head_hidden: vec![5],
            ..CalibrationConfig::default()
        };
        Self::new(2, &config, &mut ChaCha12Rng::seed_from_u64(0), device)
    }

    /// Feature vectors for boxes in a single view, `[batch, 4]` to `[batch, features]`.
    pub(crate) fn features(&self, view: usize, boxes: Tensor<2>) -> Tensor<2> {
        self.views[view].forward(boxes)
    }

    /// Adds the feature vectors of a view to an ONNX graph.
    pub(crate) fn features_to_onnx(&self, graph: &mut Graph, view: usize, boxes: &str) -> String {
        self.views[view].to_onnx(graph, boxes)
    }

    /// The distance predicted from one view alone, in the coordinate of the loss, `[batch, 1]`.
    pub(crate) fn predict(&self, view: usize, boxes: Tensor<2>) -> Tensor<2> {
        self.head.forward(self.features(view, boxes))
    }

    /// Equivalent networks with centred and scaled features.
    pub(crate) fn with_scaled_features(self, means: &[f32], deviations: &[f32]) -> Self {
        let views = self.views.into_iter();
        Self {
            views: views
                .map(|network| network.with_scaled_outputs(means, deviations))
                .collect(),
            head: self.head.with_scaled_inputs(means, deviations),
        }
    }

    /// Shares all weights; the head gets no gradients.
    pub(crate) fn with_frozen_head(self) -> Self {
        Self {
            head: self.head.no_grad(),
            ..self
        }
    }
}

/// Entry of the convergence log.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct CalibrationLogEntry {
    /// Steps done.
    pub step: usize,
    /// Loss that was minimised, mean over the batches since the entry before.
    pub training_loss: Option<f64>,
    /// Error of each view's own prediction in these batches, percent; `null` for a view without samples there.
    pub training_mape_pct: Vec<Option<f64>>,
    /// Error of each view's own prediction on the validation side, percent; `null` for a view without samples there.
    pub validation_mape_pct: Vec<Option<f64>>,
    /// For each view, true if it was trained until the next entry.
    pub optimised: Vec<bool>,
}

/// Trains the networks, starting from random ones or from `start`.
pub(crate) fn train_calibration(
    start: Option<&CalibrationNetworks>,
    training: &Encoded,
    validation: &Encoded,
    config: &CalibrationConfig,
    mut setup: Setup,
    companions: &mut Companions,
) -> Result<(Learned<CalibrationNetworks>, Vec<CalibrationLogEntry>)> {
    let views = training.views();
    let random = CalibrationNetworks::new(views, config, &mut setup.random, &setup.device);
    let networks = start.map_or(random, |start| start.clone().train());
    let mut task = Calibration {
        training,
        validation,
        config,
        all: (0..training.len()).collect(),
        state: CalibrationState {
            balance: GapBalance::new(
                views,
                config.min_steps,
                config.plateau_threshold_pct,
                config.gap_threshold_pct,
            ),
            since_entry: SinceEntry::of(views),
            log: Vec::new(),
        },
        setup,
    };
    let learned = learn(&mut task, networks, &config.optimisation, companions)?;
    Ok((learned, task.state.log))
}

struct Calibration<'a> {
    training: &'a Encoded,
    validation: &'a Encoded,
    config: &'a CalibrationConfig,
    /// All samples of the training side.
    all: Vec<usize>,
    state: CalibrationState,
    setup: Setup,
}

#[derive(Clone, Serialize, Deserialize)]
struct CalibrationState {
    balance: GapBalance,
    since_entry: SinceEntry,
    log: Vec<CalibrationLogEntry>,
}

/// Means over the batches since the last entry.
#[derive(Clone, Serialize, Deserialize)]
struct SinceEntry {
    loss: RunningMean,
    /// Percentage error by view.
    errors_pct: Vec<RunningMean>,
}

impl SinceEntry {
    fn of(views: usize) -> Self {
        Self {
            loss: RunningMean::default(),
            errors_pct: vec![RunningMean::default(); views],
        }
    }

    /// Adds the loss and the predictions of a batch.
    fn add(
        &mut self,
        loss_value: f32,
        predictions: &[Vec<Vec<f32>>],
        samples: &Encoded,
        batch: &[usize],
        loss: Target,
    ) {
        self.loss.add(loss_value.into());
        for (view, mean) in self.errors_pct.iter_mut().enumerate() {
            let predicted = predictions
                .iter()
                .flat_map(|part| part[view].iter().copied());
            let seen = batch.iter().zip(predicted);
            let seen = seen.filter(|(sample, _)| samples.seen(**sample, view));
            let pairs = seen.map(|(&s, p)| (loss.distance(p), samples.distance(s)));
            if let Some(error_pct) = mape_pct(pairs) {
                mean.add(error_pct);
            }
        }
    }
}

impl Task for Calibration<'_> {
    type Network = CalibrationNetworks;
    const NAME: &'static str = "calibration networks";
    const STAGE: &'static str = "calibration networks";

    fn judged_every(&self) -> usize {
        self.config.log_every
    }

    fn setup(&mut self) -> &mut Setup {
        &mut self.setup
    }

    fn observe_plateau(&mut self, errors_pct: &[Option<f64>]) {
        self.state.balance.observe_plateau(errors_pct);
    }

    fn is_settled(&self) -> bool {
        self.state.balance.is_settled()
    }

    fn state(&self) -> serde_json::Result<Value> {
        serde_json::to_value(&self.state)
    }

    fn restore(&mut self, state: &Value) -> serde_json::Result<()> {
        self.state = CalibrationState::deserialize(state)?;
        Ok(())
    }

    fn gradients(&mut self, networks: &CalibrationNetworks, _step: usize) -> GradientsParams {
        let batch = draw(
            &self.all,
            self.config.optimisation.batch_size,
            &mut self.setup.random,
        );
        let CalibrationState {
            balance,
            since_entry,
            ..
        } = &mut self.state;
        let Setup { loss, device, .. } = &self.setup;
        let samples = self.training;
        // The head trains only together with all views.
        let head_trains = balance.all_optimised();
        let BatchLoss {
            value,
            gradients,
            predictions,
        } = loss_of_parts(networks, batch.len(), device, |networks, rows| {
            let trained = networks.clone();
            let trained = if head_trains {
                trained
            } else {
                trained.with_frozen_head()
            };
            batch_loss(
                &trained,
                samples,
                &batch,
                rows,
                balance.optimised(),
                *loss,
                device,
            )
        });
        since_entry.add(value, &predictions, samples, &batch, *loss);
        gradients
    }

    fn errors_pct(&self, networks: &CalibrationNetworks) -> Vec<Option<f64>> {
        validation_errors(
            &networks.valid(),
            self.validation,
            self.setup.loss,
            &self.setup.plain_device(),
        )
    }

    fn record(&mut self, done: usize, errors_pct: Vec<Option<f64>>) -> String {
        let CalibrationState {
            balance,
            since_entry,
            log,
        } = &mut self.state;
        let before = log.last().map_or(0, |entry| entry.step);
        if self.setup.plateau.is_none() {
            balance.observe(done - before, &errors_pct);
        }
        let note = errors_pct
            .iter()
            .map(|e| e.map_or("-".into(), |e| format!("{e:.2}")))
            .collect::<Vec<_>>();
        log.push(CalibrationLogEntry {
            step: done,
            training_loss: since_entry.loss.take(),
            training_mape_pct: since_entry
                .errors_pct
                .iter_mut()
                .map(RunningMean::take)
                .collect(),
            validation_mape_pct: errors_pct,
            optimised: balance.optimised().to_vec(),
        });
        format!("MAPE per view {} %", note.join(" / "))
    }
}

/// Sum of the optimised views' losses over some rows of `batch`, and each view's predictions.
pub(crate) fn batch_loss(
    networks: &CalibrationNetworks,
    samples: &Encoded,
    batch: &[usize],
    rows: Range<usize>,
    optimised: &[bool],
    loss: Target,
    device: &Device,
) -> (Tensor<1>, Vec<Vec<f32>>) {
    let predictions = predictions_of(networks, samples, &batch[rows.clone()], optimised, device);
    let total = loss_of(&predictions, samples, batch, rows, optimised, loss, device);
    let predictions = predictions.into_iter();
    (total, predictions.map(|p| numbers(p.inner())).collect())
}

/// Predictions from each view, with autodiff for those that are optimised.
fn predictions_of(
    networks: &CalibrationNetworks,
    samples: &Encoded,
    batch: &[usize],
    optimised: &[bool],
    device: &Device,
) -> Vec<Tensor<2>> {
    // Views that are not optimised are computed without autodiff: a graph that no backward pass consumes is never freed, and burn's
    // search for such graphs slows down every later step.
    let plain_device = device.clone().inner();
    let plain = networks.valid();
    (0..samples.views())
        .map(|view| {
            if optimised[view] {
                networks.predict(view, samples.inputs(batch, view, device))
            } else {
                Tensor::from_inner(plain.predict(view, samples.inputs(batch, view, &plain_device)))
            }
        })
        .collect()
}

/// Sum of the optimised views' losses over `rows` of `batch`; `predictions` are for these rows only.
fn loss_of(
    predictions: &[Tensor<2>],
    samples: &Encoded,
    batch: &[usize],
    rows: Range<usize>,
    optimised: &[bool],
    loss: Target,
    device: &Device,
) -> Tensor<1> {
    let views = samples.views();
    let targets = samples.target_column(&batch[rows.clone()], loss, device);
    let masks: Vec<Vec<f32>> = (0..views).map(|view| samples.mask(batch, view)).collect();
    let mut total = Tensor::<1>::zeros([1], device);
    for view in (0..views).filter(|&view| optimised[view]) {
        // Each mean is over the rows of the whole batch.
        let weights = |counts: &dyn Fn(usize) -> bool| {
            let counts = |row: usize| masks[view][row] > 0.0 && counts(row);
            let count = (0..batch.len()).filter(|&row| counts(row)).count().max(1);
            let weight = |row: usize| {
                if counts(row) {
                    loss.weight(samples.distance(batch[row])) / count as f32
                } else {
                    0.0
                }
            };
            column(rows.clone().map(weight).collect(), device)
        };
        let truth = (predictions[view].clone() - targets.clone()).square() * weights(&|_| true);
        total = total + truth.sum();
        let others: Vec<usize> = (0..views).filter(|&other| other != view).collect();
        let seen_by_others =
            |row: usize| others.iter().map(|&other| masks[other][row]).sum::<f32>();
        if (rows.clone()).any(|row| masks[view][row] > 0.0 && seen_by_others(row) > 0.0) {
            let mut mean = Tensor::<2>::zeros([rows.len(), 1], device);
            for &other in &others {
                let share = |row: usize| masks[other][row] / seen_by_others(row).max(1.0);
                mean = mean
                    + Tensor::from_inner(predictions[other].clone().inner())
                        * column(rows.clone().map(share).collect(), device);
            }
            let apart = (predictions[view].clone() - mean).square()
                * weights(&|row| seen_by_others(row) > 0.0);
            total = total + apart.sum();
        }
    }
    total
}

fn validation_errors(
    networks: &CalibrationNetworks,
    validation: &Encoded,
    loss: Target,
    device: &Device,
) -> Vec<Option<f64>> {
    (0..validation.views())
        .map(|view| {
            let seen = validation.seen_by(view);
            if seen.is_empty() {
                return None;
            }
            let predicted = numbers(networks.predict(view, validation.inputs(&seen, view, device)));
            mape_pct(
                seen.iter()
                    .zip(predicted)
                    .map(|(&s, p)| (loss.distance(p), validation.distance(s))),
            )
        })
        .collect()
}
