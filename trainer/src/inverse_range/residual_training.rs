//! Trains the networks of [`super::residual`]: that of the formula, and for each part of the flights that of the formula which did not see
//! them, all at once.
//!
//! Networks start at zero, where they change nothing. They learn from the ticks that their formula learned from, under a loss that is square
//! for small errors and linear for large ones, because the latter are wrong shifts. The validation side decides whether they are kept.

use std::fmt;

use burn::module::Module;
use burn::optim::GradientsParams;
use burn::tensor::{Device, Tensor, TensorData};
use dataset::splits::Side;
use rand::RngExt;
use rand_chacha::ChaCha12Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::InverseRange;
use super::cross_fitted::CrossFitted;
use super::residual::{Inputs, Residual, answered_by_first};
use crate::config::ResidualConfig;
use crate::dense::{Dense, LinearGradients, widths, zeros};
use crate::encoded::{column, numbers};
use crate::error::Result;
use crate::flight_parts::FlightParts;
use crate::samples::{Sample, Samples};
use crate::training_loop::{Task, Watch, learn};

/// Ticks that a network learns from at most: those of 30 pictures a second are much alike.
const MOST_TICKS: usize = 50_000;

/// What a network on the residual was worth (`run.json`): errors of `inverse_range` on the validation side where its most precise fit
/// answers, mean of their sizes, percent of the distance (below 0.5 NM: of 0.5 NM).
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
    /// Trains networks on what the most precise fit leaves, keeps them if they improve the validation side, and says what they were worth;
    /// `None` where there is nothing to learn from or to judge by. `training`: what the fits were fitted to.
    pub(crate) fn learn_residuals(
        &mut self,
        samples: &Samples,
        training: &[&Sample],
        validation: &[Sample],
        config: &ResidualConfig,
        mut random: ChaCha12Rng,
        watch: &mut Watch,
    ) -> Result<Option<ResidualRecord>> {
        let parts = FlightParts::of(samples, samples.ticks_of_side(Side::Train));
        let others = parts.others(training).zip(&self.others);
        let of_parts = others.map(|(others, fits)| Pupil::of(fits, &others));
        let of_all = std::iter::once(Pupil::of(&self.all, training));
        let pupils: Option<Vec<_>> = of_all.chain(of_parts).collect();
        let Some(pupils) = pupils else {
            return Ok(None);
        };
        let judged = Lesson::of(&self.all, &pupils[0].inputs, validation.iter());
        if judged.targets.is_empty() {
            return Ok(None);
        }
        let settings = &config.optimisation;
        let networks = Networks::new(&pupils, &config.hidden, &mut random);
        let mut task = ResidualTask {
            pupils: &pupils,
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
            let fits = std::iter::once(&mut self.all).chain(&mut self.others);
            for ((fits, pupil), network) in fits.zip(pupils).zip(&kept.network.of_pupils) {
                fits.residual = Some(Residual::new(pupil.inputs, network.layers()));
            }
        }
        Ok(Some(record))
    }
}

/// Ticks as a network sees them.
struct Lesson {
    /// Numbers in a row.
    width: usize,
    /// Rows of inputs, one after the other.
    rows: Vec<f32>,
    /// What the network should tell of each.
    targets: Vec<f32>,
    /// What each counts for.
    precisions: Vec<f32>,
}

