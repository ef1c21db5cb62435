//! Parts of the paper's experiment besides its estimator: its split, networks of one view, yardsticks without images, and a training
//! that goes to its own end.

mod hardly_trained;

use std::fs;

use dataset::files::json_file::read_json;
use dataset::tables::columns::Table;
use dataset::work::watch::Silent;
use serde_json::Value;
use testkit::synthetic::SyntheticCorpus;
use trainer::config::{ScenarioSplitConfig, StageEnd};
use trainer::{
    EvaluationConfig, JudgedSide, RunFolder, TrainConfig, evaluate, figures, train, train_on_all,
};

use hardly_trained::{hardly_trained, judged, tiny, trained};

fn json_of(run: &RunFolder, name: &str) -> Value {
    read_json(&run.root().join(name), "file of a run").unwrap()
}

#[test]
fn a_split_by_scenario_is_judged_on_what_was_drawn_and_says_which_flights_are_shared() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = tiny(folder.path());
    let config = TrainConfig {
        scenario_split: Some(ScenarioSplitConfig {
            seed: 3,
            ..ScenarioSplitConfig::default()
        }),
        ..hardly_trained()
    };
    let run = trained(&corpus, &folder.path().join("run"), &config);
    let metrics = judged(&run, &corpus);
    assert_eq!(metrics.split.by, "scenario");
    let drawn = &json_of(&run, "run.json")["scenario_split"]["test"];
    let drawn: Vec<&String> = drawn.as_object().unwrap().keys().collect();
    let flights = &metrics.estimators["paper_lstm"].by_flight;
    let judged_scenarios: Vec<&String> = flights.iter().map(|flight| &flight.scenario).collect();
    assert_eq!(judged_scenarios, drawn);
    assert_eq!((drawn.len(), metrics.split.test.scenarios), (2, 2));
    // Each scenario of this corpus flies its own flight.
    assert_eq!(metrics.split.test_scenarios_sharing_flights, 0);
    let report = fs::read_to_string(run.report_path()).unwrap();
    assert!(report.contains("0 of 2 test\nscenarios fly a flight that was learned from"));
    // All scenarios: most were used for training.
    let all = EvaluationConfig {
        side: JudgedSide::All,
        out: Some(folder.path().join("all")),
        ..EvaluationConfig::default()
    };
    let error = evaluate(&run, &corpus, &all, &Silent).unwrap_err();
    assert!(matches!(error, trainer::Error::Leak { .. }), "{error}");

    // A second corpus, and the same corpus twice.
    let other = SyntheticCorpus {
        seed: 1,
        ..SyntheticCorpus::tiny()
    };
    let other = other.write(&folder.path().join("other")).unwrap();
    let error = evaluate(&run, &other, &EvaluationConfig::default(), &Silent).unwrap_err();
    assert!(error.to_string().contains("--side all"), "{error}");
    let twice = [corpus.clone(), corpus.clone()];
    let error = train_on_all(
        &twice,
        &folder.path().join("twice"),
        &config,
        false,
        &Silent,
    )
    .unwrap_err();
    assert!(error.to_string().contains("set for 2 corpora"), "{error}");

    let both = TrainConfig {
        leave_out: Some("weather=clear".into()),
        ..config
    };
    let error = train(&corpus, &folder.path().join("both"), &both, &Silent).unwrap_err();
    assert!(error.to_string().contains("scenario_split"), "{error}");
}

