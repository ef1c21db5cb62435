//! Tables of predictions, judged without a run: the same figures as those of a run that predicts the same, and refusals of tables that
//! cannot be judged.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use dataset::corpus::Corpus;
use dataset::corpus::seal;
use dataset::files::json_file::read_json;
use dataset::tables::columns::{Table, TableWriter};
use dataset::work::watch::Silent;
use tempfile::TempDir;
use testkit::synthetic::SyntheticCorpus;
use trainer::{
    EstimatorMetrics, JudgedSide, Moment, RunFolder, TableEvaluationConfig, TableMetrics,
    evaluate_table, predict,
};

mod hardly_trained;
use hardly_trained::{Trained, tiny};

fn judged(table: &Path, corpus: &Corpus) -> TableMetrics {
    evaluate_table(table, corpus, &TableEvaluationConfig::default(), &Silent).unwrap()
}

/// The figures that need no run.
fn without_removals(figures: &EstimatorMetrics) -> EstimatorMetrics {
    EstimatorMetrics {
        views_removed: BTreeMap::new(),
        ..figures.clone()
    }
}

#[test]
fn a_table_of_the_predictions_of_a_run_gets_exactly_the_figures_of_the_run() {
    let evaluated = Trained::on(&SyntheticCorpus::tiny());
    let (corpus, expected) = (evaluated.corpus(), evaluated.judged());
    let table = evaluated.run.predictions_path();
    let found = judged(&table, &corpus);
    assert_eq!(found.estimators.len(), expected.estimators.len());
    for (name, figures) in &expected.estimators {
        assert_eq!(found.estimators[name], without_removals(figures), "{name}");
    }
    let stated = found.estimators["inverse_range_filtered"].stated_intervals;
    assert!(stated.is_some(), "the intervals of the table are judged");
    let (there, common) = (expected.ticks.there, expected.ticks.common);
    assert_eq!((found.ticks.there, found.ticks.common), (there, common));
    assert_eq!(found.ticks.seen, expected.ticks.seen);
    assert_eq!(found.ticks.hidden_by_fog, expected.ticks.hidden_by_fog);
    assert_eq!(
        found.judged.scenarios_blake3,
        expected.judged.scenarios_blake3
    );

    // A table of `dtd predict` has all ticks of all sides. The smoother uses those past touchdown, which an evaluation does not have, and
    // sums of the networks' f32 depend on which ticks are predicted together.
    let out = evaluated.path("predicted.parquet");
    predict(
        &evaluated.run,
        &corpus,
        None,
        &out,
        Moment::Hindsight,
        &Silent,
    )
    .unwrap();
    let found = judged(&out, &corpus);
    for name in ["self_calibrated", "triangulation", "mono_pinhole"] {
        let of_run = EstimatorMetrics {
            // These ticks are common to estimators with other answers.
            common: found.estimators[name].common,
            ..without_removals(&expected.estimators[name])
        };
        assert_eq!(found.estimators[name], of_run, "{name}");
    }
    for name in ["inverse_range", "inverse_range_filtered", "paper_lstm"] {
        let [found, expected] =
            [&found.estimators, &expected.estimators].map(|of| of[name].overall.all);
        assert_eq!(found.samples, expected.samples, "{name}");
        let [found, expected] = [found, expected].map(|of| of.mape_pct.unwrap());
        // Distances that differ by less than 1e-5.
        assert!(
            (found - expected).abs() < 2e-3,
            "{name}: {found} {expected}"
        );
    }
}

