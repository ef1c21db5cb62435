//! Settings and corpora for trainings of seconds, and what they leave.
#![allow(dead_code, reason = "each test file uses a part of it")]

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use dataset::corpus::Corpus;
use dataset::work::watch::{Silent, Watch};
use tempfile::TempDir;
use testkit::synthetic::SyntheticCorpus;
use trainer::config::Optimisation;
use trainer::{EvaluationConfig, Metrics, RunFolder, TrainConfig, evaluate, train};

/// The tiny corpus in a folder of this one.
pub(crate) fn tiny(root: &Path) -> Corpus {
    let corpus = SyntheticCorpus::tiny();
    corpus.write(&root.join("corpus")).unwrap()
}

pub(crate) fn trained(corpus: &Corpus, out: &Path, config: &TrainConfig) -> RunFolder {
    train(corpus, out, config, &Silent).unwrap().run
}

pub(crate) fn judged(run: &RunFolder, corpus: &Corpus) -> Metrics {
    evaluate(run, corpus, &EvaluationConfig::default(), &Silent).unwrap()
}

/// A run of hardly trained, tiny networks: its formulas are as good as any.
pub(crate) struct Trained {
    folder: TempDir,
    pub(crate) run: RunFolder,
}

impl Trained {
    pub(crate) fn on(corpus: &SyntheticCorpus) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let corpus = corpus.write(&folder.path().join("corpus")).unwrap();
        let run = trained(&corpus, &folder.path().join("run"), &hardly_trained());
        Self { folder, run }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(crate) fn corpus(&self) -> Corpus {
        Corpus::open(&self.path("corpus")).unwrap()
    }

    pub(crate) fn judged(&self) -> Metrics {
        judged(&self.run, &self.corpus())
    }
}

/// Messages that were said.
#[derive(Default)]
pub(crate) struct Said(pub(crate) Mutex<Vec<String>>);

impl Watch for Said {
    fn say(&self, line: &str) {
        self.0.lock().unwrap().push(line.to_owned());
    }
}

/// Formulas are fully fitted, networks are not.
pub(crate) fn hardly_trained() -> TrainConfig {
    narrow(8, 20, 16, 1e-3)
}

/// Networks with a single layer, all trained for the same number of steps.
pub(crate) fn narrow(
    width: usize,
    steps: usize,
    batch_size: usize,
    learning_rate: f64,
) -> TrainConfig {
    let optimisation = Optimisation {
        steps,
        batch_size,
        learning_rate,
    };
    let mut config = TrainConfig {
        // Synthetic cameras do not move, and show no backgrounds.
        camera_stability_arcsec: 0.0,
        ..TrainConfig::default()
    };
    config.calibration.hidden = vec![width];
    config.calibration.features = width;
    config.calibration.head_hidden = vec![width];
    config.calibration.optimisation = optimisation.clone();
    config.estimator.lstm = vec![width];
    config.estimator.head_hidden = vec![width];
    config.estimator.optimisation = optimisation.clone();
    config.mono.hidden = vec![width];
    config.mono.optimisation = optimisation;
    config
}
