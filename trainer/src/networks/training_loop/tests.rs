//! Ends, judgements and the rate of the loop.

use super::*;
use crate::config::TrainConfig;
use crate::networks::dense::Dense;
use crate::networks::encoded::numbers;
use burn::tensor::Tensor;
use rand::SeedableRng;
use std::sync::Mutex;

#[test]
fn the_rate_rises_to_its_highest_and_falls_to_almost_nothing() {
    let rates: Vec<_> = (500..1_500)
        .map(|step| learning_rate(0.01, &(500..1_500), step))
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
    keeps_best: bool,
    setup: Setup,
}

impl Diary {
    fn of(errors_pct: &[f64]) -> Self {
        Self {
            entries: Vec::new(),
            errors_pct: errors_pct.to_vec(),
            weights: Vec::new(),
            keeps_best: false,
            setup: Setup {
                loss: TrainConfig::default().target(),
                device: Device::flex().autodiff(),
                random: ChaCha12Rng::seed_from_u64(0),
                plateau: None,
            },
        }
    }
}

impl Task for Diary {
    type Network = Dense;
    const NAME: &'static str = "diary";
    const STAGE: &'static str = "diary";

    fn judged_every(&self) -> usize {
        2
    }

    fn keeps_best(&self) -> bool {
        self.keeps_best
    }

    fn setup(&mut self) -> &mut Setup {
        &mut self.setup
    }

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

fn optimisation(steps: usize) -> Optimisation {
    Optimisation {
        steps,
        batch_size: 1,
        learning_rate: 0.01,
    }
}

fn learn_steps(diary: &mut Diary, steps: usize) -> Result<(Learned<Dense>, Vec<String>)> {
    let random = &mut ChaCha12Rng::seed_from_u64(0);
    let network = Dense::new(&[1, 1], random, &Device::flex().autodiff());
    let settings = optimisation(steps);
    let notes = Notes::default();
    let mut companions = Companions {
        checkpoints: &mut Checkpoints::none(),
        watch: &notes,
    };
    let learned = learn(diary, network, &settings, &mut companions)?;
    Ok((learned, notes.0.into_inner().unwrap()))
}

#[test]
fn the_last_step_is_judged_too() {
    let mut diary = Diary::of(&[9.0, 8.0, 7.0, 6.0]);
    let (learned, reported) = learn_steps(&mut diary, 3).unwrap();
    assert_eq!(diary.entries, ["step 0", "step 1", "step 2"]);
    let last = "3: kept step 3, MAPE 6.000 %";
    assert_eq!(
        reported,
        ["diary of 3", "2: 7 after 2", "3: 6 after 3", last]
    );
    assert_eq!((learned.kept.step, learned.kept.error_pct), (3, 6.0));
    assert_eq!(learned.ended_by, EndedBy::Steps);
}

#[test]
fn the_network_with_the_lowest_error_is_kept_if_the_task_asks_for_it() {
    // Every second step is judged; no step of the last training improves on the initial network.
    let trainings = [
        (&[9.0, 8.0, 3.0, 2.0, 1.5, 1.0, 3.5][..], 4),
        (&[1.0, 8.0, 3.0, 2.0, 4.0][..], 0),
    ];
    for (errors, expected) in trainings {
        let mut diary = Diary::of(errors);
        diary.keeps_best = true;
        let steps = errors.len() - 1;
        let (learned, reported) = learn_steps(&mut diary, steps).unwrap();
        let Learned {
            kept, steps: made, ..
        } = learned;
        assert_eq!((kept.step, made), (expected, steps));
        let then = diary.weights.get(kept.step);
        assert!(then.is_none_or(|&then| then == weight(&kept.network)));
        let last = format!("kept step {}", kept.step);
        assert!(reported.last().unwrap().contains(&last), "{reported:?}");
    }
}

#[test]
fn a_training_goes_on_until_a_cycle_no_longer_lowers_the_error() {
    // Cycles end after 2, 6, 14 and 30 steps.
    let mut errors = [9.0; 63];
    (errors[2], errors[6], errors[14], errors[30]) = (8.0, 4.0, 4.1, 1.0);
    let mut diary = Diary::of(&errors);
    diary.setup.plateau = Some(Plateau {
        first_cycle: 2,
        threshold_pct: 0.5,
    });
    let (learned, _) = learn_steps(&mut diary, 62).unwrap();
    assert_eq!((learned.kept.step, learned.kept.error_pct), (14, 4.1));
    assert_eq!((learned.steps, learned.ended_by), (14, EndedBy::Plateau));
    let cycles = learned.cycles.iter();
    let cycles: Vec<_> = cycles.map(|cycle| cycle.steps).collect();
    assert_eq!(cycles, [2, 6, 14]);
    let summary = learned.summary("diary", None, &optimisation(62), 7);
    assert_eq!((summary.steps, summary.passes), (14, 2.0));
}

#[test]
fn a_training_whose_errors_are_no_longer_finite_ends_with_its_name_and_step() {
    let mut diary = Diary::of(&[9.0, 8.0, f64::NAN]);
    let message = learn_steps(&mut diary, 3).unwrap_err().to_string();
    assert!(
        message.contains("training of diary diverged at step 2"),
        "{message}"
    );
    assert_eq!(diary.entries, ["step 0", "step 1"]);
}