impl Lesson {
    /// Those of the ticks that the most precise fit answers.
    fn of<'a>(
        fits: &InverseRange,
        inputs: &Inputs,
        ticks: impl Iterator<Item = &'a Sample>,
    ) -> Self {
        let mut lesson = Self {
            width: inputs.len(),
            rows: Vec::new(),
            targets: Vec::new(),
            precisions: Vec::new(),
        };
        for (sample, formula) in answered_by_first(fits, ticks) {
            if let Some(row) = inputs.at(sample, formula.distance_m) {
                lesson.rows.extend(row);
                lesson
                    .targets
                    .push(inputs.target(formula.distance_m, sample.dtd_m));
                lesson.precisions.push(formula.precision as f32);
            }
        }
        lesson
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
struct Pupil {
    inputs: Inputs,
    lesson: Lesson,
}

impl Pupil {
    /// `None` if there is no fit, or too little to learn from.
    fn of(fits: &InverseRange, ticks: &[&Sample]) -> Option<Self> {
        let step = ticks.len().div_ceil(MOST_TICKS).max(1);
        let ticks = || ticks.iter().copied().step_by(step);
        let fit = fits.fits.first()?;
        let inputs = Inputs::of(fit, &answered_by_first(fits, ticks()))?;
        Some(Self {
            lesson: Lesson::of(fits, &inputs, ticks()),
            inputs,
        })
    }

    /// Gradients of the loss of a batch, the mean of `sqrt(1 + (precision * error)^2)`.
    fn gradients(&self, network: &Dense, batch: &[usize], device: &Device) -> Vec<LinearGradients> {
        let Lesson {
            targets,
            precisions,
            ..
        } = &self.lesson;
        let (told, trace) = network.trace(self.lesson.inputs(batch.iter().copied(), device));
        let gradient = |(told, &row): (f32, &usize)| {
            let error = precisions[row] * (told - targets[row]);
            precisions[row] * error / (1.0 + error * error).sqrt() / batch.len() as f32
        };
        let gradients = numbers(told).into_iter().zip(batch).map(gradient);
        trace.back(column(gradients.collect(), device)).0
    }
}

/// Those of all formulas.
#[derive(Module, Debug)]
struct Networks {
    of_pupils: Vec<Dense>,
}

impl Networks {
    /// Networks that tell of no error yet.
    fn new(pupils: &[Pupil], hidden: &[usize], random: &mut ChaCha12Rng) -> Self {
        let device = &Device::flex().autodiff();
        let network = |pupil: &Pupil| {
            let network = Dense::new(&widths(pupil.inputs.len(), hidden, 1), random, device);
            let inputs = network.last_inputs();
            network.with_last(zeros(inputs, 1, device))
        };
        Self {
            of_pupils: pupils.iter().map(network).collect(),
        }
    }
}

struct ResidualTask<'a> {
    pupils: &'a [Pupil],
    /// Of the first pupil, on the validation side.
    judged: &'a Lesson,
    batch_size: usize,
    random: ChaCha12Rng,
}

impl ResidualTask<'_> {
    /// The error that remains where a network tells these errors.
    fn mape_pct(&self, told: &[f32]) -> f64 {
        let apart = told
            .iter()
            .zip(&self.judged.targets)
            .map(|(told, target)| f64::from((target - told).abs()));
        100.0 * self.pupils[0].inputs.deviation * apart.sum::<f64>() / told.len() as f64
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
        let batches: Vec<Vec<usize>> = (self.pupils.iter())
            .map(|pupil| {
                let rows = pupil.lesson.targets.len();
                (0..self.batch_size)
                    .map(|_| self.random.random_range(0..rows))
                    .collect()
            })
            .collect();
        let pupils = self.pupils.par_iter().zip(&plain.of_pupils).zip(&batches);
        let of_pupils: Vec<_> = pupils
            .map(|((pupil, network), batch)| pupil.gradients(network, batch, device))
            .collect();
        let mut gradients = GradientsParams::new();
        for (network, of_network) in plain.of_pupils.iter().zip(of_pupils) {
            network.register(of_network, &mut gradients);
        }
        gradients
    }

    fn errors_pct(&self, networks: &Networks) -> Vec<Option<f64>> {
        let inputs = self
            .judged
            .inputs(0..self.judged.targets.len(), &Device::flex());
        let told = numbers(networks.of_pupils[0].valid().forward(inputs));
        vec![Some(self.mape_pct(&told))]
    }

    fn record(&mut self, _done: usize, errors_pct: Vec<Option<f64>>) -> String {
        let error_pct = errors_pct[0].unwrap_or(f64::NAN);
        format!("MAPE {error_pct:.4} %")
    }
}

#[cfg(test)]
mod tests;
