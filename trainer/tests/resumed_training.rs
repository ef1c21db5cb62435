//! Interrupted trainings that are resumed.

mod hardly_trained;

use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use dataset::corpus::Corpus;
use dataset::corpus::splits::{Side, Splits};
use dataset::corpus::workshop::Workshop;
use dataset::work::watch::{Silent, Watch};
use hardly_trained::narrow;
use testkit::synthetic::SyntheticCorpus;
use testkit::watch::Calls;
use trainer::{Error, TrainConfig, train};

const STEPS: usize = 24;

/// Small networks that are judged often.
fn config() -> TrainConfig {
    let mut config = narrow(16, STEPS, 32, 3e-3);
    config.calibration.log_every = 4;
    config.calibration.min_steps = 8;
    // Algorithm 1 has something to decide.
    config.calibration.plateau_threshold_pct = 1e3;
    config.estimator.lstm = vec![16, 16];
    config.estimator.log_every = 4;
    config.estimator.first_cycle = 4;
    config.estimator.together_first = 0.3;
    config
}

/// Ends the training at a progress report, as a kill would, and records all reports.
struct Killer {
    reports_left: AtomicUsize,
    /// False while cameras are compared: every start repeats that.
    trains: AtomicBool,
    heard: Mutex<Vec<String>>,
}

impl Killer {
    fn after(reports: usize) -> Self {
        Self {
            reports_left: AtomicUsize::new(reports),
            trains: AtomicBool::new(false),
            heard: Mutex::default(),
        }
    }

    fn hear(&self, line: String) {
        self.heard.lock().unwrap().push(line);
    }
}

impl Watch for Killer {
    fn begin(&self, stage: &str, _total: u64) {
        let compares = ["backgrounds", "cameras"].contains(&stage);
        self.trains.store(!compares, Ordering::Relaxed);
        self.hear(stage.into());
    }

    fn advance(&self, done: u64, _note: &str) {
        self.hear(format!("at {done}"));
        if !self.trains.load(Ordering::Relaxed) {
            return;
        }
        let left = self.reports_left.load(Ordering::Relaxed);
        assert!(left > 0, "killed");
        self.reports_left.store(left - 1, Ordering::Relaxed);
    }

    fn resume(&self, done: u64) {
        self.hear(format!("from {done}"));
    }

    fn say(&self, line: &str) {
        self.hear(line.into());
    }
}

fn tiny(folder: &Path) -> Corpus {
    let corpus = SyntheticCorpus {
        shift_noise_px: Some(0.02),
        ..SyntheticCorpus::tiny()
    };
    corpus.write(&folder.join("corpus")).unwrap()
}

/// Trains until it is killed, and returns the reports; `None` if it finished.
fn killed(
    corpus: &Corpus,
    run: &Path,
    config: &TrainConfig,
    reports: usize,
) -> Option<Vec<String>> {
    let killer = Killer::after(reports);
    let training = || train(corpus, run, config, &killer).unwrap();
    let ended = catch_unwind(AssertUnwindSafe(training)).is_ok();
    (!ended).then(|| killer.heard.into_inner().unwrap())
}

/// Training result, except for the duration.
fn learned(run: &Path) -> Vec<Vec<u8>> {
    [
        "config.json",
        "weights.safetensors",
        "normalisation.json",
        "baselines.json",
        "convergence.json",
    ]
    .map(|name| fs::read(run.join(name)).unwrap())
    .to_vec()
}

fn is_resuming(heard: &[String]) -> bool {
    heard.iter().any(|line| line.starts_with("resuming at "))
}

#[test]
fn a_training_that_is_killed_again_and_again_comes_to_the_same_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = tiny(folder.path());
    let config = config();
    let straight = folder.path().join("straight");
    let outcome = train(&corpus, &straight, &config, &Silent).unwrap();
    let run = folder.path().join("killed");
    let mut kills = 0_usize;
    // Each process gets a little further than the last.
    while let Some(heard) = killed(&corpus, &run, &config, 4) {
        assert_eq!(is_resuming(&heard), kills > 0, "{heard:?}");
        assert!(!run.exists() || kills == 0);
        kills += 1;
        // Each saves its first step at least.
        assert!(kills < 10 * STEPS, "it gets nowhere: {heard:?}");
    }
    assert!(kills > 5, "only {kills} kills");
    assert_eq!(learned(&run), learned(&straight));
    assert!(!Workshop::beside(&run).exists());
    let again = train(&corpus, &straight, &config, &Silent).unwrap();
    assert_eq!(again.validation_mape_pct, outcome.validation_mape_pct);
}

#[test]
fn a_training_that_is_stopped_again_and_again_comes_to_the_same_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = tiny(folder.path());
    let [straight, run] = ["straight", "stopped"].map(|name| folder.path().join(name));
    train(&corpus, &straight, &config(), &Silent).unwrap();
    let mut stops = 0;
    loop {
        let asked = AtomicUsize::new(0);
        let later = Calls {
            advance: |_| {},
            is_stopped: || asked.fetch_add(1, Ordering::Relaxed) >= 30,
        };
        match train(&corpus, &run, &config(), &later) {
            Err(Error::Stopped(_)) => stops += 1,
            trained => {
                trained.unwrap();
                break;
            }
        }
        assert!(!run.exists());
    }
    // A step is made between two questions, and none is made twice.
    assert!((3..=20).contains(&stops), "{stops}");
    assert_eq!(learned(&run), learned(&straight));
}

#[test]
fn a_checkpoint_of_another_training_is_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = tiny(folder.path());
    let run = folder.path().join("run");
    let other = TrainConfig {
        seed: 1,
        ..config()
    };
    let checkpoint = Workshop::beside(&run).join("training/checkpoint.json");
    killed(&corpus, &run, &config(), 3).unwrap();
    let heard = killed(&corpus, &run, &other, 3).unwrap();
    assert!(!is_resuming(&heard), "other settings: {heard:?}");
    let heard = killed(&corpus, &run, &other, 3).unwrap();
    assert!(is_resuming(&heard), "the same settings: {heard:?}");
    // A training flight less.
    let split = fs::read(corpus.splits_path()).unwrap();
    let mut splits = Splits::read(&corpus.splits_path()).unwrap();
    let id = splits.side(Side::Train).next().unwrap().to_owned();
    splits.scenarios.get_mut(&id).unwrap().side = Side::Test;
    splits.write(&corpus.splits_path()).unwrap();
    let heard = killed(&corpus, &run, &other, 3).unwrap();
    assert!(!is_resuming(&heard), "other samples: {heard:?}");
    fs::write(corpus.splits_path(), split).unwrap();
    // A damaged one is of no training.
    fs::write(&checkpoint, &fs::read(&checkpoint).unwrap()[..1_000]).unwrap();
    train(&corpus, &run, &other, &Silent).unwrap();
    let straight = folder.path().join("straight");
    train(&corpus, &straight, &other, &Silent).unwrap();
    assert_eq!(learned(&run), learned(&straight));
}