#[test]
fn yardsticks_answer_where_a_view_sees_and_single_views_are_compared() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = tiny(folder.path());
    let run = trained(&corpus, &folder.path().join("run"), &hardly_trained());
    let metrics = judged(&run, &corpus);
    let table = Table::read(&run.predictions_path(), u64::MAX).unwrap();
    let detections = table.u32("detections").unwrap();
    for name in ["no_vision_time", "no_vision_time_weather"] {
        let answers = table.optional_f64(&format!("{name}_dtd_m")).unwrap();
        let mut ticks = detections.iter().zip(&answers);
        assert!(ticks.all(|(&seen, answer)| (seen > 0) == answer.is_some()));
        // All flights of this corpus have the same speed, and start at distances that differ by some percent.
        let error_pct = metrics.estimators[name].overall.all.mape_pct.unwrap();
        assert!((0.01..20.0).contains(&error_pct), "{name}: {error_pct}");
    }
    let report = fs::read_to_string(run.report_path()).unwrap();
    let (best, rest) = report.split_once("<h2>All estimators</h2>").unwrap();
    assert!(
        !best.contains("<code>no_vision_time"),
        "they are never ranked"
    );
    assert!(rest.contains("see no image.") && rest.contains("Against one view"));

    assert_eq!(metrics.against_one_view.len(), 3);
    for row in &metrics.against_one_view {
        let of = &metrics.estimators[&row.estimator];
        let [left, right] = ["left", "right"].map(|view| {
            let alone = of.views_removed[&format!("only_{view}")].all;
            assert_eq!(row.mape_by_view_pct[view], alone.mape_pct);
            alone.mape_pct.unwrap()
        });
        assert!((row.mean_pct.unwrap() - f64::midpoint(left, right)).abs() < 1e-9);
    }
    let of = &metrics.estimators["paper_lstm"];
    let cells = of.by_weather_and_time.values();
    let samples: usize = cells.map(|cell| cell.all.samples).sum();
    assert_eq!(samples, of.overall.all.samples);
    for bin in &of.by_distance_nm {
        let signed = bin.signed.unwrap();
        assert!(signed.quartiles_pct.is_sorted());
        assert!(signed.mean_pct.abs() <= bin.figures.mape_pct.unwrap() + 1e-9);
    }
    for drawing in [
        figures::convergence(&run).unwrap(),
        figures::errors_by_distance(&metrics, &["paper_lstm", "mono_network"]),
    ] {
        assert!(drawing.starts_with("<svg") && drawing.matches("<p").count() > 1);
    }
}

#[test]
fn a_training_to_its_plateau_makes_no_more_cycles_than_help_and_records_them() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = tiny(folder.path());
    let mut config = hardly_trained();
    let limit = 8 * config.estimator.optimisation.steps;
    config.estimator.optimisation.steps = limit;
    config.estimator.first_cycle = limit / 16;
    // No cycle is better by so much.
    config.calibration.plateau_threshold_pct = 1e5;
    let run = trained(&corpus, &folder.path().join("run"), &config);
    let stages = &json_of(&run, "run.json")["stages"];
    let stage = |network: &str| {
        let mut stages = stages.as_array().unwrap().iter();
        stages.find(|stage| stage["network"] == network).unwrap()
    };
    let lstm = stage("paper_lstm");
    assert_eq!(lstm["ended_by"], "plateau", "{lstm}");
    // A second cycle of twice the length shows that nothing is gained.
    assert_eq!(lstm["steps"], 3 * (limit / 16));
    assert_eq!(lstm["cycles"].as_array().unwrap().len(), 2);
    let passes = lstm["passes"].as_f64().unwrap() * lstm["samples"].as_f64().unwrap();
    let drawn = lstm["steps"].as_f64().unwrap() * lstm["batch_size"].as_f64().unwrap();
    assert!((passes - drawn).abs() < 1e-6);
    let convergence = json_of(&run, "convergence.json");
    let entries = convergence["estimator"].as_array().unwrap();
    assert!(
        entries
            .iter()
            .all(|entry| entry["training_loss"].is_number())
    );

    config.estimator.ends = StageEnd::Steps;
    let run = trained(&corpus, &folder.path().join("steps"), &config);
    let summary = json_of(&run, "run.json");
    let mut stages = summary["stages"].as_array().unwrap().iter();
    let lstm = stages
        .find(|stage| stage["network"] == "paper_lstm")
        .unwrap();
    assert_eq!(
        (&lstm["ended_by"], &lstm["steps"]),
        (&"steps".into(), &limit.into())
    );
}
