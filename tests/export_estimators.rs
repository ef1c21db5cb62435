//! `dtd export-estimators` from outside: ONNX Runtime in Python answers what the evaluation stored, the example of the documentation
//! runs, and no folder is left with models of two exports.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;
use tempfile::TempDir;
use testkit::command::{Dtd, json, said, text};
use testkit::synthetic::SyntheticCorpus;
use testkit::{onnx_runtime, program_of_venv, repository};

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

const ESTIMATORS: [&str; 6] = [
    "inverse_range",
    "mono_network",
    "mono_network_box",
    "mono_network_position",
    "mono_pinhole",
    "paper_lstm",
];

const SETTINGS: &str = "
[calibration]
hidden = [16]
features = 16
head_hidden = [16]
optimisation = { steps = 60, batch_size = 64, learning_rate = 0.003 }
[estimator]
lstm = [16, 16]
head_hidden = [16]
optimisation = { steps = 60, batch_size = 64, learning_rate = 0.003 }
[mono]
optimisation = { steps = 60, batch_size = 64, learning_rate = 0.003 }
";

fn corpus() -> SyntheticCorpus {
    SyntheticCorpus {
        shift_noise_px: Some(0.02),
        miss_ratio: 0.2,
        ..SyntheticCorpus::tiny()
    }
}

/// A corpus of geometry with registrations, and a run that was evaluated on it.
struct Workshop {
    folder: TempDir,
}

impl Workshop {
    fn new(settings: &str) -> Self {
        Self::of(&corpus(), settings)
    }

