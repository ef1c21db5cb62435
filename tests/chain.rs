//! The whole pipeline over real sockets: stand-in, generator, labels, detections, training, evaluation; checked from outside.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use serde_json::Value;

fn repository() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn dtd(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_dtd"))
        .args(arguments)
        .current_dir(repository())
        .output()
        .unwrap()
}

/// Runs a verb that must succeed and returns what it prints as JSON.
fn dtd_json(arguments: &[&str]) -> Value {
    let output = dtd(arguments);
    assert!(
        output.status.success(),
        "{arguments:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    serde_json::from_slice(&output.stdout).unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A labelled corpus shared by all tests of one sweep. Recorded once per run of the tests.
struct Shared(OnceLock<tempfile::TempDir>);

impl Shared {
    const fn new() -> Self {
        Self(OnceLock::new())
    }

    fn corpus(&self, sweep: &str) -> PathBuf {
        let folder = self.0.get_or_init(|| {
            let folder = tempfile::tempdir().unwrap();
            let corpus = folder.path().join("corpus");
            let made = dtd_json(&["generate", sweep, "--out", text(&corpus), "--json"]);
            assert_eq!(made["committed"].as_array().unwrap().len(), 6, "{made}");
            assert_eq!(made["failed"], serde_json::json!([]));
            let labelled = dtd_json(&["label", text(&corpus), "--json"]);
            assert_eq!(
                labelled["labelled"].as_array().unwrap().len(),
                6,
                "{labelled}"
            );
            folder
        });
        folder.path().join("corpus")
    }
}

/// Six recorded flights in tiny pictures.
fn recorded() -> PathBuf {
    static CORPUS: Shared = Shared::new();
    CORPUS.corpus("tests/data/recorded.toml")
}

/// Six approaches in full resolution at a low frame rate.
fn full_size() -> PathBuf {
    static CORPUS: Shared = Shared::new();
    CORPUS.corpus("tests/data/chain.toml")
}

fn copy_folder(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy_folder(&entry.path(), &target);
        } else {
            fs::copy(entry.path(), target).unwrap();
        }
    }
}

/// Every file of a folder with its bytes, sorted by name.
fn contents(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let bytes = fs::read(&path).unwrap();
                found.push((path, bytes));
            }
        }
    }
    found.sort();
    found
}

/// Runs a Python check on a corpus; returns its result.
fn judge(script: &str, corpus: &Path) -> Value {
    let python = repository().join(".venv/bin/python");
    assert!(
        python.exists(),
        "run `bash scripts/setup.sh` first: {} is missing",
        python.display()
    );
    let output = Command::new(python)
        .arg(repository().join("tests/judges").join(script))
        .arg(corpus)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        output.status.success(),
        "{said}{}",
        String::from_utf8_lossy(&output.stderr)
    );
    serde_json::from_str(&said).unwrap()
}

#[test]
fn dtd_labels_of_the_recorded_flights_agree_with_geographiclib_to_a_millimetre() {
    let verdict = judge("geodesic_dtd.py", &recorded());
    assert_eq!(verdict["scenarios"], 6);
    assert!(verdict["rows"].as_u64().unwrap() > 1_000, "{verdict}");
}

#[test]
fn true_boxes_hold_the_aircraft_as_an_independent_projection_sees_it() {
    let verdict = judge("projection.py", &full_size());
    assert!(verdict["boxes"].as_u64().unwrap() > 200, "{verdict}");
}

#[test]
fn a_fresh_corpus_has_no_faults_and_one_picture_per_tick_and_view() {
    for corpus in [recorded(), full_size()] {
        let report = dtd_json(&["verify", text(&corpus), "--json"]);
        assert_eq!(report["findings"], serde_json::json!([]));
        assert_eq!(report["labelled"], 6);
        assert_eq!(
            report["pictures"].as_u64().unwrap(),
            2 * report["ticks"].as_u64().unwrap()
        );
    }
}

