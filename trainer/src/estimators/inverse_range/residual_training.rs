//! Training of the networks of [`super::residual`]: one for the formula, and for each part of the flights one for the formula that did not
//! see them, all at once.
//!
//! Networks start at zero, where they change no distance, or for a new camera ([`super::new_camera`]) from the existing network. They learn
//! from the ticks that their formula learned from, under a loss that is square for small errors and linear for large ones, because the
//! latter are wrong shifts. Flights that they did not learn from decide whether they are kept.

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
use super::measurement::{Measurement, scale_m};
use super::residual::{Inputs, Residual, answered};
use crate::config::ResidualConfig;
use crate::error::Result;
use crate::networks::dense::{Dense, Layer, LinearGradients, widths, zeros};
use crate::networks::encoded::{column, numbers};
use crate::networks::training_loop::{Companions, Task, learn};
use crate::samples::Sample;

/// Maximum number of ticks that a network learns from: at 30 images per second they are much alike.
const MOST_TICKS: usize = 50_000;
/// Steps between two looks at the flights that judge.
const JUDGED_EVERY: usize = 250;

/// Benefit of a network on the residual (`run.json`): errors of `inverse_range` on the validation side where the fit with the network
/// applies; mean absolute errors, percent of the formula's distance (below 0.5 NM: of 0.5 NM).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct ResidualRecord {
    /// Of the formula alone.
    pub formula_mape_pct: f64,
    /// With the network.
    pub corrected_mape_pct: f64,
}

impl ResidualRecord {
    /// True if `inverse_range` keeps the network.
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
    /// Trains networks on the residual of the registered fit that answers most ticks, keeps them if they improve the validation side, and
    /// returns their errors; `None` without ticks to learn from or to judge by. `training`: the samples that the fits were fitted to.
    pub(crate) fn learn_residuals(
        &mut self,
        training: &[&Sample],
        validation: &[Sample],
        config: &ResidualConfig,
        mut random: ChaCha12Rng,
        companions: &mut Companions,
    ) -> Result<Option<ResidualRecord>> {
        let Some(fit) = self.all.most_asked(training) else {
            return Ok(None);
        };
        let trainee = |fits: &InverseRange, training: &[&Sample], judges: &[_]| {
            let learned_from = thinned(answered(fits, fit, training));
            let inputs = Inputs::of(fit, &fits.fits[fit], &learned_from)?;
            Trainee::of(inputs, &learned_from, judges)
        };
        let judges = answered(&self.all, fit, &validation.iter().collect::<Vec<_>>());
        let Some(of_all) = trainee(&self.all, training, &judges) else {
            return Ok(None);
        };
        if !of_all.is_judged() {
            return Ok(None);
        }
        let others = self.parts.others(training).zip(&mut self.others);
        // A part whose others are too few does without.
        let others = others.filter_map(|(training, fits)| {
            let fits = fits.as_mut()?;
            Some((trainee(fits, &training, &[])?, fits))
        });
        let (of_parts, fits_of_parts): (Vec<_>, Vec<_>) = others.unzip();
        let trainees: Vec<_> = std::iter::once(of_all).chain(of_parts).collect();
        let networks = Networks::new(&trainees, &config.hidden, &mut random);
        let settings = &config.optimisation;
        let mut task = ResidualTask {
            trainees: &trainees,
            batch_size: settings.batch_size,
            random,
        };
        let kept = learn(&mut task, networks, settings, companions)?;
        let record = ResidualRecord {
            formula_mape_pct: formula_mape_pct(&judges),
            corrected_mape_pct: kept.error_pct,
        };
        companions.watch.say(&record.to_string());
        if record.is_kept() {
            let fits = std::iter::once(&mut self.all).chain(fits_of_parts);
            let residuals = kept.network.residuals(trainees);
            for (fits, residual) in fits.zip(residuals) {
                fits.residual = Some(residual);
            }
        }
        Ok(Some(record))
    }
}

/// Not more of them than a network learns from.
pub(super) fn thinned<T>(ticks: Vec<T>) -> Vec<T> {
    let step = ticks.len().div_ceil(MOST_TICKS).max(1);
    ticks.into_iter().step_by(step).collect()
}

/// Mean error of a formula at ticks that it answers, percent of its distances (below 0.5 NM: of 0.5 NM).
pub(super) fn formula_mape_pct(answered: &[(&Sample, Measurement)]) -> f64 {
    let error = |(sample, formula): &(&Sample, Measurement)| {
        (formula.distance_m - sample.dtd_m).abs() / scale_m(formula.distance_m)
    };
    100.0 * answered.iter().map(error).sum::<f64>() / answered.len() as f64
}

