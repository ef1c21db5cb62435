//! The loop that trains every network of this crate: batch after batch, judged now and then.
//!
//! Calibration networks, distance estimator and monoscopic networks differ in their batches and losses and in what they make of their
//! errors: a [`Task`]. Optimiser, learning rate, judging, early stopping, checkpoints and the end of a training that diverges are the same.
//!
//! The detector has a separate loop (`detector-training`): it may run for minutes instead of steps, trains two halves of a batch in
//! parallel, and remembers the background that it took for aircraft.

use burn::module::Module;
use burn::optim::{AdamConfig, GradientsParams, ModuleOptimizer};
use burn::tensor::Device;
use dataset::work::watch::Watch;
use rand_chacha::ChaCha12Rng;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::config::{Loss, Optimisation};
use crate::error::{Error, Result};
use crate::networks::checkpoint::{Checkpoints, KeptWeights, Reached, RunningWeights};

/// Share of the steps over which the rate rises.
const WARM_UP: f64 = 0.02;
/// Share of the highest rate that remains at the end.
const FINAL: f64 = 1e-3;

/// Learning rate of a step: a linear rise, then half a cosine.
fn learning_rate(settings: &Optimisation, step: usize) -> f64 {
    let part = (step as f64 + 0.5) / settings.steps as f64;
    let factor = if part < WARM_UP {
        part / WARM_UP
    } else {
        let fallen = (part - WARM_UP) / (1.0 - WARM_UP);
        FINAL + (1.0 - FINAL) * 0.5 * (1.0 + (std::f64::consts::PI * fallen).cos())
    };
    settings.learning_rate * factor
}

