//! Stage one: a calibration network per camera and one shared auxiliary head, trained by Algorithm 1.
//!
//! The loss of view i is its prediction error plus the distance from the mean prediction of the other views at the same tick
//! (equation (1)), without a gradient through the others. [`GapBalance`] decides which views train. The paper's full-batch epochs are
//! mini-batches here, and the errors that it decides by are means over a pass of them.

use std::ops::Range;

use burn::module::Module;
use burn::optim::GradientsParams;
use burn::tensor::{Device, Tensor};
use dataset::numbers::least_squares::CholeskyFactor;
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
        let view_widths = widths(BOX_FEATURES, &config.hidden, config.features);
        let head_widths = widths(config.features, &config.head_hidden, 1);
        let view = |_| Dense::new(&view_widths, random, device);
        Self {
            views: (0..views).map(view).collect(),
            head: Dense::new(&head_widths, random, device),
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

    /// Equivalent networks with centred and whitened features.
    pub(crate) fn with_white_features(self, means: &[f64], factor: &CholeskyFactor) -> Self {
        let views = self.views.into_iter();
        Self {
            views: views
                .map(|network| network.with_white_outputs(means, factor))
                .collect(),
            head: self.head.with_white_inputs(means, factor),
        }
    }

    /// Shares all weights; only the given views, and the head if `head_trains`, get gradients. burn keeps no graph of the others: a graph
    /// that no backward pass consumes is never freed, and slows down every later step.
    pub(crate) fn training_only(&self, views: &[bool], head_trains: bool) -> Self {
        let part = |part: &Dense, trains: bool| {
            if trains {
                part.clone()
            } else {
                part.clone().no_grad()
            }
        };
        let views = self.views.iter().zip(views);
        Self {
            views: views.map(|(view, &trains)| part(view, trains)).collect(),
            head: part(&self.head, head_trains),
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
            since_entry: SinceEntry {
                loss: RunningMean::default(),
                errors_pct: vec![RunningMean::default(); views],
            },
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
    /// Adds the loss and the predictions of a batch.
    fn add(
        &mut self,
        of_batch: &BatchLoss<Vec<Vec<f32>>>,
        samples: &Encoded,
        batch: &[usize],
        loss: Target,
    ) {
        self.loss.add(of_batch.value.into());
        for (view, mean) in self.errors_pct.iter_mut().enumerate() {
            let predicted = of_batch
                .predictions
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

impl Calibration<'_> {
    /// Mini-batches with as many samples as the training side.
    fn pass_steps(&self) -> usize {
        let batch_size = self.config.optimisation.batch_size;
        self.training.len().div_ceil(batch_size)
    }
}

impl Task for Calibration<'_> {
    type Network = CalibrationNetworks;
    const NAME: &'static str = "calibration networks";
    const STAGE: &'static str = "calibration networks";

    fn judged_every(&self) -> usize {
        self.config.log_every.max(self.pass_steps())
    }

    fn setup(&mut self) -> &mut Setup {
        &mut self.setup
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
        let of_batch = trained_loss(networks, samples, &batch, balance, *loss, device);
        since_entry.add(&of_batch, samples, &batch, *loss);
        of_batch.gradients
    }

    fn errors_pct(&self, networks: &CalibrationNetworks) -> Vec<Option<f64>> {
        let (networks, loss) = (networks.valid(), self.setup.loss);
        let device = &self.setup.plain_device();
        let error_pct = |view| {
            let predict = |boxes| networks.predict(view, boxes);
            self.validation.view_error_pct(view, loss, device, predict)
        };
        (0..self.validation.views()).map(error_pct).collect()
    }

    fn record(&mut self, done: usize, errors_pct: Vec<Option<f64>>) -> String {
        let pass_steps = self.pass_steps();
        let CalibrationState {
            balance,
            since_entry,
            log,
        } = &mut self.state;
        let before = log.last().map_or(0, |entry| entry.step);
        let training_mape_pct: Vec<_> = since_entry
            .errors_pct
            .iter_mut()
            .map(RunningMean::take)
            .collect();
        // The last entry of a cycle may follow the one before too closely.
        if done - before >= pass_steps {
            balance.observe(done - before, &training_mape_pct);
        }
        let note = errors_pct
            .iter()
            .map(|e| e.map_or("-".into(), |e| format!("{e:.2}")))
            .collect::<Vec<_>>();
        log.push(CalibrationLogEntry {
            step: done,
            training_loss: since_entry.loss.take(),
            training_mape_pct,
            validation_mape_pct: errors_pct,
            optimised: balance.optimised().to_vec(),
        });
        format!("MAPE per view {} %", note.join(" / "))
    }
}

/// Loss and gradients of the views that train, and the predictions of all views by part and view. The head trains only together with all
/// views.
fn trained_loss(
    networks: &CalibrationNetworks,
    samples: &Encoded,
    batch: &[usize],
    balance: &GapBalance,
    loss: Target,
    device: &Device,
) -> BatchLoss<Vec<Vec<f32>>> {
    let optimised = balance.optimised();
    let trained = networks.training_only(optimised, balance.all_optimised());
    loss_of_parts(&trained, batch.len(), device, |networks, rows| {
        batch_loss(networks, samples, batch, rows, optimised, loss, device)
    })
}

/// Sum of the optimised views' losses over some rows of `batch`, and each view's predictions for these rows.
pub(crate) fn batch_loss(
    networks: &CalibrationNetworks,
    samples: &Encoded,
    batch: &[usize],
    rows: Range<usize>,
    optimised: &[bool],
    loss: Target,
    device: &Device,
) -> (Tensor<1>, Vec<Vec<f32>>) {
    let views = samples.views();
    let predict = |view| networks.predict(view, samples.inputs(&batch[rows.clone()], view, device));
    let predictions: Vec<_> = (0..views).map(predict).collect();
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
    let predictions = predictions.into_iter();
    (total, predictions.map(|p| numbers(p.inner())).collect())
}

#[cfg(test)]
mod tests {
    use burn::module::{ModuleVisitor, Param};

    use super::*;
    use crate::config::Loss;
    use crate::networks::encoded::boxes_of_two_views;

    /// Compares the gradients of all parameters, and counts parameters with gradients.
    struct Comparison<'a> {
        found: &'a GradientsParams,
        expected: &'a GradientsParams,
        trained: usize,
    }

    impl ModuleVisitor for Comparison<'_> {
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            let numbers = |all: &GradientsParams| {
                let gradient = all.get::<D>(param.id)?;
                Some(gradient.into_data().try_into_vec::<f32>().unwrap())
            };
            match (numbers(self.found), numbers(self.expected)) {
                (None, None) => {}
                (Some(found), Some(expected)) => {
                    let largest = expected.iter().fold(0.0_f32, |most, e| most.max(e.abs()));
                    let mut pairs = found.iter().zip(&expected);
                    assert!(largest > 0.0 && found.len() == expected.len());
                    assert!(pairs.all(|(f, e)| (f - e).abs() <= 1e-5 * largest));
                    self.trained += 1;
                }
                (found, expected) => panic!("{found:?} {expected:?}"),
            }
        }
    }

    #[test]
    fn parts_of_a_batch_give_the_gradients_of_the_whole_with_boxes_missing_and_a_view_that_lags() {
        let samples = boxes_of_two_views();
        let batch: Vec<usize> = (0..samples.len()).cycle().take(600).collect();
        let device = Device::flex().autodiff();
        let networks = CalibrationNetworks::narrow(&device);
        let mut balance = GapBalance::new(2, 0, 0.1, 0.2);
        for lags in [false, true] {
            if lags {
                (0..20).for_each(|_| balance.observe(100, &[Some(1.0), Some(3.0)]));
            }
            let whole = networks.training_only(balance.optimised(), !lags);
            assert_eq!(balance.all_optimised(), !lags);
            for loss in [Loss::Squared, Loss::Relative] {
                let loss = Target {
                    loss,
                    per_10_nm: 2.0,
                };
                let (optimised, rows) = (balance.optimised(), 0..batch.len());
                let (total, _) =
                    batch_loss(&whole, &samples, &batch, rows, optimised, loss, &device);
                let expected_value: f32 = total.clone().into_scalar();
                let expected = GradientsParams::from_grads(total.backward(), &whole);
                let found = trained_loss(&networks, &samples, &batch, &balance, loss, &device);
                assert!((found.value / expected_value - 1.0).abs() < 1e-5);
                let mut comparison = Comparison {
                    found: &found.gradients,
                    expected: &expected,
                    trained: 0,
                };
                networks.visit(&mut comparison);
                let trained = if lags { 6 } else { 2 * 6 + 4 };
                assert_eq!(comparison.trained, trained);
            }
        }
    }
}