    fn of(corpus: &SyntheticCorpus, settings: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let workshop = Self { folder };
        corpus.write(&workshop.path("corpus")).unwrap();
        fs::write(workshop.path("train.toml"), settings).unwrap();
        let [corpus, run, settings] =
            ["corpus", "run", "train.toml"].map(|name| workshop.path(name));
        let [corpus, run, settings] = [&corpus, &run, &settings].map(|path| text(path));
        DTD.json(&[
            "train", corpus, "--out", run, "--config", settings, "--json",
        ]);
        DTD.json(&["evaluate", run, "--corpus", corpus, "--json"]);
        workshop
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn export(&self) -> Output {
        let [run, out] = ["run", "models"].map(|name| self.path(name));
        let library = text(onnx_runtime());
        let out = ["--out", text(&out), "--onnx-runtime", library, "--json"];
        DTD.run(&[&["export-estimators", text(&run)][..], &out].concat())
    }
}

/// Python's ONNX Runtime answers what the run's predictions are.
fn assert_onnx_runtime_agrees(workshop: &Workshop) {
    let judge = repository().join("tests/judges/export_estimators.py");
    let [corpus, run, models] = ["corpus", "run", "models"].map(|name| workshop.path(name));
    let judged = python(&[&judge, &corpus, &run, &models], repository());
    assert!(judged.status.success(), "{}", said(&judged));
    let verdict: Value = json(&judged);
    println!("{verdict}");
    for name in ESTIMATORS {
        let of = &verdict[name];
        assert!(of["answered"].as_u64().unwrap() > 100, "{name}: {of}");
        assert!(of["apart"].as_f64().unwrap() <= 1e-5, "{name}: {of}");
    }
}

fn python(arguments: &[&Path], folder: &Path) -> Output {
    Command::new(program_of_venv("python"))
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap()
}

#[test]
fn onnx_runtime_answers_what_the_evaluation_stored() {
    let workshop = Workshop::new(SETTINGS);
    let exported = json(&workshop.export());
    let names: Vec<&str> = exported
        .as_array()
        .unwrap()
        .iter()
        .map(|model| model["estimator"].as_str().unwrap())
        .collect();
    assert_eq!(
        names
            .iter()
            .copied()
            .collect::<std::collections::BTreeSet<_>>(),
        ESTIMATORS.into()
    );
    for model in exported.as_array().unwrap() {
        assert!(
            model["largest_difference"].as_f64().unwrap() <= 1e-5,
            "{model}"
        );
        assert!(model["answered"].as_u64().unwrap() > 20, "{model}");
        assert!(
            model["answered"].as_u64().unwrap() < model["probes"].as_u64().unwrap(),
            "ticks without a box have no answer: {model}"
        );
    }
    assert_onnx_runtime_agrees(&workshop);
    let card = fs::read_to_string(workshop.path("models/MODEL_CARD.md")).unwrap();
    for words in [
        "in this order: left, right.",
        "| `paper_lstm.onnx` |",
        "triangulation: not exported",
        "| left | 1920x1280 |",
        "whitened features, layer widths.",
    ] {
        assert!(card.contains(words), "no {words:?} in {card}");
    }
    let metrics: Value =
        serde_json::from_slice(&fs::read(workshop.path("run/metrics.json")).unwrap()).unwrap();
    let stored = &metrics["estimators"]["paper_lstm"]["dual"]["mape_pct"];
    let mape = format!("{:.3} %", stored.as_f64().unwrap());
    assert!(card.contains(&mape), "no {mape} in {card}");
    let forged = metrics.to_string().replace(&stored.to_string(), "0.001");
    fs::write(workshop.path("run/metrics.json"), forged).unwrap();
    let output = workshop.export();
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    assert!(said(&output).contains("not what the evaluation wrote"));
}

#[test]
fn the_numbers_of_three_views_and_their_registrations_come_in_the_order_of_the_views() {
    let corpus = SyntheticCorpus {
        third_camera: true,
        miss_ratio: 0.05,
        ..corpus()
    };
    let workshop = Workshop::of(&corpus, SETTINGS);
    assert!(workshop.export().status.success());
    assert_onnx_runtime_agrees(&workshop);
}

#[test]
fn networks_with_other_settings_agree_too() {
    let altered = format!("loss = \"logarithmic\"\n{SETTINGS}");
    let workshop = Workshop::new(&altered);
    let exported = json(&workshop.export());
    assert_eq!(exported.as_array().unwrap().len(), ESTIMATORS.len());
}

#[test]
fn the_examples_of_the_documentation_run_and_answer_where_a_view_saw_the_aircraft() {
    let workshop = Workshop::new(SETTINGS);
    let output = workshop.export();
    assert!(output.status.success(), "{}", said(&output));
    let docs = fs::read_to_string(repository().join("docs/training.md")).unwrap();
    let blocks = docs.split("```python\n").skip(1);
    let example: String = blocks
        .filter_map(|block| block.split("```").next())
        .collect();
    let script = workshop.path("example.py");
    fs::write(&script, example).unwrap();
    let output = python(&[&script], workshop.folder.path());
    assert!(output.status.success(), "{}", said(&output));
    let answers: Vec<f64> = String::from_utf8_lossy(&output.stdout)
        .lines()
        .map(|line| line.strip_suffix(" m").unwrap().parse().unwrap())
        .collect();
    assert_eq!(answers.len(), 3);
    assert!(
        answers[0].is_finite() && answers[1].is_finite(),
        "{answers:?}"
    );
    assert!(answers[2].is_nan(), "{answers:?}");
}

#[test]
fn models_are_not_written_among_other_files_nor_without_a_runtime() {
    let workshop = Workshop::new(SETTINGS);
    let [run, models] = ["run", "models"].map(|name| workshop.path(name));
    let gone = workshop.path("gone.so");
    let arguments = ["export-estimators", text(&run), "--out", text(&models)];
    let output = DTD.run(&[&arguments[..], &["--onnx-runtime", text(&gone)]].concat());
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    assert!(said(&output).contains("gone.so") && !models.exists());
    fs::create_dir(&models).unwrap();
    assert!(workshop.export().status.success());
    // The same again is there already.
    assert!(workshop.export().status.success());
    let before = fs::read(models.join("paper_lstm.onnx")).unwrap();
    fs::write(models.join("notes"), "").unwrap();
    let output = workshop.export();
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    assert!(said(&output).contains("expected a new or an empty folder"));
    assert!(before == fs::read(models.join("paper_lstm.onnx")).unwrap());
}