/// Inputs of every task besides samples and settings.
pub(crate) struct Setup {
    /// Loss that is minimised.
    pub(crate) loss: Loss,
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
    /// Steps between two judgements. The last step is always judged.
    fn judged_every(&self) -> usize;
    /// Judgements in a row without a new lowest error that end the training. With patience, the network with the lowest error is kept, even
    /// if it is the initial one; without, the network after the last step.
    fn patience(&self) -> Option<usize> {
        None
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
}

/// Trains a network, from its beginning or from where a checkpoint has it. If the training is stopped, the checkpoint has its last step.
pub(crate) fn learn<T: Task>(
    task: &mut T,
    network: T::Network,
    settings: &Optimisation,
    Companions { checkpoints, watch }: &mut Companions,
) -> Result<Kept<T::Network>> {
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
        Some(Reached::End(kept)) => return Kept::restored(&kept, network, checkpoints),
        Some(Reached::Step(running)) => Position::restored(&running, network, checkpoints)?,
        None => Position::first(task, network)?,
    };
    while at.step < settings.steps && task.patience().is_none_or(|most| at.since_best < most) {
        let gradients = task.gradients(&at.network, at.step);
        let rate = learning_rate(settings, at.step);
        at.network = at.optimiser.step(rate, at.network, gradients);
        at.step += 1;
        let is_last = at.step == settings.steps;
        let is_due = at.step.is_multiple_of(task.judged_every());
        let is_judged = match task.patience() {
            // The last network is judged when it is complete.
            None => is_due && !is_last,
            Some(_) => is_due || is_last,
        };
        if is_judged {
            let errors_pct = judge(task, &at.network, at.step)?;
            at.compare_with_best(mean(&errors_pct));
            let note = task.record(at.step, errors_pct);
            watch.advance(at.step as u64, &note);
        }
        let stopped = watch.check();
        if stopped.is_err() || checkpoints.is_due() {
            let reached = |checkpoints: &Checkpoints| Ok(Reached::Step(at.saved(checkpoints)?));
            checkpoints.save(task, reached)?;
        }
        stopped?;
    }
    let (kept, note) = at.end(task)?;
    watch.advance(settings.steps as u64, &note);
    let reached = |checkpoints: &Checkpoints| Ok(Reached::End(kept.saved(checkpoints)?));
    checkpoints.save(task, reached)?;
    Ok(kept)
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
        })
    }

    fn compare_with_best(&mut self, error_pct: f64) {
        let Some(best) = &mut self.best else {
            return;
        };
        self.since_best += 1;
        if error_pct < best.error_pct {
            self.since_best = 0;
            *best = Kept {
                network: self.network.clone(),
                step: self.step,
                error_pct,
            };
        }
    }

    /// The network that is kept, and a few words about its error.
    fn end<T: Task<Network = N>>(self, task: &mut T) -> Result<(Kept<N>, String)> {
        let (network, step) = match self.best {
            Some(best) => (best.network, best.step),
            None => (self.network, self.step),
        };
        let errors_pct = judge(task, &network, step)?;
        let error_pct = mean(&errors_pct);
        let note = match task.patience() {
            None => task.record(step, errors_pct),
            Some(_) => format!("kept step {step}, MAPE {error_pct:.3} %"),
        };
        let kept = Kept {
            network,
            step,
            error_pct,
        };
        Ok((kept, note))
    }

    fn saved(&self, checkpoints: &Checkpoints) -> Result<RunningWeights> {
        let best = self.best.as_ref();
        Ok(RunningWeights {
            step: self.step,
            weights: checkpoints.network_bytes(&self.network)?,
            optimiser: checkpoints.optimiser_bytes(&self.optimiser)?,
            best: best.map(|best| best.saved(checkpoints)).transpose()?,
            since_best: self.since_best,
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
mod tests {
    use super::*;
    use crate::networks::dense::Dense;
    use crate::networks::encoded::numbers;
    use burn::tensor::Tensor;
    use rand::SeedableRng;
    use std::sync::Mutex;

    #[test]
    fn the_rate_rises_to_its_highest_and_falls_to_almost_nothing() {
        let settings = Optimisation {
            steps: 1_000,
            batch_size: 1,
            learning_rate: 0.01,
        };
        let rates: Vec<_> = (0..1_000)
            .map(|step| learning_rate(&settings, step))
            .collect();
        assert!(
            rates[0] < 0.001 && rates[999] < 2e-5,
            "{} {}",
            rates[0],
            rates[999]
        );
        let highest = rates.iter().copied().fold(0.0, f64::max);
        assert!((highest - 0.01).abs() < 1e-4, "{highest}");
        assert!(rates[25..].windows(2).all(|pair| pair[1] <= pair[0]));
    }

    /// Task that does not learn, and records the calls to it.
    struct Diary {
        entries: Vec<String>,
        /// After each number of steps, as planned.
        errors_pct: Vec<f64>,
        /// After each number of steps but the last.
        weights: Vec<f32>,
        patience: Option<usize>,
        random: ChaCha12Rng,
    }

    impl Diary {
        fn of(errors_pct: &[f64], patience: Option<usize>) -> Self {
            Self {
                entries: Vec::new(),
                errors_pct: errors_pct.to_vec(),
                weights: Vec::new(),
                patience,
                random: ChaCha12Rng::seed_from_u64(0),
            }
        }
    }

    impl Task for Diary {
        type Network = Dense;
        type State = ();
        const NAME: &'static str = "diary";
        const STAGE: &'static str = "diary";

        fn judged_every(&self) -> usize {
            2
        }

        fn patience(&self) -> Option<usize> {
            self.patience
        }

        fn random(&mut self) -> &mut ChaCha12Rng {
            &mut self.random
        }

        fn state(&self) {}

        fn restore(&mut self, (): ()) {}

        fn gradients(&mut self, network: &Dense, step: usize) -> GradientsParams {
            self.entries.push(format!("step {step}"));
            self.weights.push(weight(network));
            let output = network.forward(Tensor::ones([1, 1], &Device::flex().autodiff()));
            GradientsParams::from_grads(output.backward(), network)
        }

        fn errors_pct(&self, _network: &Dense) -> Vec<Option<f64>> {
            let steps = self
                .entries
                .iter()
                .filter(|entry| entry.starts_with("step"));
            vec![Some(self.errors_pct[steps.count()]), None]
        }

        fn record(&mut self, done: usize, errors_pct: Vec<Option<f64>>) -> String {
            format!("{} after {done}", errors_pct[0].unwrap())
        }
    }

    fn weight(network: &Dense) -> f32 {
        numbers(
            network
                .clone()
                .valid()
                .forward(Tensor::ones([1, 1], &Device::flex())),
        )[0]
    }

    /// Messages reported by a training.
    #[derive(Default)]
    struct Notes(Mutex<Vec<String>>);

    impl Watch for Notes {
        fn begin(&self, stage: &str, total: u64) {
            self.0.lock().unwrap().push(format!("{stage} of {total}"));
        }

        fn advance(&self, done: u64, note: &str) {
            self.0.lock().unwrap().push(format!("{done}: {note}"));
        }
    }

    fn learn_steps(diary: &mut Diary, steps: usize) -> Result<(Kept<Dense>, Vec<String>)> {
        let random = &mut ChaCha12Rng::seed_from_u64(0);
        let network = Dense::new(&[1, 1], random, &Device::flex().autodiff());
        let settings = Optimisation {
            steps,
            batch_size: 1,
            learning_rate: 0.01,
        };
        let notes = Notes::default();
        let mut companions = Companions {
            checkpoints: &mut Checkpoints::none(),
            watch: &notes,
        };
        let kept = learn(diary, network, &settings, &mut companions)?;
        Ok((kept, notes.0.into_inner().unwrap()))
    }

    #[test]
    fn the_last_step_is_judged_too() {
        let mut diary = Diary::of(&[9.0, 8.0, 7.0, 6.0], None);
        let (kept, reported) = learn_steps(&mut diary, 3).unwrap();
        assert_eq!(diary.entries, ["step 0", "step 1", "step 2"]);
        assert_eq!(reported, ["diary of 3", "2: 7 after 2", "3: 6 after 3"]);
        assert_eq!((kept.step, kept.error_pct), (3, 6.0));
    }

    #[test]
    fn with_patience_the_best_network_is_kept_and_a_training_ends_that_no_longer_gets_better() {
        let errors = [9.0, 8.0, 3.0, 2.0, 4.0, 1.0, 3.5, 1.0, 1.0];
        for (patience, expected) in [(2, (2, 6)), (9, (8, 8))] {
            let mut diary = Diary::of(&errors, Some(patience));
            let (kept, _) = learn_steps(&mut diary, 8).unwrap();
            let steps = diary
                .entries
                .iter()
                .filter(|entry| entry.starts_with("step"));
            assert_eq!((kept.step, steps.count()), expected, "patience {patience}");
            let then = diary.weights.get(kept.step);
            assert!(then.is_none_or(|&then| then == weight(&kept.network)));
        }
        // No step improved on the initial network.
        let mut diary = Diary::of(&[1.0, 8.0, 3.0, 2.0, 4.0], Some(1));
        let (kept, reported) = learn_steps(&mut diary, 4).unwrap();
        assert_eq!(kept.step, 0);
        assert_eq!(diary.entries, ["step 0", "step 1"]);
        assert!(
            reported.last().unwrap().contains("kept step 0"),
            "{reported:?}"
        );
    }

    #[test]
    fn a_training_whose_errors_are_no_longer_finite_ends_with_its_name_and_step() {
        let mut diary = Diary::of(&[9.0, 8.0, f64::NAN], None);
        let message = learn_steps(&mut diary, 3).unwrap_err().to_string();
        assert!(
            message.contains("training of diary diverged at step 2"),
            "{message}"
        );
        assert_eq!(diary.entries, ["step 0", "step 1"]);
    }
}
