//! Evaluations of one run: which may replace which, of what, and what each leaves.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use dataset::corpus::Corpus;
use dataset::corpus::seal;
use dataset::files::json_file::read_json;
use dataset::tables::columns::Table;
use dataset::work::watch::Silent;
use testkit::miscalibrated::Miscalibration;
use testkit::synthetic::SyntheticCorpus;
use trainer::{
    Error, EvaluationConfig, JudgedSide, Metrics, Moment, RunFolder, TrainConfig, evaluate,
    predict, train,
};

mod hardly_trained;
use hardly_trained::{Said, Trained, hardly_trained, judged, trained as run_of};

fn corpus_in(folder: &Path, corpus: SyntheticCorpus) -> Corpus {
    corpus.write(folder).unwrap()
}

fn new() -> Trained {
    Trained::on(&SyntheticCorpus::tiny())
}

/// Flights that the run never saw, from the same cameras.
fn other() -> SyntheticCorpus {
    SyntheticCorpus {
        seed: 1,
        ..SyntheticCorpus::tiny()
    }
}

impl Trained {
    fn evaluate(&self, corpus: &Corpus, config: &EvaluationConfig) -> Result<Metrics, Error> {
        evaluate(&self.run, corpus, config, &Silent)
    }
}

fn to(out: PathBuf) -> EvaluationConfig {
    EvaluationConfig {
        out: Some(out),
        ..EvaluationConfig::default()
    }
}

#[test]
fn results_of_another_evaluation_are_never_replaced_and_go_to_a_folder_of_their_own() {
    let trained = new();
    let first = trained.judged();
    let bytes = fs::read(trained.run.metrics_path()).unwrap();
    let again = trained.judged();
    assert!(again == first && fs::read(trained.run.metrics_path()).unwrap() == bytes);

    let other = corpus_in(&trained.path("other"), other());
    let refused = trained.evaluate(&other, &EvaluationConfig::default());
    let message = refused.unwrap_err().to_string();
    for needed in ["evaluation.json", "--out"] {
        assert!(message.contains(needed), "{message}");
    }
    assert_eq!(fs::read(trained.run.metrics_path()).unwrap(), bytes);

    // The same images, searched otherwise.
    let again = SyntheticCorpus {
        centre_noise_px: 2.0,
        ..SyntheticCorpus::tiny()
    };
    let again = corpus_in(&trained.path("again").join("corpus"), again);
    let manifest = |corpus: &Corpus| {
        let first = corpus.scenarios().unwrap().remove(0);
        first.open().unwrap().seal().manifest_blake3.clone()
    };
    assert_eq!(manifest(&again), manifest(&trained.corpus()));
    let refused = trained.evaluate(&again, &EvaluationConfig::default());
    let message = refused.unwrap_err().to_string();
    assert!(message.contains("evaluation.json"), "{message}");
    assert_eq!(fs::read(trained.run.metrics_path()).unwrap(), bytes);

    let out = trained.path("judged");
    let metrics = trained.evaluate(&other, &to(out.clone())).unwrap();
    assert_eq!(fs::read(trained.run.metrics_path()).unwrap(), bytes);
    assert_eq!(metrics.judged.corpus, "other");
    let results = RunFolder::at(&out);
    let read: Metrics = read_json(&results.metrics_path(), "metrics").unwrap();
    assert_eq!(read, metrics);
    assert!(seal::faults(&out).unwrap().is_empty() && results.report_path().is_file());
    assert!(!results.weights_path().exists(), "it is no run");
    let message = trained.evaluate(&other, &to(out)).unwrap_err().to_string();
    assert!(message.contains("is not empty"), "{message}");
    let inside = trained.run.root().join("judged");
    let message = trained
        .evaluate(&other, &to(inside))
        .unwrap_err()
        .to_string();
    assert!(message.contains("lies in a run"), "{message}");
}

#[test]
fn all_sides_of_a_corpus_are_judged_if_the_training_saw_none_of_its_flights() {
    let trained = new();
    let config = |name: &str| EvaluationConfig {
        side: JudgedSide::All,
        ..to(trained.path(name))
    };
    let other = corpus_in(&trained.path("other"), other());
    let all = trained.evaluate(&other, &config("all")).unwrap();
    assert_eq!(
        (all.split.test.scenarios, all.split.train.scenarios),
        (7, 4)
    );
    let test = trained.evaluate(&other, &to(trained.path("test"))).unwrap();
    assert_eq!(test.split.test.scenarios, 2);
    assert!(test.ticks.there < all.ticks.there);
    // The same flights under other names.
    let renamed = trained.path("renamed");
    fs::rename(trained.path("corpus"), &renamed).unwrap();
    let refused = trained.evaluate(&Corpus::open(&renamed).unwrap(), &config("refused"));
    let refused = refused.unwrap_err();
    let Error::Leak {
        trajectory,
        scenario,
        ..
    } = &refused
    else {
        panic!("{refused}");
    };
    let message = refused.to_string();
    assert!(message.contains(trajectory) && message.contains(scenario));
    assert!(
        !trained.path("refused").exists(),
        "nothing is left after a refusal"
    );
}

