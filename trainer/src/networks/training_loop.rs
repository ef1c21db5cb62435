//! The loop that trains every network of this crate: batch after batch, judged now and then.
//!
//! Calibration networks, distance estimator and monoscopic networks differ in their batches and losses and in what they make of their
//! errors: a [`Task`]. Optimiser, learning rate, judging, early stopping, checkpoints and the end of a training that diverges are the same.
//!
//! The detector has a separate loop (`detector-training`): it may run for minutes instead of steps, trains two halves of a batch in
//! parallel, and remembers the background that it took for aircraft.

use std::ops::Range;

use burn::module::Module;
use burn::optim::{AdamConfig, GradientsParams, ModuleOptimizer};
use burn::tensor::Device;
use dataset::work::watch::Watch;
use rand_chacha::ChaCha12Rng;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::config::{Optimisation, Plateau, Target};
use crate::error::{Error, Result};
use crate::networks::checkpoint::{Checkpoints, EndedStage, KeptWeights, Reached, RunningWeights};
use crate::networks::stage::{Cycle, EndedBy, StageSummary, cycle_of, is_reached};

/// Share of the steps of a cycle over which the rate rises.
const WARM_UP: f64 = 0.02;
/// Share of the highest rate that remains at the end.
const FINAL: f64 = 1e-3;

/// Learning rate of a step of a cycle: a linear rise, then half a cosine.
fn learning_rate(highest: f64, cycle: &Range<usize>, step: usize) -> f64 {
    let part = ((step - cycle.start) as f64 + 0.5) / cycle.len() as f64;
    let factor = if part < WARM_UP {
        part / WARM_UP
    } else {
        let fallen = (part - WARM_UP) / (1.0 - WARM_UP);
        FINAL + (1.0 - FINAL) * 0.5 * (1.0 + (std::f64::consts::PI * fallen).cos())
    };
    highest * factor
}

/// Inputs of every task besides samples and settings.
pub(crate) struct Setup {
    /// Loss that is minimised.
    pub(crate) loss: Target,
    /// With autodiff.
    pub(crate) device: Device,
    /// Draws first weights and batches.
    pub(crate) random: ChaCha12Rng,
}

impl Setup {
    /// The device without autodiff, for judging.
    pub(crate) fn plain_device(&self) -> Device {
        self.device.clone().inner()
    }

    /// True if the device is the CPU.
    pub(crate) fn is_on_processor(&self) -> bool {
        self.device == Device::flex()
    }
}

/// Companions of a training.
pub(crate) struct Companions<'a> {
    /// Keeps it on disk.
    pub(crate) checkpoints: &'a mut Checkpoints,
    /// Shows it, and may stop it.
    pub(crate) watch: &'a dyn Watch,
}

/// Training task of a network.
pub(crate) trait Task {
    /// The network.
    type Network: Module;
    /// State from the steps so far, apart from the position in the random numbers.
    type State: Serialize + DeserializeOwned;
    /// Its name in errors.
    const NAME: &'static str;
    /// Its name in the display of progress.
    const STAGE: &'static str;
    /// Steps between two judgements. The last step of a cycle is always judged.
    fn judged_every(&self) -> usize;
    /// Judgements in a row without a new lowest error that end the training. With patience, the network with the lowest error is kept, even
    /// if it is the initial one; without, the network after the last step.
    fn patience(&self) -> Option<usize> {
        None
    }
    /// The plateau that ends the training before all steps are made.
    fn plateau(&self) -> Option<Plateau> {
        None
    }
    /// Takes note of the errors at the end of a cycle that lowered none of them. It may change what trains on.
    fn observe_plateau(&mut self, _errors_pct: &[Option<f64>]) {}
    /// True if such a plateau ends the training.
    fn is_settled(&self) -> bool {
        true
    }
    /// Random numbers that draw its batches.
    fn random(&mut self) -> &mut ChaCha12Rng;
    /// State for a checkpoint.
    fn state(&self) -> Self::State;
    /// Goes back to such a state.
    fn restore(&mut self, state: Self::State);
    /// Gradients of the loss of the next batch.
    fn gradients(&mut self, network: &Self::Network, step: usize) -> GradientsParams;
    /// The errors that it is judged by, percent; `None` for what cannot be measured.
    fn errors_pct(&self, network: &Self::Network) -> Vec<Option<f64>>;
    /// Takes note of the errors after `done` steps, and returns a few words about them.
    fn record(&mut self, done: usize, errors_pct: Vec<Option<f64>>) -> String;
}

