//! A real training in seconds: on boxes from geometry, evaluated on held-out trajectories.

mod hardly_trained;

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;

use dataset::corpus::Corpus;
use dataset::corpus::detections::{NewTables, replace};
use dataset::corpus::splits::{Side, Splits};
use dataset::files::json_file::read_json;
use dataset::tables::columns::Table;
use dataset::tables::pixel_box::PixelBox;
use dataset::work::watch::Silent;
use hardly_trained::{judged, narrow, tiny, trained};
use testkit::synthetic::{MODEL_HASH, SyntheticCorpus, model};
use testkit::{program_of_venv, repository};
use trainer::config::{Loss, PaperDeviation};
use trainer::{EvaluationConfig, Metrics, RunFolder, TrainConfig, evaluate, train};

/// The paper's networks, but narrow.
fn small() -> TrainConfig {
    let mut config = narrow(32, 800, 64, 4e-3);
    config.calibration.hidden = vec![32, 32];
    config.estimator.lstm = vec![32, 32];
    config.mono.optimisation.steps = 300;
    config.mono.optimisation.learning_rate = 5e-3;
    config
}

/// A short training on boxes and shifts with this noise, and its evaluation.
fn trained_with_shifts(root: &Path, shift_noise_px: f64) -> (Corpus, RunFolder, Metrics) {
    let synthetic = SyntheticCorpus {
        shift_noise_px: Some(shift_noise_px),
        ..SyntheticCorpus::tiny()
    };
    let corpus = synthetic.write(&root.join("corpus")).unwrap();
    let run = trained(&corpus, &root.join("run"), &few_steps());
    let metrics = judged(&run, &corpus);
    (corpus, run, metrics)
}

fn mape(metrics: &Metrics, name: &str) -> f64 {
    metrics.estimators[name]
        .overall
        .combination
        .and_then(|combination| combination.mape_pct)
        .unwrap()
}

#[test]
fn a_tiny_training_predicts_held_out_trajectories_and_leaves_a_whole_run() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = tiny(folder.path());
    let run = trained(&corpus, &folder.path().join("run"), &small());
    let metrics = judged(&run, &corpus);

    // A constant predictor is off by tens of percent; so is one that has learned from the wrong view.
    for (name, most_pct) in [
        ("paper_lstm", 8.0),
        ("triangulation", 0.2),
        ("mono_pinhole", 4.0),
    ] {
        let pct = mape(&metrics, name);
        assert!(pct < most_pct, "{name}: {pct}");
    }
    let table = Table::read(&run.predictions_path(), u64::MAX).unwrap();
    let truth = table.f64("dtd_m").unwrap();
    let mean = truth.iter().sum::<f64>() / truth.len() as f64;
    let constant =
        truth.iter().map(|t| (mean - t).abs() / t).sum::<f64>() / truth.len() as f64 * 100.0;
    assert!(
        mape(&metrics, "paper_lstm") < constant / 10.0,
        "constant: {constant}"
    );

    // The figures agree with the stored predictions.
    let stored = table.optional_f64("paper_lstm_dtd_m").unwrap();
    let errors: Vec<f64> = stored
        .iter()
        .zip(&truth)
        .filter_map(|(p, t)| Some(((*p)? - t).abs() / t * 100.0))
        .collect();
    let stored_pct = errors.iter().sum::<f64>() / errors.len() as f64;
    assert!((stored_pct - mape(&metrics, "paper_lstm")).abs() < 1e-9);
    let detections = table.u32("detections").unwrap();
    let triangulated = table.optional_f64("triangulation_dtd_m").unwrap();
    assert!(
        detections
            .iter()
            .zip(&triangulated)
            .all(|(&seen, answer)| (seen >= 2) == answer.is_some())
    );

    let written: serde_json::Value = read_json(&run.metrics_path(), "metrics").unwrap();
    let lstm = &written["estimators"]["paper_lstm"];
    assert!(
        lstm["dual"]["samples"].as_u64().unwrap()
            < lstm["combination"]["samples"].as_u64().unwrap()
    );
    assert!(
        lstm["by_weather"]
            .as_object()
            .unwrap()
            .values()
            .all(|w| w["dual"]["mape_pct"].is_number())
    );
    let deviations = [
        PaperDeviation::MiniBatches,
        PaperDeviation::StageEnd,
        PaperDeviation::WhiteFeatures,
        PaperDeviation::LayerWidths,
    ];
    assert_eq!(metrics.deviations_from_paper, deviations);
    let report = fs::read_to_string(run.report_path()).unwrap();
    for needed in [
        "paper_lstm",
        "deviates from the paper in: mini-batches in stage one, ends of the stages, whitened features, layer widths<",
        "<svg",
        "A held-out approach",
        "Convergence",
    ] {
        assert!(report.contains(needed), "{needed}");
    }
    let rest = report.replace("http://www.w3.org/2000/svg", "");
    assert!(
        !rest.contains("http") && !rest.contains("src="),
        "the report must open offline"
    );
}