#[test]
fn every_estimator_has_its_figures_its_coverage_and_its_figures_without_some_views() {
    // At a tenth of the ticks no view saw the aircraft.
    let trained = Trained::on(&SyntheticCorpus {
        miss_ratio: 0.3,
        ..SyntheticCorpus::tiny()
    });
    let metrics = trained.judged();
    let written: serde_json::Value = read_json(&trained.run.metrics_path(), "metrics").unwrap();
    assert_eq!(written["rules"]["version"], metrics.rules.version);
    assert!(metrics.ticks.seen.unwrap() < metrics.ticks.there && metrics.ticks.common > 0);
    let removals = "bursts_20_s bursts_5_s bursts_60_s only_left only_right random_15_pct";
    for (name, figures) in written["estimators"].as_object().unwrap() {
        for key in [
            "mape_pct",
            "median_pct",
            "p95_pct",
            "sd_pct",
            "mae_m",
            "p95_m",
            "coverage",
        ] {
            assert!(figures[key].is_number(), "{name} {key}: {}", figures[key]);
        }
        assert_eq!(figures["ticks"], metrics.ticks.there, "{name}");
        let bridges_gaps = name.ends_with("filtered") || name.ends_with("smoothed");
        assert!(
            bridges_gaps || figures["coverage"].as_f64().unwrap() < 1.0,
            "{name}: ticks that no view saw"
        );
        let removed = figures["views_removed"].as_object().unwrap();
        let keys: Vec<&str> = removed.keys().map(String::as_str).collect();
        assert_eq!(keys.join(" "), removals);
        for figures in removed.values() {
            assert_eq!(figures["ticks"], metrics.ticks.there, "{name}");
        }
        assert_eq!(figures["by_flight"].as_array().unwrap().len(), 2);
        assert_eq!(figures["common"]["coverage"], 1.0);
    }
    let covered = |name: &str, removal: &str| {
        let of = &metrics.estimators[name].views_removed[removal];
        (of.all.coverage.unwrap(), of.removed.coverage)
    };
    assert_eq!(
        covered("triangulation", "only_left").0,
        0.0,
        "it needs two views"
    );
    assert!(covered("inverse_range", "only_left").0 > 0.5, "it does not");
    assert_eq!(covered("triangulation", "bursts_20_s").1, Some(0.0));
}

#[test]
fn views_that_are_late_stand_in_the_metrics() {
    let registered = |late_ticks: u32, seed: u64| SyntheticCorpus {
        shift_noise_px: Some(0.05),
        late_ticks,
        seed,
        ..SyntheticCorpus::tiny()
    };
    let trained = Trained::on(&registered(0, 0));
    let corpus = corpus_in(&trained.path("other"), registered(1, 1));
    let all = EvaluationConfig {
        side: JudgedSide::All,
        ..to(trained.path("late"))
    };
    let late = trained.evaluate(&corpus, &all).unwrap().late_views;
    let is_right = |line: &String| line.contains("view right is ") && line.contains(" s late");
    assert!(late.len() > 4 && late.iter().all(is_right), "{late:?}");
}

#[test]
fn other_cameras_are_refused_with_what_differs() {
    let trained = new();
    let mut turned = other();
    turned.imaging.refraction_coefficient = 0.13;
    let other = corpus_in(&trained.path("other"), turned);
    let message = trained
        .evaluate(&other, &to(trained.path("out")))
        .unwrap_err()
        .to_string();
    for needed in [
        "left.refraction_coefficient 0.13 and",
        "right.refraction_coefficient",
    ] {
        assert!(message.contains(needed), "{needed}: {message}");
    }
}

#[test]
fn a_corpus_without_labels_or_split_gets_the_predictions_that_it_gets_with_them() {
    let trained = new();
    trained.judged();
    let judged = Table::read(&trained.run.predictions_path(), u64::MAX).unwrap();
    for folder in trained.corpus().scenarios().unwrap() {
        let mut frames = folder.open().unwrap().frames().unwrap();
        for row in &mut frames.rows {
            row.labels = None;
        }
        frames.write(&folder.frames_path()).unwrap();
        seal::seal_folder(folder.root(), "synthetic").unwrap();
    }
    fs::remove_file(trained.corpus().splits_path()).unwrap();
    let out = trained.path("distances.parquet");
    let predicted = predict(
        &trained.run,
        &trained.corpus(),
        None,
        &out,
        Moment::Hindsight,
        &Silent,
    )
    .unwrap();
    assert_eq!(predicted.scenarios, 7);
    for (there, expected) in [
        (out.clone(), "is not replaced"),
        (trained.run.weights_path(), "is not replaced"),
        (trained.run.root().join("new.parquet"), "lies in a run"),
    ] {
        let before = fs::read(&there).ok();
        let refused = predict(
            &trained.run,
            &trained.corpus(),
            None,
            &there,
            Moment::Hindsight,
            &Silent,
        );
        let message = refused.unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
        assert_eq!(fs::read(&there).ok(), before);
    }
    let table = Table::read(&out, u64::MAX).unwrap();
    assert_eq!(table.rows(), predicted.ticks);
    assert!(!table.has("dtd_m"), "nothing of the truth");
    let rows = |table: &Table, column: &str| -> BTreeMap<(String, u32), Option<f64>> {
        let keys = table
            .text("scenario")
            .unwrap()
            .into_iter()
            .zip(table.u32("tick").unwrap());
        keys.zip(table.optional_f64(column).unwrap()).collect()
    };
    for (name, answered) in predicted.answered {
        let column = format!("{name}_dtd_m");
        let all = rows(&table, &column);
        assert_eq!(all.values().flatten().count(), answered, "{name}");
        if name.ends_with("smoothed") {
            continue; // Ticks past touchdown, which an evaluation does not have, count for the ticks before.
        }
        for (key, answer) in rows(&judged, &column) {
            // The networks' numbers are f32, and their sums depend on which ticks are predicted together.
            match (all[&key], answer) {
                (Some(found), Some(expected)) => assert!(
                    (found - expected).abs() <= 1e-5 * expected.abs(),
                    "{name} {key:?}: {found} m, evaluated {expected} m"
                ),
                (found, expected) => assert_eq!(found, expected, "{name} {key:?}"),
            }
        }
    }
}