#[test]
fn a_csv_file_gets_the_figures_of_the_same_parquet_file_and_needs_no_number_of_views() {
    let evaluated = Trained::on(&SyntheticCorpus::tiny());
    let (corpus, metrics) = (evaluated.corpus(), evaluated.judged());
    let parquet = Table::read(&evaluated.run.predictions_path(), u64::MAX).unwrap();
    let numbers = |column: &str| parquet.any_numbers(column).unwrap();
    let [distance, from, to] =
        ["", "_from", "_to"].map(|end| numbers(&format!("inverse_range_filtered_dtd_m{end}")));
    let mut csv = String::from("note,scenario,tick,mine_dtd_m,mine_from_m,mine_to_m\n");
    let text = |value: Option<f64>| value.map_or(String::new(), |value| format!("{value:?}"));
    let scenarios = parquet.text("scenario").unwrap();
    for (row, (scenario, tick)) in scenarios
        .iter()
        .zip(parquet.u32("tick").unwrap())
        .enumerate()
    {
        let [distance, from, to] = [&distance, &from, &to].map(|values| text(values[row]));
        writeln!(csv, "\"a, b\", {scenario},{tick},{distance},{from},{to}").unwrap();
    }
    let table = evaluated.path("mine.CSV");
    fs::write(&table, csv).unwrap();
    // No detector is needed.
    for folder in corpus.scenarios().unwrap() {
        for part in ["detections", "registrations"] {
            let _ = fs::remove_dir_all(folder.root().join(part));
        }
        seal::seal_folder(folder.root(), "synthetic").unwrap();
    }
    let found = judged(&table, &corpus);
    assert_eq!((found.ticks.seen, found.estimators.len()), (None, 1));
    let mine = &found.estimators["mine"];
    let expected = &metrics.estimators["inverse_range_filtered"];
    assert_eq!(mine.overall.all, expected.overall.all);
    assert_eq!((mine.overall.dual, mine.overall.combination), (None, None));
    assert_eq!(mine.stated_intervals, expected.stated_intervals);
    assert_eq!(mine.intervals, expected.intervals);
    assert_eq!(mine.by_distance_nm, expected.by_distance_nm);
    let json = serde_json::to_value(&found).unwrap();
    assert!(json["estimators"]["mine"].get("dual").is_none(), "{json}");
}

/// Labelled corpus with the ground truth of the judged ticks.
struct Labelled {
    folder: TempDir,
    corpus: Corpus,
    /// Scenario, tick, and distance in metres; those of the test side that count.
    ticks: Vec<(String, u32, f64)>,
}

impl Labelled {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let corpus = tiny(folder.path());
        let splits = corpus.splits().unwrap();
        let mut ticks = Vec::new();
        for scenario in corpus.scenarios().unwrap() {
            let id = scenario.id();
            if splits.scenarios[&id].side != dataset::corpus::splits::Side::Test {
                continue;
            }
            for row in scenario.open().unwrap().frames().unwrap().rows {
                let labels = row.labels.unwrap();
                if labels.along_track_m > 0.0 && (1_852.0..=18_520.0).contains(&labels.dtd_m) {
                    ticks.push((id.clone(), row.tick, labels.dtd_m));
                }
            }
        }
        Self {
            folder,
            corpus,
            ticks,
        }
    }

    /// A table of `mine` with these rows.
    fn table(&self, rows: &[(String, u32, f64)]) -> PathBuf {
        let path = self.folder.path().join("mine.parquet");
        TableWriter::new()
            .text("scenario", rows.iter().map(|row| &row.0))
            .i64("tick", rows.iter().map(|row| i64::from(row.1)))
            .f64("mine_dtd_m", rows.iter().map(|row| row.2))
            .write(&path)
            .unwrap();
        path
    }

    fn csv(&self, text: &str) -> PathBuf {
        let path = self.folder.path().join("mine.csv");
        fs::write(&path, text).unwrap();
        path
    }

    fn refusal(&self, table: &Path) -> String {
        let refused = evaluate_table(
            table,
            &self.corpus,
            &TableEvaluationConfig::default(),
            &Silent,
        );
        refused.unwrap_err().to_string()
    }

    /// The refusal of the truth after a change to its rows.
    fn refusal_of(&self, change: impl Fn(&mut Vec<(String, u32, f64)>)) -> String {
        let mut rows = self.ticks.clone();
        change(&mut rows);
        self.refusal(&self.table(&rows))
    }
}

fn assert_says(message: &str, needed: &[&str]) {
    for needed in needed {
        assert!(message.contains(needed), "{needed} is not in: {message}");
    }
}

