//! Training loop of all networks in this crate.
//!
//! Calibration networks, distance estimator and monoscopic networks differ in batches, losses and reactions to errors: a [`Task`].
//! Optimiser, learning rate, judging, checkpoints and the handling of divergence are the same.
//!
//! The detector has a separate loop (`detector-training`): it may run for minutes instead of steps, and collects hard backgrounds.

use std::ops::Range;

use burn::module::Module;
use burn::optim::{AdamConfig, GradientsParams, ModuleOptimizer};
use burn::tensor::Device;
use dataset::work::watch::Watch;
use rand_chacha::ChaCha12Rng;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::config::{Optimisation, Plateau, Target};
use crate::error::{Error, Result};
use crate::networks::checkpoint::{Checkpoints, Reached, RunningWeights};
use crate::networks::stage::{Cycle, EndedBy, StageSummary, cycle_of, is_reached};

/// Share of a cycle's steps during which the rate rises.
const WARM_UP_SHARE: f64 = 0.02;
/// Final rate as a share of the highest.
const FINAL_RATE_SHARE: f64 = 1e-3;

/// Learning rate within a cycle: a linear rise, then half a cosine.
fn learning_rate(highest: f64, cycle: &Range<usize>, step: usize) -> f64 {
    let part = ((step - cycle.start) as f64 + 0.5) / cycle.len() as f64;
    let factor = if part < WARM_UP_SHARE {
        part / WARM_UP_SHARE
    } else {
        let fallen = (part - WARM_UP_SHARE) / (1.0 - WARM_UP_SHARE);
        FINAL_RATE_SHARE
            + (1.0 - FINAL_RATE_SHARE) * 0.5 * (1.0 + (std::f64::consts::PI * fallen).cos())
    };
    highest * factor
}

/// Task inputs besides samples and settings.
pub(crate) struct Setup {
    pub(crate) loss: Target,
    /// Device with autodiff.
    pub(crate) device: Device,
    /// Draws first weights and batches.
    pub(crate) random: ChaCha12Rng,
    /// Ends the training before all steps are made.
    pub(crate) plateau: Option<Plateau>,
}

impl Setup {
    /// The device without autodiff, for judging.
    pub(crate) fn plain_device(&self) -> Device {
        self.device.clone().inner()
    }
}

/// Checkpoints and observer of a training.
pub(crate) struct Companions<'a> {
    pub(crate) checkpoints: &'a mut Checkpoints,
    /// Shows progress, and may stop the training.
    pub(crate) watch: &'a dyn Watch,
}

/// Training task.
pub(crate) trait Task {
    type Network: Module;
    /// Name in errors.
    const NAME: &'static str;
    /// Name in the display of progress.
    const STAGE: &'static str;
    /// Inputs, with the random numbers that draw the batches.
    fn setup(&mut self) -> &mut Setup;
    /// Steps between judgements. The last step of every cycle is always judged.
    fn judged_every(&self) -> usize;
    /// True if the network with the lowest error is kept, even if it is the initial one, instead of the last network.
    fn keeps_best(&self) -> bool {
        false
    }
    /// State for a checkpoint, apart from weights and random numbers.
    fn state(&self) -> serde_json::Result<Value> {
        Ok(Value::Null)
    }
    /// Goes back to a state from a checkpoint.
    fn restore(&mut self, _state: &Value) -> serde_json::Result<()> {
        Ok(())
    }
    /// Gradients of the loss of the next batch.
    fn gradients(&mut self, network: &Self::Network, step: usize) -> GradientsParams;
    /// Validation errors, percent; `None` if unmeasurable.
    fn errors_pct(&self, network: &Self::Network) -> Vec<Option<f64>>;
    /// Records the errors after `done` steps, and returns a note for the display.
    fn record(&mut self, done: usize, errors_pct: Vec<Option<f64>>) -> String;
}

/// Network with the steps that made it and its error.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct KeptNetwork<N> {
    pub(crate) network: N,
    /// Steps that made it.
    pub(crate) step: usize,
    /// Mean error, percent.
    pub(crate) error_pct: f64,
}

/// Result of a training.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Learned<N> {
    pub(crate) kept: KeptNetwork<N>,
    /// Steps done.
    pub(crate) steps: usize,
    /// Cause of the end.
    pub(crate) ended_by: EndedBy,
    /// Finished cycles.
    pub(crate) cycles: Vec<Cycle>,
}

impl<N> Learned<N> {
    /// Summary of a stage with `samples` training samples.
    pub(crate) fn summary(
        &self,
        network: &str,
        view: Option<&str>,
        settings: &Optimisation,
        samples: usize,
    ) -> StageSummary {
        StageSummary {
            network: network.to_owned(),
            view: view.map(str::to_owned),
            steps: self.steps,
            kept_step: self.kept.step,
            batch_size: settings.batch_size,
            samples,
            passes: (self.steps * settings.batch_size) as f64 / samples.max(1) as f64,
            ended_by: self.ended_by,
            cycles: self.cycles.clone(),
        }
    }

    /// Converts the network.
    fn with_network<M>(&self, form: impl FnOnce(&N) -> Result<M>) -> Result<Learned<M>> {
        Ok(Learned {
            kept: KeptNetwork {
                network: form(&self.kept.network)?,
                step: self.kept.step,
                error_pct: self.kept.error_pct,
            },
            steps: self.steps,
            ended_by: self.ended_by,
            cycles: self.cycles.clone(),
        })
    }
}

/// Training between two steps.
struct Position<N> {
    network: N,
    optimiser: ModuleOptimizer,
    /// Steps done.
    step: usize,
    /// The network with the lowest error, if the task keeps it. Such trainings have no checkpoint.
    best: Option<KeptNetwork<N>>,
    /// Finished cycles.
    cycles: Vec<Cycle>,
}