#[test]
fn a_left_out_time_is_the_test_side_and_trains_nothing() {
    let trained = new();
    let corpus = trained.corpus();
    let moved = ["0000", "0005"];
    for id in moved {
        let folder = corpus.scenario(id);
        let mut record = folder.open().unwrap().record().unwrap();
        record.conditions.as_mut().unwrap().time_of_day = "03:00".into();
        record.write(&folder.record_path()).unwrap();
        seal::seal_folder(folder.root(), "synthetic").unwrap();
    }
    let config = |setting: &str| TrainConfig {
        leave_out: Some(setting.into()),
        ..hardly_trained()
    };
    let out = trained.path("without");
    let run = run_of(&corpus, &out, &config("time=03:00"));
    let metrics = judged(&run, &corpus);
    let split = &metrics.split;
    assert_eq!((split.train.scenarios, split.validation.scenarios), (3, 2));
    let flights = &metrics.estimators["inverse_range"].by_flight;
    let judged: Vec<_> = flights
        .iter()
        .map(|flight| flight.scenario.as_str())
        .collect();
    assert_eq!(judged, moved);
    for (setting, needed) in [
        ("time=04:00", "no scenario with time=04:00"),
        ("noon", "weather=NAME"),
    ] {
        let message = train(&corpus, &trained.path("none"), &config(setting), &Silent);
        let message = message.unwrap_err().to_string();
        assert!(message.contains(needed), "{message}");
    }
}

#[test]
fn a_calibration_that_is_wrong_by_half_a_degree_changes_neither_the_boxes_that_count_nor_the_errors()
 {
    let corpus = || SyntheticCorpus {
        shift_noise_px: Some(0.05),
        ..SyntheticCorpus::tiny()
    };
    let truly = Trained::on(&corpus());
    let folder = tempfile::tempdir().unwrap();
    let wrong = corpus_in(&folder.path().join("corpus"), corpus());
    let error = Miscalibration {
        yaw_deg: 0.5,
        pitch_deg: 0.2,
        roll_deg: 1.0,
        focal_pct: 3.0,
        north_m: 5.0,
    };
    error.apply(&wrong).unwrap();
    let out = folder.path().join("run");
    let said = Said::default();
    let run = train(&wrong, &out, &hardly_trained(), &said).unwrap().run;
    let said = said.0.into_inner().unwrap().join("\n");
    assert!(
        said.contains("calibration.json contradicts the boxes: by these, view left"),
        "{said}"
    );
    let [before, after] = [truly.judged(), judged(&run, &wrong)];
    assert_eq!(before.dropped_training_boxes, after.dropped_training_boxes);
    for (view, boxes) in &after.dropped_training_boxes {
        assert!(boxes.share.unwrap() < 0.02, "{view}: {boxes:?}");
    }
    let figures = |metrics: &Metrics| metrics.estimators["inverse_range"].overall.all;
    let [before, after] = [before, after].map(|metrics| figures(&metrics));
    let [before_pct, after_pct] = [before, after].map(|figures| figures.mape_pct.unwrap());
    println!("{before_pct} % with the true calibration, {after_pct} % with the wrong one");
    assert!(after_pct < 1.2 * before_pct);
    assert!((before.coverage.unwrap() - after.coverage.unwrap()).abs() < 0.02);
}

#[test]
fn a_copied_run_predicts_what_the_original_does() {
    let trained = new();
    let predictions = |run: &RunFolder| {
        judged(run, &trained.corpus());
        let table = Table::read(&run.predictions_path(), u64::MAX).unwrap();
        table.optional_f64("paper_lstm_dtd_m").unwrap()
    };
    let before = predictions(&trained.run);
    let copy = RunFolder::at(&trained.path("copy"));
    fs::create_dir(copy.root()).unwrap();
    for entry in fs::read_dir(trained.run.root()).unwrap() {
        let entry = entry.unwrap();
        fs::copy(entry.path(), copy.root().join(entry.file_name())).unwrap();
    }
    assert_eq!(predictions(&copy), before);
}