#[test]
fn results_go_to_a_new_folder_that_view_reads_and_that_no_evaluation_replaces() {
    let labelled = Labelled::new();
    let table = labelled.table(&labelled.ticks);
    let out = labelled.folder.path().join("judged");
    let config = TableEvaluationConfig {
        out: Some(out.clone()),
        ..TableEvaluationConfig::default()
    };
    let metrics = evaluate_table(&table, &labelled.corpus, &config, &Silent).unwrap();
    let all = metrics.estimators["mine"].overall.all;
    assert_eq!((all.mape_pct, all.coverage), (Some(0.0), Some(1.0)));
    let results = RunFolder::at(&out);
    let read: TableMetrics = read_json(&results.metrics_path(), "metrics").unwrap();
    assert_eq!(read, metrics);
    assert!(seal::faults(&out).unwrap().is_empty());
    let written = Table::read(&results.predictions_path(), u64::MAX).unwrap();
    let truth: Vec<f64> = labelled.ticks.iter().map(|tick| tick.2).collect();
    assert_eq!(written.f64("dtd_m").unwrap(), truth);
    let page = fs::read_to_string(results.report_path()).unwrap();
    assert_says(&page, &["<code>mine</code>", "mine.parquet", "By weather"]);
    assert!(!page.contains("Dual"), "the table has no number of views");
    let again = evaluate_table(&table, &labelled.corpus, &config, &Silent);
    assert_says(&again.unwrap_err().to_string(), &["is not empty"]);
    // Judged again from the written table.
    let again = judged(&results.predictions_path(), &labelled.corpus);
    assert_eq!(again.estimators, metrics.estimators);
}

#[test]
fn a_file_that_is_no_table_of_predictions_is_refused_with_what_is_expected() {
    let labelled = Labelled::new();
    let path = |name: &str| labelled.folder.path().join(name);
    let refusal = |path: &Path| labelled.refusal(path);
    assert_says(
        &refusal(&path("none.parquet")),
        &["none.parquet: is not there", "NAME_dtd_m"],
    );
    fs::write(path("text.parquet"), "scenario,tick\n").unwrap();
    assert_says(
        &refusal(&path("text.parquet")),
        &["not a Parquet file", ".csv"],
    );
    fs::write(path("cut.parquet"), "PAR1 and no more").unwrap();
    assert_says(&refusal(&path("cut.parquet")), &["cut.parquet"]);
    for (text, needed) in [
        ("", &["has no column scenario"][..]),
        (
            "scenario;tick;a_dtd_m\n",
            &["has no column scenario", "scenario;tick;a_dtd_m"],
        ),
        ("scenario,a_dtd_m\n", &["has no column tick"]),
        (
            "scenario,tick,dtd\n",
            &["no column whose name ends in _dtd_m", "scenario, tick, dtd"],
        ),
        ("scenario,tick,a_dtd_m\n", &["has no rows"]),
        (
            "scenario,tick,a_dtd_m,a_dtd_m\n",
            &["two columns named a_dtd_m"],
        ),
        (
            "scenario,tick,a_dtd_m,a_dtd_m_to\n",
            &["column a_dtd_m_to but no column a_dtd_m_from"],
        ),
        (
            "scenario,tick,_dtd_m\n",
            &["expected a name of an estimator"],
        ),
        ("scenario,tick,a\u{1b}[31m_dtd_m\n", &["\\u{1b}"]),
        (
            "scenario,tick,a_dtd_m\r\n0000,0,5\r\n0000,1,NA\r\n",
            &["line 3: a_dtd_m is \"NA\""],
        ),
        (
            "scenario,tick,a_dtd_m\n0000,1\n",
            &["not a CSV table", "line: 2"],
        ),
        (
            "scenario,tick,a_dtd_m\n0000,1,NA\n",
            &["line 2", "a_dtd_m is \"NA\"", "empty field"],
        ),
        (
            "scenario,tick,a_dtd_m\n,1,5000\n",
            &["row 1 has no scenario"],
        ),
        (
            "scenario,tick,a_dtd_m\n0000,,5000\n",
            &["row 1 has no tick"],
        ),
        (
            "scenario,tick,a_dtd_m\n0000,1.5,5000\n",
            &["row 1: tick is 1.5", "whole number"],
        ),
        (
            "scenario,tick,a_dtd_m\n0000,-1,5000\n",
            &["row 1: tick is -1.0", "from 0"],
        ),
    ] {
        assert_says(&refusal(&labelled.csv(text)), needed);
    }
    let wrong = path("wrong.parquet");
    let table = TableWriter::new()
        .text("scenario", ["0000"])
        .u32("tick", [0]);
    table.text("a_dtd_m", ["far"]).write(&wrong).unwrap();
    assert_says(&refusal(&wrong), &["column a_dtd_m should hold numbers"]);
}

