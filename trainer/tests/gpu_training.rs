//! Training on a GPU. Needs one, or a driver that computes on the processor: `cargo test --release -p trainer --features wgpu --test
//! gpu_training`.
#![cfg(feature = "wgpu")]

mod hardly_trained;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;

use dataset::work::watch::{Silent, Watch};
use hardly_trained::narrow;
use testkit::synthetic::SyntheticCorpus;
use trainer::{TrainConfig, TrainingBackend, train};

/// Small networks and few steps.
fn config(backend: TrainingBackend) -> TrainConfig {
    let mut config = narrow(16, 40, 64, 3e-3);
    config.backend = backend;
    config.calibration.log_every = 10;
    config.estimator.lstm = vec![16, 16];
    config.estimator.log_every = 10;
    config
}

/// Ends the training while it trains the LSTM.
#[derive(Default)]
struct Killer {
    stage: Mutex<String>,
}

impl Watch for Killer {
    fn begin(&self, stage: &str, _total: u64) {
        *self.stage.lock().unwrap() = stage.into();
    }

    fn advance(&self, _done: u64, _note: &str) {
        assert!(
            *self.stage.lock().unwrap() != "distance estimator",
            "killed"
        );
    }
}

#[test]
fn a_gpu_comes_to_the_numbers_of_the_processor() {
    let root = tempfile::tempdir().unwrap();
    let corpus = SyntheticCorpus::tiny()
        .write(&root.path().join("corpus"))
        .unwrap();
    let error_pct = |name: &str, backend| {
        let out = root.path().join(name);
        let outcome = train(&corpus, &out, &config(backend), &Silent).unwrap();
        outcome.validation_mape_pct
    };
    let on_cpu = error_pct("processor", TrainingBackend::Cpu);
    let on_gpu = error_pct("gpu", TrainingBackend::Wgpu);
    assert!(
        (on_cpu - on_gpu).abs() < 1e-3 * on_cpu,
        "{on_cpu} % and {on_gpu} %"
    );

    let out = root.path().join("resumed");
    let killed = catch_unwind(AssertUnwindSafe(|| {
        train(
            &corpus,
            &out,
            &config(TrainingBackend::Wgpu),
            &Killer::default(),
        )
    }));
    assert!(killed.is_err());
    assert_eq!(error_pct("resumed", TrainingBackend::Wgpu), on_gpu);
}