#[test]
fn generating_and_labelling_again_changes_no_byte() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = folder.path().join("corpus");
    copy_folder(&recorded(), &corpus);
    let before = contents(&corpus);
    let again = dtd_json(&[
        "generate",
        "tests/data/recorded.toml",
        "--out",
        text(&corpus),
        "--json",
    ]);
    assert_eq!(again["skipped"].as_array().unwrap().len(), 6, "{again}");
    assert_eq!(again["committed"], serde_json::json!([]));
    let again = dtd_json(&["label", text(&corpus), "--json"]);
    assert_eq!(again["unchanged"].as_array().unwrap().len(), 6, "{again}");
    assert!(before == contents(&corpus), "a file changed");
}

#[test]
fn a_scenario_that_is_made_again_has_the_same_bytes_in_its_tables() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = folder.path().join("corpus");
    copy_folder(&recorded(), &corpus);
    let scenario = corpus.join("scenarios/1200-clear-r3");
    let frames = fs::read(scenario.join("frames.parquet")).unwrap();
    let boxes = fs::read(scenario.join("boxes_truth.parquet")).unwrap();
    fs::remove_dir_all(&scenario).unwrap();
    let again = dtd_json(&[
        "generate",
        "tests/data/recorded.toml",
        "--out",
        text(&corpus),
        "--json",
    ]);
    assert_eq!(again["committed"], serde_json::json!(["1200-clear-r3"]));
    dtd_json(&["label", text(&corpus), "--json"]);
    assert!(
        frames == fs::read(scenario.join("frames.parquet")).unwrap(),
        "frames.parquet differs"
    );
    assert!(
        boxes == fs::read(scenario.join("boxes_truth.parquet")).unwrap(),
        "boxes_truth.parquet differs"
    );
}

#[test]
fn verify_names_the_scenario_and_the_file_that_somebody_changed() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = folder.path().join("corpus");
    copy_folder(&recorded(), &corpus);
    let video = corpus.join("scenarios/1200-clear-r2/views/right.mp4");
    let mut bytes = fs::read(&video).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x40;
    fs::write(&video, bytes).unwrap();
    let output = dtd(&["verify", text(&corpus)]);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(
        said.contains("1200-clear-r2") && said.contains("views/right.mp4"),
        "{said}"
    );
}

#[test]
fn the_detector_finds_the_aircraft_and_the_estimators_learn_its_distance() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = folder.path().join("corpus");
    copy_folder(&full_size(), &corpus);
    let detected = dtd_json(&["detect", text(&corpus), "--json"]);
    let truth = &detected["counts"]["against_truth"];
    let [expected, found] = ["expected", "found"].map(|key| truth[key].as_f64().unwrap());
    assert!(found > 0.8 * expected, "{detected}");
    let center_error_px = truth["sum_center_error_px"].as_f64().unwrap() / found;
    assert!(center_error_px < 1.5, "{center_error_px} px");

    let run = folder.path().join("run");
    let settings = repository().join("tests/data/quick_training.toml");
    dtd_json(&[
        "train",
        text(&corpus),
        "--out",
        text(&run),
        "--config",
        text(&settings),
        "--json",
    ]);
    let metrics = dtd_json(&["evaluate", text(&run), "--corpus", text(&corpus), "--json"]);
    let written: Value =
        serde_json::from_slice(&fs::read(run.join("metrics.json")).unwrap()).unwrap();
    assert_eq!(metrics, written);
    let mape = |name: &str| metrics["estimators"][name]["mape_pct"].as_f64().unwrap();
    assert!(
        mape("triangulation") < 1.0,
        "triangulation {}",
        mape("triangulation")
    );
    assert!(
        mape("paper_lstm") < 5.0,
        "paper_lstm {}",
        mape("paper_lstm")
    );
    assert!(mape("mono_pinhole") > mape("triangulation"));
    assert!(mape("mono_network").is_finite());
    let report = fs::read_to_string(run.join("report.html")).unwrap();
    assert!(
        report.contains("<svg") && !report.contains("http://") || !report.contains("src=\"http"),
        "not self-contained"
    );
}