/// Trains a network from the start or from a checkpoint. If the training is stopped, the checkpoint contains the last step.
pub(crate) fn learn<T: Task>(
    task: &mut T,
    network: T::Network,
    settings: &Optimisation,
    Companions { checkpoints, watch }: &mut Companions,
) -> Result<Learned<T::Network>> {
    watch.begin(T::STAGE, settings.steps as u64);
    let plateau = task.setup().plateau;
    let is_on_plateau =
        |cycles: &[Cycle]| plateau.is_some_and(|plateau| is_reached(plateau, cycles));
    let mut at = match checkpoints.next_stage(task)? {
        Some(Reached::End(ended)) => {
            watch.resume(settings.steps as u64);
            return ended.with_network(|weights| checkpoints.network(weights, network));
        }
        Some(Reached::Step(running)) => {
            watch.resume(running.step as u64);
            Position::restored(&running, network, checkpoints)?
        }
        None => Position::first(task, network)?,
    };
    let ended_by = loop {
        if is_on_plateau(&at.cycles) {
            break EndedBy::Plateau;
        }
        if at.step >= settings.steps {
            break EndedBy::Steps;
        }
        let cycle = cycle_of(at.step, settings.steps, plateau);
        let gradients = task.gradients(&at.network, at.step);
        let rate = learning_rate(settings.learning_rate, &cycle, at.step);
        at.network = at.optimiser.step(rate, at.network, gradients);
        at.step += 1;
        let ends_cycle = at.step == cycle.end;
        if ends_cycle || at.step.is_multiple_of(task.judged_every()) {
            let errors_pct = judge(task, &at.network, at.step)?;
            if task.keeps_best() {
                at.compare_with_best(mean(&errors_pct));
            }
            if ends_cycle {
                at.cycles.push(Cycle {
                    steps: at.step,
                    validation_mape_pct: errors_pct.clone(),
                });
            }
            let note = task.record(at.step, errors_pct);
            watch.advance(at.step as u64, &note);
        }
        let stopped = watch.check();
        if stopped.is_err() || checkpoints.is_due() {
            let reached = |checkpoints: &Checkpoints| Ok(Reached::Step(at.saved(checkpoints)?));
            checkpoints.save(task, reached)?;
        }
        stopped?;
    };
    let learned = at.end(task, ended_by)?;
    let KeptNetwork {
        step, error_pct, ..
    } = learned.kept;
    let note = format!("kept step {step}, MAPE {error_pct:.3} %");
    watch.advance(settings.steps as u64, &note);
    let reached = |checkpoints: &Checkpoints| {
        let saved = learned.with_network(|network| checkpoints.network_bytes(network));
        Ok(Reached::End(saved?))
    };
    checkpoints.save(task, reached)?;
    Ok(learned)
}

impl<N: Module> Position<N> {
    fn first<T: Task<Network = N>>(task: &T, network: N) -> Result<Self> {
        let best = if task.keeps_best() {
            Some(KeptNetwork {
                error_pct: mean(&judge(task, &network, 0)?),
                network: network.clone(),
                step: 0,
            })
        } else {
            None
        };
        Ok(Self {
            network,
            optimiser: adam(),
            step: 0,
            best,
            cycles: Vec::new(),
        })
    }

    fn compare_with_best(&mut self, error_pct: f64) {
        let best = self.best.as_ref();
        if best.is_none_or(|best| error_pct < best.error_pct) {
            self.best = Some(KeptNetwork {
                network: self.network.clone(),
                step: self.step,
                error_pct,
            });
        }
    }

    fn end<T: Task<Network = N>>(self, task: &T, ended_by: EndedBy) -> Result<Learned<N>> {
        let kept = match self.best {
            Some(best) => best,
            None => KeptNetwork {
                error_pct: mean(&judge(task, &self.network, self.step)?),
                network: self.network,
                step: self.step,
            },
        };
        Ok(Learned {
            kept,
            steps: self.step,
            ended_by,
            cycles: self.cycles,
        })
    }

    fn saved(&self, checkpoints: &Checkpoints) -> Result<RunningWeights> {
        Ok(RunningWeights {
            step: self.step,
            weights: checkpoints.network_bytes(&self.network)?,
            optimiser: checkpoints.optimiser_bytes(&self.optimiser)?,
            cycles: self.cycles.clone(),
        })
    }

    fn restored(from: &RunningWeights, network: N, checkpoints: &Checkpoints) -> Result<Self> {
        Ok(Self {
            network: checkpoints.network(&from.weights, network)?,
            optimiser: checkpoints.optimiser(&from.optimiser, adam())?,
            step: from.step,
            best: None,
            cycles: from.cycles.clone(),
        })
    }
}

/// Errors of `network`; an error if they are not finite.
fn judge<T: Task>(task: &T, network: &T::Network, step: usize) -> Result<Vec<Option<f64>>> {
    let errors_pct = task.errors_pct(network);
    if errors_pct.iter().flatten().all(|error| error.is_finite()) {
        Ok(errors_pct)
    } else {
        Err(Error::Diverged {
            network: T::NAME,
            step,
        })
    }
}

/// Mean over the measurable errors.
fn mean(errors_pct: &[Option<f64>]) -> f64 {
    let measured = || errors_pct.iter().flatten();
    measured().sum::<f64>() / measured().count().max(1) as f64
}

/// Adam with PyTorch's epsilon (burn's default of 1e-5 is as large as gradients get here towards the end).
fn adam() -> ModuleOptimizer {
    AdamConfig::new().with_epsilon(1e-8).init()
}

#[cfg(test)]
mod tests;
