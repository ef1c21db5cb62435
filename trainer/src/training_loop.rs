//! The loop that trains every network of this crate: batch after batch, judged now and then.
//!
//! Calibration networks, distance estimator and monoscopic networks differ in their batches and losses and in what they make of their
//! errors: a [`Task`]. Optimiser, learning rate, judging and the end of a training that diverges are the same.

use burn::module::Module;
use burn::optim::{AdamConfig, GradientsParams, ModuleOptimizer};
use burn::tensor::Device;
use rand_chacha::ChaCha12Rng;

use crate::config::{Loss, Optimisation};
use crate::error::{Error, Result};

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

/// What every task needs besides samples and settings.
pub(crate) struct Setup {
    /// What is minimised.
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
}

/// What a network learns.
pub(crate) trait Task {
    /// The network.
    type Network: Module;
    /// Its name in errors.
    const NAME: &'static str;
    /// Steps between two judgements. The last step is always judged.
    fn judged_every(&self) -> usize;
    /// Gradients of the loss of the next batch.
    fn gradients(&mut self, network: &Self::Network, step: usize) -> GradientsParams;
    /// Completes the network after its last step, before it is judged.
    fn finish(&mut self, network: Self::Network) -> Self::Network {
        network
    }
    /// Measures the errors after `done` steps, and returns a note about them; `None` if they are no longer finite.
    fn judge(&mut self, network: &Self::Network, done: usize) -> Option<String>;
}

/// Trains a network. `report` receives the number of steps done, and a note.
pub(crate) fn learn<T: Task>(
    task: &mut T,
    mut network: T::Network,
    settings: &Optimisation,
    mut report: impl FnMut(usize, &str),
) -> Result<T::Network> {
    let mut optimiser = adam();
    for step in 0..settings.steps {
        let gradients = task.gradients(&network, step);
        network = optimiser.step(learning_rate(settings, step), network, gradients);
        let done = step + 1;
        let is_last = done == settings.steps;
        if is_last {
            network = task.finish(network);
        }
        if is_last || done.is_multiple_of(task.judged_every()) {
            let note = task.judge(&network, done).ok_or(Error::Diverged {
                network: T::NAME,
                step: done,
            })?;
            report(done, &note);
        }
    }
    Ok(network)
}

/// Adam with PyTorch's epsilon (burn's default of 1e-5 is as large as gradients get here towards the end).
fn adam() -> ModuleOptimizer {
    AdamConfig::new().with_epsilon(1e-8).init()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::Dense;
    use rand::SeedableRng;

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

    /// Learns nothing, and notes when it is asked for what.
    #[derive(Default)]
    struct Diary {
        entries: Vec<String>,
        diverges_at: Option<usize>,
    }

    impl Task for Diary {
        type Network = Dense;
        const NAME: &'static str = "diary";

        fn judged_every(&self) -> usize {
            2
        }

        fn gradients(&mut self, _network: &Dense, step: usize) -> GradientsParams {
            self.entries.push(format!("step {step}"));
            GradientsParams::new()
        }

        fn finish(&mut self, network: Dense) -> Dense {
            self.entries.push("finish".into());
            network
        }

        fn judge(&mut self, _network: &Dense, done: usize) -> Option<String> {
            (self.diverges_at != Some(done)).then(|| format!("error after {done}"))
        }
    }

    fn learn_three_steps(diary: &mut Diary) -> Result<Vec<(usize, String)>> {
        let random = &mut ChaCha12Rng::seed_from_u64(0);
        let network = Dense::new(&[1, 1], random, &Device::flex().autodiff());
        let settings = Optimisation {
            steps: 3,
            batch_size: 1,
            learning_rate: 0.01,
        };
        let mut reported = Vec::new();
        learn(diary, network, &settings, |done, note| {
            reported.push((done, note.to_owned()));
        })?;
        Ok(reported)
    }

    #[test]
    fn the_last_step_is_judged_too_and_after_the_network_is_complete() {
        let mut diary = Diary::default();
        let reported = learn_three_steps(&mut diary).unwrap();
        assert_eq!(diary.entries, ["step 0", "step 1", "step 2", "finish"]);
        let expected = [2, 3].map(|done| (done, format!("error after {done}")));
        assert_eq!(reported, expected);
    }

    #[test]
    fn a_training_whose_errors_are_no_longer_finite_ends_with_its_name_and_step() {
        let mut diary = Diary {
            diverges_at: Some(2),
            ..Diary::default()
        };
        let message = learn_three_steps(&mut diary).unwrap_err().to_string();
        assert!(
            message.contains("training of diary diverged at step 2"),
            "{message}"
        );
        assert_eq!(diary.entries, ["step 0", "step 1"]);
    }
}