#[test]
fn the_same_seed_gives_the_same_weights_and_another_seed_does_not() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = tiny(folder.path());
    let config = few_steps();
    let weights = |name: &str, seed: u64| {
        let config = TrainConfig {
            seed,
            ..config.clone()
        };
        let run = trained(&corpus, &folder.path().join(name), &config);
        let bytes = fs::read(run.weights_path()).unwrap();
        (mape(&judged(&run, &corpus), "paper_lstm"), bytes)
    };
    let first = weights("a", 0);
    for again in ["b", "c", "d"] {
        assert!(first == weights(again, 0), "other bytes in {again}");
    }
    assert!(first != weights("e", 1));
    // Like any other file of this process.
    let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
    let run = RunFolder::at(&folder.path().join("a"));
    let ordinary = folder.path().join("ordinary");
    fs::write(&ordinary, "").unwrap();
    assert_eq!(mode(&run.weights_path()), mode(&ordinary));
}

#[test]
fn one_trajectory_a_side_is_enough_and_one_in_all_is_explained() {
    let folder = tempfile::tempdir().unwrap();
    let sides = |name: &str, train: usize, validation, test| {
        let corpus = SyntheticCorpus {
            train,
            validation,
            test,
            ..SyntheticCorpus::tiny()
        };
        corpus.write(&folder.path().join(name)).unwrap()
    };
    let corpus = sides("three", 1, 1, 1);
    let run = trained(&corpus, &folder.path().join("run"), &few_steps());
    judged(&run, &corpus);
    for (name, empty, [train_count, validation]) in
        [("one", "validation", [1, 0]), ("other", "training", [0, 1])]
    {
        let corpus = sides(name, train_count, validation, 0);
        let out = folder.path().join(format!("run-{name}"));
        let message = train(&corpus, &out, &few_steps(), &Silent)
            .unwrap_err()
            .to_string();
        assert!(
            message.contains(&format!("no samples on the {empty} side")),
            "{message}"
        );
    }
    let two = sides("two", 1, 1, 0);
    let nowhere = RunFolder::at(&folder.path().join("nowhere"));
    for (run, needed) in [
        (&run, "no samples on the test side"),
        (&nowhere, "dtd train"),
    ] {
        let refused = evaluate(run, &two, &EvaluationConfig::default(), &Silent);
        let message = refused.unwrap_err().to_string();
        assert!(message.contains(needed), "{message}");
    }
}

