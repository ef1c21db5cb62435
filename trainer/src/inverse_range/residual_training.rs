//! Trains the networks of [`super::residual`]: that of the formula, and for each part of the flights that of the formula which did not see
//! them, all at once.
//!
//! Networks start at zero, where they change nothing. They learn from ticks that their formula learned from, under a loss that is square
//! for small errors and linear for large ones, because the latter are wrong shifts. The validation side decides whether they are kept.

use std::fmt;

use burn::module::Module;
use burn::optim::GradientsParams;
use burn::tensor::{Device, Tensor, TensorData};
use rand::RngExt;
use rand_chacha::ChaCha12Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::InverseRange;
use super::cross_fitted::CrossFitted;
use super::measurement::Measurement;
use super::residual::{Inputs, Residual, answered};
use crate::config::ResidualConfig;
use crate::dense::{Dense, LinearGradients, widths, zeros};
use crate::encoded::{column, numbers};
use crate::error::Result;
use crate::samples::Sample;
use crate::training_loop::{Task, Watch, learn};

/// Ticks that a network learns from at most: those of 30 pictures a second are much alike.
const MOST_TICKS: usize = 50_000;

/// What a network on the residual was worth (`run.json`): errors of `inverse_range` on the validation side where the fit with the network
/// applies, mean of their sizes, percent of the formula's distance (below 0.5 NM: of 0.5 NM).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct ResidualRecord {
    /// Of the formula alone.
    pub formula_mape_pct: f64,
    /// With the network.
    pub corrected_mape_pct: f64,
}

impl ResidualRecord {
    /// Whether `inverse_range` has the network.
    pub(crate) fn is_kept(&self) -> bool {
        self.corrected_mape_pct < self.formula_mape_pct
    }
}

impl fmt::Display for ResidualRecord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let is_kept = if self.is_kept() { "kept" } else { "dropped" };
        write!(
            f,
            "inverse_range is off by {:.4} % on the validation side, by {:.4} % with a network on its residual, which is {is_kept}",
            self.formula_mape_pct, self.corrected_mape_pct
        )
    }
}

impl CrossFitted {
    /// Trains networks on what the registered fit leaves that answers most ticks, keeps them if they improve the validation side, and says
    /// what they were worth; `None` where there is nothing to learn from or to judge by. `training`: what the fits were fitted to.
    pub(crate) fn learn_residuals(
        &mut self,
        training: &[&Sample],
        validation: &[Sample],
        config: &ResidualConfig,
        mut random: ChaCha12Rng,
        watch: &mut Watch,
    ) -> Result<Option<ResidualRecord>> {
        let Some(fit) = self.all.most_asked(training) else {
            return Ok(None);
        };
        let Some(of_all) = Trainee::of(&self.all, fit, training) else {
            return Ok(None);
        };
        let judged = validation.iter();
        let judged = LearnedTicks::of(&of_all.inputs, &answered(&self.all, fit, judged));
        if judged.targets.is_empty() {
            return Ok(None);
        }
        // A part whose others are too few does without.
        let others = self.parts.others(training).zip(&self.others);
        let of_parts: Vec<_> = others
            .map(|(others, fits)| Trainee::of(fits, fit, &others))
            .collect();
        let has_network: Vec<bool> = of_parts.iter().map(Option::is_some).collect();
        let of_parts = of_parts.into_iter().flatten();
        let trainees: Vec<_> = std::iter::once(of_all).chain(of_parts).collect();
        let settings = &config.optimisation;
        let networks = Networks::new(&trainees, &config.hidden, &mut random);
        let mut task = ResidualTask {
            trainees: &trainees,
            judged: &judged,
            batch_size: settings.batch_size,
            random,
        };
        let formula_mape_pct = task.mape_pct(&vec![0.0; judged.targets.len()]);
        let kept = learn(&mut task, networks, settings, watch)?;
        let record = ResidualRecord {
            formula_mape_pct,
            corrected_mape_pct: kept.error_pct,
        };
        watch.progress.say(&record.to_string());
        if record.is_kept() {
            let others = self.others.iter_mut().zip(has_network);
            let others = others.filter_map(|(fits, has_network)| has_network.then_some(fits));
            let fits = std::iter::once(&mut self.all).chain(others);
            for ((fits, trainee), network) in fits.zip(trainees).zip(&kept.network.of_trainees) {
                fits.residual = Some(Residual::new(trainee.inputs, network.layers()));
            }
        }
        Ok(Some(record))
    }
}

/// Ticks as a network sees them.
struct LearnedTicks {
    /// Numbers in a row.
    width: usize,
    /// Rows of inputs, one after the other.
    rows: Vec<f32>,
    /// What the network should predict for each.
    targets: Vec<f32>,
    /// What each counts for.
    precisions: Vec<f32>,
}

impl LearnedTicks {
    /// Ticks and what the formula measures there, without those whose registrations are impossible.
    fn of(inputs: &Inputs, answered: &[(&Sample, Measurement)]) -> Self {
        let mut ticks = Self {
            width: inputs.len(),
            rows: Vec::new(),
            targets: Vec::new(),
            precisions: Vec::new(),
        };
        for (sample, formula) in answered {
            if let Some(row) = inputs.at(sample, formula.distance_m) {
                ticks.rows.extend(row);
                let target = inputs.target(formula.distance_m, sample.dtd_m);
                ticks.targets.push(target);
                ticks.precisions.push(formula.precision as f32);
            }
        }
        ticks
    }

