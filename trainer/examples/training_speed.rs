//! Training speed of both stages of `paper_lstm` with the paper's layers, on boxes from geometry: `cargo run --release -p trainer --example
//! training_speed -- STEPS BATCH_SIZE...` prints a line per stage and batch size, with samples per second. All batches use both views.
//! `benches/training_speed.py` compares it with PyTorch.

use std::process::ExitCode;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use dataset::work::watch::Watch;
use testkit::synthetic::SyntheticCorpus;
use trainer::config::Optimisation;
use trainer::{TrainConfig, train};

/// When the stages of a training were judged.
#[derive(Default)]
struct Times(Mutex<Vec<(String, Vec<(u64, Instant)>)>>);

impl Times {
    fn lock(&self) -> MutexGuard<'_, Vec<(String, Vec<(u64, Instant)>)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Watch for Times {
    fn begin(&self, stage: &str, _total: u64) {
        self.lock().push((stage.to_owned(), Vec::new()));
    }

    fn advance(&self, done: u64, _note: &str) {
        if let Some((_, judged)) = self.lock().last_mut() {
            judged.push((done, Instant::now()));
        }
    }
}

fn main() -> ExitCode {
    let arguments: Result<Vec<usize>, _> = std::env::args().skip(1).map(|n| n.parse()).collect();
    let Ok([steps, batch_sizes @ ..]) = arguments.as_deref() else {
        eprintln!("usage: training_speed STEPS BATCH_SIZE...");
        return ExitCode::from(2);
    };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let corpus = SyntheticCorpus {
        miss_ratio: 0.0,
        ..SyntheticCorpus::tiny()
    };
    let corpus = corpus
        .write(&folder.path().join("corpus"))
        .expect("a corpus");
    for &batch_size in batch_sizes {
        let mut config = TrainConfig::default();
        let optimisation = Optimisation {
            // A third to warm up.
            steps: 3 * steps,
            batch_size,
            learning_rate: 1e-3,
        };
        config.calibration.optimisation = optimisation.clone();
        config.calibration.log_every = *steps;
        config.estimator.optimisation = optimisation;
        config.estimator.log_every = *steps;
        config.estimator.together_first = 1.0;
        config.mono.optimisation.steps = 1;
        let times = Times::default();
        train(&corpus, &folder.path().join("run"), &config, &times).expect("a training");
        for (stage, judged) in &times.lock()[..2] {
            let [(from, started), .., (to, ended)] = judged[..] else {
                continue;
            };
            let seconds = (ended - started).as_secs_f64();
            let samples = (to - from) as f64 * batch_size as f64;
            println!("{stage}\t{batch_size}\t{:.0}", samples / seconds);
        }
    }
    ExitCode::SUCCESS
}