/// A network that is kept.
#[derive(Debug, Clone)]
pub(crate) struct Kept<N> {
    /// The network.
    pub(crate) network: N,
    /// Steps that made it.
    pub(crate) step: usize,
    /// Mean of its errors, percent.
    pub(crate) error_pct: f64,
}

/// A network that is trained.
#[derive(Debug)]
pub(crate) struct Learned<N> {
    /// The network.
    pub(crate) kept: Kept<N>,
    /// Steps done.
    pub(crate) steps: usize,
    /// Cause of its end.
    pub(crate) ended_by: EndedBy,
    /// Its cycles.
    pub(crate) cycles: Vec<Cycle>,
}

impl<N> Learned<N> {
    /// Summary of the stage, which trained on this many samples.
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
}

/// A training between two steps.
struct Position<N> {
    network: N,
    optimiser: ModuleOptimizer,
    /// Steps done.
    step: usize,
    /// The network with the lowest error so far, if there is patience.
    best: Option<Kept<N>>,
    /// Judgements since then.
    since_best: usize,
    /// Finished cycles.
    cycles: Vec<Cycle>,
}

/// Trains a network, from its beginning or from where a checkpoint has it. If the training is stopped, the checkpoint has its last step.
pub(crate) fn learn<T: Task>(
    task: &mut T,
    network: T::Network,
    settings: &Optimisation,
    Companions { checkpoints, watch }: &mut Companions,
) -> Result<Learned<T::Network>> {
    watch.begin(T::STAGE, settings.steps as u64);
    let reached = checkpoints.next_stage(task)?;
    if let Some(reached) = &reached {
        let done = match reached {
            Reached::Step(running) => running.step,
            Reached::End(_) => settings.steps,
        };
        watch.resume(done as u64);
    }
    let mut at = match reached {
        Some(Reached::End(ended)) => return Learned::restored(ended, network, checkpoints),
        Some(Reached::Step(running)) => Position::restored(&running, network, checkpoints)?,
        None => Position::first(task, network)?,
    };
    let ended_by = loop {
        if let Some(ended_by) = at.ended_by(task, settings) {
            break ended_by;
        }
        let cycle = cycle_of(at.step, settings.steps, task.plateau());
        let gradients = task.gradients(&at.network, at.step);
        let rate = learning_rate(settings.learning_rate, &cycle, at.step);
        at.network = at.optimiser.step(rate, at.network, gradients);
        at.step += 1;
        let ends_cycle = at.step == cycle.end;
        if ends_cycle || at.step.is_multiple_of(task.judged_every()) {
            let errors_pct = judge(task, &at.network, at.step)?;
            if task.patience().is_some() {
                at.compare_with_best(mean(&errors_pct));
            }
            if ends_cycle {
                at.cycles.push(Cycle {
                    steps: at.step,
                    validation_mape_pct: errors_pct.clone(),
                });
                let plateau = task.plateau();
                if plateau.is_some_and(|plateau| is_reached(plateau, &at.cycles)) {
                    task.observe_plateau(&errors_pct);
                }
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
    let Kept {
        step, error_pct, ..
    } = learned.kept;
    let note = format!("kept step {step}, MAPE {error_pct:.3} %");
    watch.advance(settings.steps as u64, &note);
    let reached = |checkpoints: &Checkpoints| Ok(Reached::End(learned.saved(checkpoints)?));
    checkpoints.save(task, reached)?;
    Ok(learned)
}

impl<N: Module> Position<N> {
    fn first<T: Task<Network = N>>(task: &T, network: N) -> Result<Self> {
        let best = match task.patience() {
            None => None,
            Some(_) => Some(Kept {
                error_pct: mean(&judge(task, &network, 0)?),
                network: network.clone(),
                step: 0,
            }),
        };
        Ok(Self {
            network,
            optimiser: adam(),
            step: 0,
            best,
            since_best: 0,
            cycles: Vec::new(),
        })
    }

    /// Cause of the end, if no more steps are made.
    fn ended_by<T: Task<Network = N>>(&self, task: &T, settings: &Optimisation) -> Option<EndedBy> {
        let plateau = task.plateau();
        if plateau.is_some_and(|plateau| is_reached(plateau, &self.cycles)) && task.is_settled() {
            Some(EndedBy::Plateau)
        } else if task.patience().is_some_and(|most| self.since_best >= most) {
            Some(EndedBy::Patience)
        } else {
            (self.step >= settings.steps).then_some(EndedBy::Steps)
        }
    }

    fn compare_with_best(&mut self, error_pct: f64) {
        self.since_best += 1;
        let best = self.best.as_ref();
        if best.is_none_or(|best| error_pct < best.error_pct) {
            self.since_best = 0;
            self.best = Some(Kept {
                network: self.network.clone(),
                step: self.step,
                error_pct,
            });
        }
    }

    /// The trained network.
    fn end<T: Task<Network = N>>(self, task: &T, ended_by: EndedBy) -> Result<Learned<N>> {
        let kept = match self.best {
            Some(best) => best,
            None => Kept {
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
        let best = self.best.as_ref();
        Ok(RunningWeights {
            step: self.step,
            weights: checkpoints.network_bytes(&self.network)?,
            optimiser: checkpoints.optimiser_bytes(&self.optimiser)?,
            best: best.map(|best| best.saved(checkpoints)).transpose()?,
            since_best: self.since_best,
            cycles: self.cycles.clone(),
        })
    }

    fn restored(from: &RunningWeights, network: N, checkpoints: &Checkpoints) -> Result<Self> {
        let best = from.best.as_ref();
        let best = best.map(|best| Kept::restored(best, network.clone(), checkpoints));
        Ok(Self {
            best: best.transpose()?,
            network: checkpoints.network(&from.weights, network)?,
            optimiser: checkpoints.optimiser(&from.optimiser, adam())?,
            step: from.step,
            since_best: from.since_best,
            cycles: from.cycles.clone(),
        })
    }
}

impl<N: Module> Learned<N> {
    fn saved(&self, checkpoints: &Checkpoints) -> Result<EndedStage> {
        Ok(EndedStage {
            kept: self.kept.saved(checkpoints)?,
            steps: self.steps,
            ended_by: self.ended_by,
            cycles: self.cycles.clone(),
        })
    }

    fn restored(from: EndedStage, network: N, checkpoints: &Checkpoints) -> Result<Self> {
        Ok(Self {
            kept: Kept::restored(&from.kept, network, checkpoints)?,
            steps: from.steps,
            ended_by: from.ended_by,
            cycles: from.cycles,
        })
    }
}

impl<N: Module> Kept<N> {
    fn saved(&self, checkpoints: &Checkpoints) -> Result<KeptWeights> {
        Ok(KeptWeights {
            step: self.step,
            error_pct: self.error_pct,
            weights: checkpoints.network_bytes(&self.network)?,
        })
    }

    fn restored(from: &KeptWeights, network: N, checkpoints: &Checkpoints) -> Result<Self> {
        Ok(Self {
            network: checkpoints.network(&from.weights, network)?,
            step: from.step,
            error_pct: from.error_pct,
        })
    }
}

/// The errors of a network, all of them finite.
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

/// The mean of those that could be measured.
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