#[test]
fn rows_that_do_not_fit_the_corpus_are_refused_by_scenario_and_tick() {
    let labelled = Labelled::new();
    let (id, tick, _) = labelled.ticks[3].clone();
    let here = format!("scenario {id}, tick {tick}");
    let others = labelled.refusal_of(|rows| {
        rows[0].0 = "other-2".into();
        rows[1].0 = "other-1".into();
    });
    assert_says(
        &others,
        &[
            "2 scenarios",
            "other-1, other-2",
            "the corpus has 0000, 0001",
        ],
    );
    let outside = labelled.refusal_of(|rows| rows[3].1 = 100_000);
    assert_says(&outside, &[&id, "tick 100000", "its ticks are 0 to"]);
    let twice = labelled.refusal_of(|rows| rows.push(rows[3].clone()));
    assert_says(&twice, &[&id, &format!("tick {tick} more than once")]);
    for (value, shown) in [(f64::NAN, "NaN"), (f64::INFINITY, "inf")] {
        let refusal = labelled.refusal_of(|rows| rows[3].2 = value);
        assert_says(
            &refusal,
            &[&here, &format!("mine_dtd_m is {shown}"), "null"],
        );
    }
    let interval = labelled.csv(&format!(
        "scenario,tick,a_dtd_m,a_from_m,a_to_m\n{id},{tick},5000,5100,4900\n"
    ));
    assert_says(
        &labelled.refusal(&interval),
        &[&here, "a_from_m is 5100.0 and a_to_m is 4900.0"],
    );
    let half = labelled.csv(&format!(
        "scenario,tick,a_dtd_m,a_from_m,a_to_m\n{id},{tick},5000,4900,\n"
    ));
    assert_says(&labelled.refusal(&half), &["a_to_m is missing"]);
}

#[test]
fn distances_in_another_unit_or_of_the_opposite_sign_are_refused_with_the_probable_reason() {
    let labelled = Labelled::new();
    let negative = labelled.refusal_of(|rows| rows.iter_mut().for_each(|row| row.2 = -row.2));
    assert_says(
        &negative,
        &["mine_dtd_m", "opposite sign", "-1.000 of the true distance"],
    );
    for (unit, factor) in [
        ("nautical miles", 1.0 / 1_852.0),
        ("feet", 3.280_84),
        ("kilometres", 1e-3),
    ] {
        let refusal = labelled.refusal_of(|rows| {
            for row in rows {
                row.2 *= 1.02 * factor;
            }
        });
        assert_says(
            &refusal,
            &[
                "mine_dtd_m",
                &format!("probably in {unit}"),
                "convert them to metres",
            ],
        );
    }
}

#[test]
fn a_single_negative_distance_is_a_large_error_like_that_of_any_estimator() {
    let labelled = Labelled::new();
    let mut rows = labelled.ticks.clone();
    rows[3].2 = -rows[3].2;
    let found = judged(&labelled.table(&rows), &labelled.corpus);
    let all = found.estimators["mine"].overall.all;
    assert_eq!(all.samples, rows.len());
    let expected_pct = 200.0 / rows.len() as f64;
    assert!(
        (all.mape_pct.unwrap() - expected_pct).abs() < 1e-9,
        "{all:?}"
    );
}

#[test]
fn a_table_of_the_training_side_alone_is_refused_unless_all_sides_are_judged() {
    let labelled = Labelled::new();
    let splits = labelled.corpus.splits().unwrap();
    let mut sides = splits.scenarios.iter();
    let train = dataset::corpus::splits::Side::Train;
    let (id, _) = sides.find(|(_, on)| on.side == train).unwrap();
    let frames = labelled
        .corpus
        .scenario(id)
        .open()
        .unwrap()
        .frames()
        .unwrap();
    let rows = frames.rows.iter();
    let rows: Vec<_> = rows
        .map(|row| (id.clone(), row.tick, row.labels.unwrap().dtd_m))
        .collect();
    let table = labelled.table(&rows);
    let elsewhere = format!(
        "{} rows are of scenarios outside the judged side",
        rows.len()
    );
    assert_says(
        &labelled.refusal(&table),
        &["none of its", &elsewhere, "--side all"],
    );
    let config = TableEvaluationConfig {
        side: JudgedSide::All,
        ..TableEvaluationConfig::default()
    };
    let all = evaluate_table(&table, &labelled.corpus, &config, &Silent).unwrap();
    let figures = all.estimators["mine"].overall.all;
    assert_eq!(figures.mape_pct, Some(0.0));
    assert!(
        figures.coverage.unwrap() < 0.5,
        "other flights have no rows: {figures:?}"
    );
}