/// Replaces the detections of all scenarios of one side: `change` gets the box of each.
fn with_boxes(corpus: &Corpus, side: Side, change: impl Fn(PixelBox) -> PixelBox) {
    let splits = Splits::read(&corpus.splits_path()).unwrap();
    for id in splits.side(side) {
        let folder = corpus.scenario(id);
        let scenario = folder.open().unwrap();
        let mut detections = scenario.detections(MODEL_HASH).unwrap();
        for detection in &mut detections.boxes {
            detection.pixel_box = change(detection.pixel_box);
        }
        let claim = folder.claim().unwrap();
        replace(
            &claim,
            &scenario,
            &model(),
            MODEL_HASH,
            NewTables::unregistered(&detections),
            |made| made,
        )
        .unwrap();
    }
}

fn few_steps() -> TrainConfig {
    let mut config = small();
    config.calibration.optimisation.steps = 40;
    config.estimator.optimisation.steps = 40;
    config.mono.optimisation.steps = 20;
    config
}

#[test]
fn a_training_that_leaves_the_paper_s_method_names_in_what() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = tiny(folder.path());
    with_boxes(&corpus, Side::Train, |seen| PixelBox {
        // Boxes of the last mile or so are moved away.
        cy_px: seen.cy_px + if seen.width_px > 100.0 { 200.0 } else { 0.0 },
        ..seen
    });
    let run = |name: &str, config: &TrainConfig| {
        let out = folder.path().join(name);
        let run = trained(&corpus, &out, config);
        let metrics = judged(&run, &corpus);
        let summary: serde_json::Value = read_json(&out.join("run.json"), "summary").unwrap();
        let report = fs::read_to_string(run.report_path()).unwrap();
        (metrics.deviations_from_paper, summary, report)
    };
    let (_, plain, _) = run("plain", &few_steps());
    let mut config = few_steps();
    config.loss = Loss::Logarithmic;
    config.only_true_boxes = true;
    config.calibration.gap_threshold_pct = 0.25;
    config.estimator.alone_weight = 0.02;
    let (deviations, altered, report) = run("altered", &config);
    let expected = [
        PaperDeviation::MiniBatches,
        PaperDeviation::StageEnd,
        PaperDeviation::WhiteFeatures,
        PaperDeviation::Loss,
        PaperDeviation::OnlyTrueBoxes,
        PaperDeviation::AlgorithmThresholds,
        PaperDeviation::ViewDropout,
        PaperDeviation::LayerWidths,
    ];
    assert_eq!(deviations, expected);
    for words in [
        "whitened features, loss, false training boxes removed by the labels",
        "for the figures above. Networks minimise the <em>logarithmic</em> loss",
    ] {
        assert!(report.contains(words), "no {words:?} in the report");
    }
    let dropped = &plain["dropped_training_boxes"];
    assert!(dropped["left"]["dropped"].as_u64().unwrap() > 0);
    assert_eq!(*dropped, altered["dropped_training_boxes"]);
    let samples = |summary: &serde_json::Value| summary["training_samples"].as_u64().unwrap();
    assert!(
        samples(&plain) > samples(&altered),
        "false boxes are learned from unless the settings remove them: {plain} {altered}"
    );
}

#[test]
fn inverse_range_is_what_scipy_solves_and_what_the_predictions_hold() {
    let folder = tempfile::tempdir().unwrap();
    let (corpus, run, metrics) = trained_with_shifts(folder.path(), 0.02);
    let judged = Command::new(program_of_venv("python"))
        .arg(repository().join("tests/judges/inverse_range.py"))
        .args([corpus.root(), run.root()])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&judged.stderr);
    assert!(judged.status.success(), "{said}");
    let judged: serde_json::Value = serde_json::from_slice(&judged.stdout).unwrap();
    println!("{judged}");
    // Both views registered, both from boxes, each alone.
    let fits = judged["fits"].as_array().unwrap();
    assert_eq!(fits.len(), 4, "{judged}");
    for fit in fits {
        for (key, most) in [("apart", 1e-5), ("deviation_apart", 0.1)] {
            assert!(fit[key].as_f64().unwrap() < most, "{key}: {fit}");
        }
    }
    let answered = metrics.estimators["inverse_range"].overall.all.samples;
    assert_eq!(judged["predictions"].as_u64().unwrap(), answered as u64);
    assert!(
        judged["predictions_apart"].as_f64().unwrap() < 1e-9,
        "{judged}"
    );
    let dual = |name: &str| {
        let dual = metrics.estimators[name].overall.dual;
        dual.unwrap().mape_pct.unwrap()
    };
    assert!(
        dual("inverse_range") < dual("triangulation"),
        "{} {}",
        dual("inverse_range"),
        dual("triangulation")
    );
}

