//! Search over settings and seeds.

mod hardly_trained;

use std::collections::BTreeMap;
use std::fs;
use std::sync::Mutex;

use dataset::work::watch::{Silent, Watch};
use hardly_trained::narrow;
use testkit::synthetic::SyntheticCorpus;
use trainer::{EvaluationConfig, RunFolder, Search, TrainConfig, evaluate, search};

fn with_lstm(width: usize, learning_rate: f64) -> TrainConfig {
    let mut config = narrow(16, 60, 64, learning_rate);
    config.estimator.lstm = vec![width];
    config
}

/// Bears no training, and writes down which ones are looked at.
#[derive(Debug, Default)]
struct Idle(Mutex<Vec<String>>);

impl Watch for Idle {
    fn begin(&self, stage: &str, _total: u64) {
        let compares = ["backgrounds", "cameras"].contains(&stage);
        assert!(compares, "trains {stage}");
    }

    fn say(&self, line: &str) {
        if !line.contains("backgrounds") {
            self.0.lock().unwrap().push(line.into());
        }
    }
}

#[test]
fn each_variant_is_trained_with_each_seed_once_and_the_best_is_linked() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = SyntheticCorpus::tiny();
    let corpora = [corpus.write(&folder.path().join("corpus")).unwrap()];
    let out = folder.path().join("sizes");
    let what = Search {
        // One learns, one hardly.
        variants: BTreeMap::from([
            ("learns".to_owned(), with_lstm(24, 5e-3)),
            ("sleeps".to_owned(), with_lstm(16, 1e-7)),
        ]),
        seeds: vec![3, 4],
    };
    let table = search(&corpora, &out, &what, &Silent).unwrap();
    let [learns, sleeps] = table.variants.as_slice() else {
        panic!("{table:?}");
    };
    let errors = learns
        .trainings
        .iter()
        .map(|t| t.validation_mape_pct.unwrap());
    let errors: Vec<f64> = errors.collect();
    let [first, second] = errors.as_slice() else {
        panic!("{errors:?}");
    };
    assert_ne!(first, second, "the seed makes a difference");
    let close = |found: Option<f64>, expected: f64| (found.unwrap() - expected).abs() < 1e-9;
    assert!(close(learns.mean_pct, (first + second) / 2.0));
    assert!(close(
        learns.spread_pct,
        (first - second).abs() / 2_f64.sqrt()
    ));
    assert!(learns.mean_pct < sleeps.mean_pct);
    let best = if first < second {
        "learns-3"
    } else {
        "learns-4"
    };
    assert_eq!(table.best.as_deref(), Some(best));
    let linked = RunFolder::at(&out.join("best"));
    evaluate(&linked, &corpora[0], &EvaluationConfig::default(), &Silent).unwrap();
    assert!(out.join(best).join("metrics.json").is_file());
    let written = fs::read(out.join("search.json")).unwrap();
    assert_eq!(
        serde_json::from_slice::<trainer::SearchTable>(&written).unwrap(),
        table
    );

    // A run folder cannot be a search folder.
    let in_run = search(&corpora, &out.join(best), &what, &Silent);
    assert!(in_run.unwrap_err().to_string().contains("is a run"));

    // No run is trained twice, and the evaluation stays.
    let idle = Idle::default();
    assert_eq!(search(&corpora, &out, &what, &idle).unwrap(), table);
    assert_eq!(idle.0.lock().unwrap().len(), 4, "{idle:?}");
    assert!(out.join(best).join("metrics.json").is_file());
    // One seed more is one training of each variant more.
    let more = Search {
        seeds: vec![3, 4, 5],
        ..what
    };
    let larger = search(&corpora, &out, &more, &Silent).unwrap();
    assert_eq!(larger.variants[0].trainings[..2], learns.trainings);
    assert!(out.join("sleeps-5").is_dir());
    // Registrations count as well, though no network reads them.
    let registered = SyntheticCorpus {
        shift_noise_px: Some(0.05),
        ..SyntheticCorpus::tiny()
    };
    let registered = [registered.write(&folder.path().join("registered")).unwrap()];
    let formulas = || fs::read(out.join("learns-3/baselines.json")).unwrap();
    let before = formulas();
    search(&registered, &out, &more, &Silent).unwrap();
    assert_ne!(formulas(), before);
}

#[test]
fn a_variant_that_diverges_has_no_mean_and_nonsense_is_refused_before_anything_is_trained() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = SyntheticCorpus::tiny();
    let corpora = [corpus.write(&folder.path().join("corpus")).unwrap()];
    let out = folder.path().join("sizes");
    // Distances are exponentials of outputs that overshoot, and looked at after each step.
    let mut wild = with_lstm(16, 10.0);
    wild.loss = trainer::config::Loss::Logarithmic;
    (wild.calibration.log_every, wild.estimator.log_every) = (1, 1);
    let of = |name: &str, config: &TrainConfig, seeds: &[u64]| Search {
        variants: BTreeMap::from([(name.to_owned(), config.clone())]),
        seeds: seeds.to_vec(),
    };
    for (nonsense, word) in [
        (of("a/b", &wild, &[0]), "variants"),
        (of("best", &wild, &[0]), "variants"),
        (of("wild", &wild, &[]), "seeds"),
        (of("wild", &wild, &[1, 1]), "seeds"),
    ] {
        let error = search(&corpora, &out, &nonsense, &Silent).unwrap_err();
        assert!(error.to_string().contains(word), "{error}");
    }
    assert!(!out.exists());
    let mut both = of("wild", &wild, &[0]);
    both.variants.insert("tame".into(), with_lstm(16, 5e-3));
    let table = search(&corpora, &out, &both, &Silent).unwrap();
    assert_eq!(table.variants[1].mean_pct, None, "{table:?}");
    assert_eq!(table.best.as_deref(), Some("tame-0"));
}