    /// Some rows, `[rows, inputs]`.
    fn inputs(&self, which: impl ExactSizeIterator<Item = usize>, device: &Device) -> Tensor<2> {
        let count = which.len();
        let rows = which.flat_map(|row| &self.rows[row * self.width..][..self.width]);
        Tensor::from_data(
            TensorData::new(rows.copied().collect::<Vec<f32>>(), [count, self.width]),
            device,
        )
    }
}

/// A formula, and what the network on its residual learns from.
struct Trainee {
    inputs: Inputs,
    ticks: LearnedTicks,
}

impl Trainee {
    /// `None` if there is too little to learn from.
    fn of(fits: &InverseRange, fit: usize, ticks: &[&Sample]) -> Option<Self> {
        let mut answered = answered(fits, fit, ticks.iter().copied());
        let step = answered.len().div_ceil(MOST_TICKS).max(1);
        let mut number = 0..;
        answered.retain(|_| number.next().is_some_and(|n: usize| n.is_multiple_of(step)));
        let inputs = Inputs::of(fit, &fits.fits[fit], &answered)?;
        let ticks = LearnedTicks::of(&inputs, &answered);
        (!ticks.targets.is_empty()).then_some(Self { inputs, ticks })
    }

    /// Gradients of the loss of a batch, the mean of `sqrt(1 + (precision * error)^2)`.
    fn gradients(&self, network: &Dense, batch: &[usize], device: &Device) -> Vec<LinearGradients> {
        let LearnedTicks {
            targets,
            precisions,
            ..
        } = &self.ticks;
        let (predicted, trace) = network.trace(self.ticks.inputs(batch.iter().copied(), device));
        let gradient = |(predicted, &row): (f32, &usize)| {
            let error = precisions[row] * (predicted - targets[row]);
            precisions[row] * error / (1.0 + error * error).sqrt() / batch.len() as f32
        };
        let gradients = numbers(predicted).into_iter().zip(batch).map(gradient);
        trace.back(column(gradients.collect(), device)).0
    }
}

/// Those of all formulas.
#[derive(Module, Debug)]
struct Networks {
    of_trainees: Vec<Dense>,
}

impl Networks {
    /// Networks that predict no error yet.
    fn new(trainees: &[Trainee], hidden: &[usize], random: &mut ChaCha12Rng) -> Self {
        let device = &Device::flex().autodiff();
        let network = |trainee: &Trainee| {
            let network = Dense::new(&widths(trainee.inputs.len(), hidden, 1), random, device);
            let inputs = network.last_inputs();
            network.with_last(zeros(inputs, 1, device))
        };
        let networks = Self {
            of_trainees: trainees.iter().map(network).collect(),
        };
        // Gradients are by hand, and what autodiff notes about the weights of each step it forgets only when it computes some.
        networks.no_grad()
    }
}

struct ResidualTask<'a> {
    trainees: &'a [Trainee],
    /// Of the first trainee, on the validation side.
    judged: &'a LearnedTicks,
    batch_size: usize,
    random: ChaCha12Rng,
}

impl ResidualTask<'_> {
    /// The error that remains where a network predicts these errors.
    fn mape_pct(&self, predicted: &[f32]) -> f64 {
        let apart = predicted
            .iter()
            .zip(&self.judged.targets)
            .map(|(predicted, target)| f64::from((target - predicted).abs()));
        100.0 * self.trainees[0].inputs.deviation * apart.sum::<f64>() / predicted.len() as f64
    }
}

impl Task for ResidualTask<'_> {
    type Network = Networks;
    type State = ();
    const NAME: &'static str = "network on the residual of inverse_range";
    const STAGE: &'static str = "residual of inverse_range";

    fn judged_every(&self) -> usize {
        250
    }

    fn random(&mut self) -> &mut ChaCha12Rng {
        &mut self.random
    }

    fn state(&self) {}

    fn restore(&mut self, (): ()) {}

    fn gradients(&mut self, networks: &Networks, _step: usize) -> GradientsParams {
        let plain = networks.valid();
        let device = &Device::flex();
        let batches: Vec<Vec<usize>> = (self.trainees.iter())
            .map(|trainee| {
                let rows = trainee.ticks.targets.len();
                (0..self.batch_size)
                    .map(|_| self.random.random_range(0..rows))
                    .collect()
            })
            .collect();
        let trainees = self
            .trainees
            .par_iter()
            .zip(&plain.of_trainees)
            .zip(&batches);
        let of_trainees: Vec<_> = trainees
            .map(|((trainee, network), batch)| trainee.gradients(network, batch, device))
            .collect();
        let mut gradients = GradientsParams::new();
        for (network, of_network) in plain.of_trainees.iter().zip(of_trainees) {
            network.register(of_network, &mut gradients);
        }
        gradients
    }

    fn errors_pct(&self, networks: &Networks) -> Vec<Option<f64>> {
        let inputs = self
            .judged
            .inputs(0..self.judged.targets.len(), &Device::flex());
        let predicted = numbers(networks.of_trainees[0].valid().forward(inputs));
        vec![Some(self.mape_pct(&predicted))]
    }

    fn record(&mut self, _done: usize, errors_pct: Vec<Option<f64>>) -> String {
        let error_pct = errors_pct[0].unwrap_or(f64::NAN);
        format!("MAPE {error_pct:.4} %")
    }
}

#[cfg(test)]
mod tests;