#[test]
fn filters_answer_where_a_view_was_removed_and_state_intervals() {
    let folder = tempfile::tempdir().unwrap();
    let (_, run, metrics) = trained_with_shifts(folder.path(), 0.05);
    let of = |name: &str| &metrics.estimators[name];
    let removed = |name: &str| {
        of(name).views_removed["random_15_pct"]
            .removed
            .mape_pct
            .unwrap()
    };
    let table = Table::read(&run.predictions_path(), u64::MAX).unwrap();
    for name in ["inverse_range_filtered", "inverse_range_smoothed"] {
        let [filter, per_tick] = [name, "inverse_range"].map(|name| of(name).overall.all);
        assert!(
            filter.samples >= per_tick.samples,
            "{name}: {filter:?} {per_tick:?}"
        );
        let [with_filter, without] = [name, "inverse_range"].map(removed);
        assert!(
            with_filter < 0.5 * without,
            "{name}: {with_filter} {without}"
        );
        let stated = of(name).stated_intervals.unwrap();
        assert!(
            stated.held > 0.6 && stated.width_pct < 1.0,
            "{name}: {stated:?}"
        );
        for column in ["dtd_m_sd", "ground_speed_mps", "time_to_touchdown_s_from"] {
            let numbers = table.optional_f64(&format!("{name}_{column}")).unwrap();
            let answered = numbers.iter().flatten().count();
            assert_eq!(answered, filter.samples, "{name}_{column}");
        }
    }
    assert_eq!(of("inverse_range").stated_intervals, None);
    let report = fs::read_to_string(run.report_path()).unwrap();
    assert_eq!(
        report.matches("states 90 % intervals. They hold").count(),
        2
    );
}

/// A speck that no aircraft on these approaches ever was, yet completely in the image.
fn speck(_: PixelBox) -> PixelBox {
    PixelBox {
        cx_px: 900.0,
        cy_px: 1_200.0,
        width_px: 3.0,
        height_px: 1.0,
    }
}

#[test]
fn no_estimator_answers_where_every_box_is_unlike_any_of_the_training_side() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = tiny(folder.path());
    let run = trained(&corpus, &folder.path().join("run"), &few_steps());
    with_boxes(&corpus, Side::Test, speck);
    let metrics = judged(&run, &corpus);
    for (name, figures) in &metrics.estimators {
        let combination = figures.overall.combination.unwrap();
        assert_eq!(combination.samples, 0, "{name}");
        assert_eq!(combination.mape_pct, None, "{name}");
    }
    let table = Table::read(&run.predictions_path(), u64::MAX).unwrap();
    assert!(
        table.rows() > 50
            && table
                .u32("detections")
                .unwrap()
                .iter()
                .all(|&seen| seen == 0)
    );
}

#[test]
fn sides_without_a_box_that_can_be_used_are_explained() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = tiny(folder.path());
    let message = |corpus: &Corpus| {
        train(corpus, &folder.path().join("run"), &few_steps(), &Silent)
            .unwrap_err()
            .to_string()
    };
    with_boxes(&corpus, Side::Validation, speck);
    let validation = message(&corpus);
    assert!(
        validation.contains("validation side") && validation.contains("sizes of the boxes"),
        "{validation}"
    );
    with_boxes(&corpus, Side::Train, speck);
    let training = message(&corpus);
    assert!(
        training.contains("training side") && training.contains("no box of theirs is where"),
        "{training}"
    );
}