/// The errors that remain at the ticks that judge, if these errors are predicted of each trainee's.
fn mape_pct(trainees: &[Trainee], predicted: impl Fn(usize) -> Vec<f32>) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for (number, trainee) in trainees.iter().enumerate() {
        let targets = &trainee.judges.targets;
        let pairs = predicted(number).into_iter().zip(targets);
        let apart = pairs.map(|(predicted, target)| f64::from((target - predicted).abs()));
        sum += trainee.inputs.deviation * apart.sum::<f64>();
        count += targets.len();
    }
    100.0 * sum / count as f64
}

/// Ticks as a network sees them.
struct SeenTicks {
    /// Numbers in a row.
    width: usize,
    /// Rows of inputs, one after the other.
    rows: Vec<f32>,
    /// Target of the network for each tick.
    targets: Vec<f32>,
    /// Weight of each tick.
    precisions: Vec<f32>,
}

impl SeenTicks {
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

/// A formula, what the network on its residual learns from, and what judges it.
pub(super) struct Trainee {
    inputs: Inputs,
    ticks: SeenTicks,
    /// Of flights that neither learned from; there may be none.
    judges: SeenTicks,
}

impl Trainee {
    /// `None` without ticks to learn from.
    pub(super) fn of(
        inputs: Inputs,
        learned_from: &[(&Sample, Measurement)],
        judges: &[(&Sample, Measurement)],
    ) -> Option<Self> {
        let ticks = SeenTicks::of(&inputs, learned_from);
        let judges = SeenTicks::of(&inputs, judges);
        let trainee = Self {
            inputs,
            ticks,
            judges,
        };
        (!trainee.ticks.targets.is_empty()).then_some(trainee)
    }

    /// True if there are flights to judge it that it did not learn from.
    pub(super) fn is_judged(&self) -> bool {
        !self.judges.targets.is_empty()
    }

    /// Gradients of the loss of a batch, the mean of `sqrt(1 + (precision * error)^2)`.
    fn gradients(&self, network: &Dense, batch: &[usize], device: &Device) -> Vec<LinearGradients> {
        let SeenTicks {
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

/// Networks of all trainees.
#[derive(Module, Debug)]
pub(super) struct Networks {
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
        Self::of(trainees.iter().map(network).collect())
    }

    /// As many networks with these numbers.
    pub(super) fn alike(layers: &[Layer], count: usize) -> Self {
        let device = &Device::flex().autodiff();
        let network = |_| Dense::of_layers(layers, device);
        Self::of((0..count).map(network).collect())
    }

    fn of(of_trainees: Vec<Dense>) -> Self {
        // Gradients are by hand, and what autodiff notes about the weights of each step it forgets only when it computes some.
        Self { of_trainees }.no_grad()
    }

    /// Residual corrections for the formulas of these trainees.
    pub(super) fn residuals(&self, trainees: Vec<Trainee>) -> impl Iterator<Item = Residual> {
        let trainees = trainees.into_iter().zip(&self.of_trainees);
        trainees.map(|(trainee, network)| Residual {
            inputs: trainee.inputs,
            layers: network.layers(),
        })
    }
}

pub(super) struct ResidualTask<'a> {
    pub(super) trainees: &'a [Trainee],
    pub(super) batch_size: usize,
    pub(super) random: ChaCha12Rng,
}

impl ResidualTask<'_> {
    /// The errors that remain at the ticks that judge.
    pub(super) fn error_pct(&self, networks: &Networks) -> f64 {
        let plain = networks.valid();
        mape_pct(self.trainees, |trainee| {
            let judges = &self.trainees[trainee].judges;
            match judges.targets.len() {
                0 => Vec::new(),
                rows => {
                    let inputs = judges.inputs(0..rows, &Device::flex());
                    numbers(plain.of_trainees[trainee].forward(inputs))
                }
            }
        })
    }
}

impl Task for ResidualTask<'_> {
    type Network = Networks;
    type State = ();
    const NAME: &'static str = "network on the residual of inverse_range";
    const STAGE: &'static str = "residual of inverse_range";

    fn judged_every(&self) -> usize {
        JUDGED_EVERY
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
        vec![Some(self.error_pct(networks))]
    }

    fn record(&mut self, _done: usize, errors_pct: Vec<Option<f64>>) -> String {
        let error_pct = errors_pct[0].unwrap_or(f64::NAN);
        format!("MAPE {error_pct:.4} %")
    }
}

#[cfg(test)]
mod tests;
