//! `dtd detect` with hostile models and libraries: every output shape, windows and batches that exceed any memory, NaN, and
//! libraries that another user could have planted.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use detector_training::onnx::{
    AttributeProto, Dimension, GraphProto, ModelProto, NodeProto, OperatorSetIdProto,
    StringStringEntryProto, TensorProto, ValueInfoProto,
};
use prost::Message;
use testkit::command::{Dtd, said, text};
use testkit::files::copy_folder;
use testkit::sweep::SmallSweep;
use testkit::{repository, skipped};

/// A few pictures of an approach's end.
fn sweep_toml() -> String {
    SmallSweep {
        name: "few",
        seed: 0,
        weathers: &["clear"],
        repeats: 1,
        size_px: (96, 64),
        frame_rate: "1/8",
        tables: r#"
[start]
dtd_nm = 1
speed_mps = 72

[[recorded]]
files = "flights/01_calm_ils.csv"

[weather.clear]
visibility_m = 80000
wind_speed_mps = 2
wind_from_true_deg = 20
"#,
    }
    .toml()
}

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

fn dtd() -> Command {
    let mut command = DTD.command(&[""; 0]);
    command.env_remove("ORT_DYLIB_PATH");
    command
}

/// A recorded corpus, made once per run of the tests.
fn sound() -> &'static Path {
    static CORPUS: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = CORPUS.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let sweep = folder.path().join("sweep.toml");
        fs::write(&sweep, sweep_toml()).unwrap();
        fs::create_dir(folder.path().join("flights")).unwrap();
        let flight = "01_calm_ils.csv";
        fs::copy(
            repository().join("tests/data/flights").join(flight),
            folder.path().join("flights").join(flight),
        )
        .unwrap();
        let corpus = folder.path().join("corpus");
        let output = dtd()
            .args(["generate", text(&sweep), "--out", text(&corpus)])
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", said(&output));
        folder
    });
    Box::leak(folder.path().join("corpus").into_boxed_path())
}

/// A copy of the valid corpus without detections, for one test.
fn corpus(folder: &Path) -> PathBuf {
    let copy = folder.join("corpus");
    copy_folder(sound(), &copy);
    copy
}

fn node(op_type: &str, inputs: &[&str], outputs: &[&str]) -> NodeProto {
    NodeProto {
        op_type: op_type.into(),
        input: inputs.iter().map(ToString::to_string).collect(),
        output: outputs.iter().map(ToString::to_string).collect(),
        ..NodeProto::default()
    }
}

/// A model that answers every picture with the same number everywhere, in one shape. It takes windows of `input`.
struct Constant<'a> {
    input: [Dimension; 4],
    /// Of the output; 0 where the model adopts the actual size.
    shape: &'a [i64],
    number: f32,
    profile: Option<&'a str>,
}

fn open(name: &str) -> Dimension {
    Dimension::Named(name.into())
}

/// Any number of windows of that size.
fn windows_of(size_px: i64) -> [Dimension; 4] {
    [
        open("batch"),
        Dimension::Fixed(3),
        Dimension::Fixed(size_px),
        Dimension::Fixed(size_px),
    ]
}

impl Constant<'_> {
    fn write(&self, path: &Path) {
        // The input must be used: its sum times 0 is added.
        let expand = [
            node("ReduceMax", &["pictures"], &["largest"]),
            node("Mul", &["largest", "zero"], &["nothing"]),
            node("Add", &["nothing", "number"], &["filled"]),
            node("Expand", &["filled", "shape"], &["boxes"]),
        ];
        let mut expand = expand.to_vec();
        expand[0].attribute = vec![AttributeProto::int("keepdims", 0)];
        // Lengths that the file leaves open, so that only running the model reveals them.
        let rank: Vec<Dimension> = (0..self.shape.len())
            .map(|at| open(&format!("length{at}")))
            .collect();
        let graph = GraphProto {
            name: "constant".into(),
            node: expand,
            initializer: vec![
                TensorProto::floats("zero", &[1], &[0.0]),
                TensorProto::floats("number", &[1], &[self.number]),
                TensorProto::integers("shape", self.shape),
            ],
            input: vec![ValueInfoProto::floats("pictures", &self.input)],
            output: vec![ValueInfoProto::floats("boxes", &rank)],
        };
        let model = ModelProto {
            ir_version: 8,
            graph: Some(graph),
            opset_import: vec![OperatorSetIdProto {
                domain: String::new(),
                version: 17,
            }],
            metadata_props: self
                .profile
                .iter()
                .map(|profile| StringStringEntryProto {
                    key: "dtd_profile".into(),
                    value: (*profile).into(),
                })
                .collect(),
            ..ModelProto::default()
        };
        fs::write(path, model.encode_to_vec()).unwrap();
    }

    fn detect(&self) -> Output {
        let folder = tempfile::tempdir().unwrap();
        let model = folder.path().join("model.onnx");
        self.write(&model);
        dtd()
            .args(["detect", text(&corpus(folder.path())), "--json"])
            .args(["--model", text(&model)])
            .output()
            .unwrap()
    }
}

#[test]
fn empty_answers_of_every_layout_are_no_detections() {
    for (shape, profile) in [
        (&[1, 0, 6][..], None),
        (&[0, 7], None),
        (&[1, 84, 0], Some(r#"{"layout": "columns"}"#)),
        (&[1, 0, 85], Some(r#"{"layout": "anchor-rows"}"#)),
        (&[1, 0, 6], Some(r#"{"layout": "corners"}"#)),
    ] {
        let output = Constant {
            input: windows_of(64),
            shape,
            number: 0.0,
            profile,
        }
        .detect();
        assert_eq!(
            output.status.code(),
            Some(0),
            "{shape:?}: {}",
            said(&output)
        );
        let outcome: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(outcome["counts"]["detections"], 0, "{shape:?}");
    }
}

#[test]
fn a_hundred_thousand_boxes_end() {
    let output = Constant {
        input: windows_of(64),
        shape: &[1, 100_000, 6],
        // Overlapping boxes of 30 px, all with full score.
        number: 30.0,
        profile: None,
    }
    .detect();
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
}

#[test]
fn what_no_detector_takes_or_answers_is_bad_input_that_names_it() {
    let usual = || Constant {
        input: windows_of(64),
        shape: &[1, 10, 6],
        number: 0.0,
        profile: None,
    };
    let fixed_batch = |batch| {
        let mut input = windows_of(64);
        input[0] = Dimension::Fixed(batch);
        input
    };
    let open_size = || {
        let mut input = windows_of(64);
        input[2] = open("side");
        input[3] = open("side");
        input
    };
    let cases = [
        (
            Constant {
                input: windows_of(20_000),
                ..usual()
            },
            "windows of 20000 px, expected 32 to 4096",
        ),
        (
            Constant {
                input: fixed_batch(1_000_000_000),
                ..usual()
            },
            "takes 1000000000 windows",
        ),
        (
            Constant {
                input: open_size(),
                profile: Some(r#"{"input": {"size_px": 0}}"#),
                ..usual()
            },
            "input.size_px = 0",
        ),
        (
            Constant {
                input: open_size(),
                profile: Some(r#"{"input": {"size_px": 20000}}"#),
                ..usual()
            },
            "input.size_px = 20000",
        ),
        (
            Constant {
                profile: Some(r#"{"input": {"scale": 0.0}}"#),
                ..usual()
            },
            "input.scale",
        ),
        (
            Constant {
                number: f32::NAN,
                ..usual()
            },
            "output \"boxes\" is NaN at [0, 0, 0] of [1, 10, 6]",
        ),
        (
            Constant {
                shape: &[1, 10],
                ..usual()
            },
            "output \"boxes\" has the shape [1, 10]",
        ),
        (
            Constant {
                shape: &[0, 10, 6],
                ..usual()
            },
            "has the shape [0, 10, 6]",
        ),
    ];
    for (model, expected) in cases {
        let output = model.detect();
        let said = said(&output);
        assert_eq!(output.status.code(), Some(2), "{expected}: {said}");
        assert!(
            said.contains(expected) && said.contains("model.onnx"),
            "{said}"
        );
    }
}

#[test]
fn a_file_that_is_no_model_is_bad_input() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("broken.onnx");
    fs::write(&model, "this is no model").unwrap();
    let output = dtd()
        .args(["detect", text(sound()), "--model", text(&model)])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    assert!(said(&output).contains("broken.onnx"), "{}", said(&output));
}

/// A shared library that leaves a trace when it is loaded.
fn planted(folder: &Path, trace: &Path) -> Option<PathBuf> {
    let source = folder.join("planted.c");
    let code = format!(
        "#include <stdio.h>\n__attribute__((constructor)) static void run(void) {{ fclose(fopen({:?}, \"w\")); }}\n",
        text(trace)
    );
    fs::write(&source, code).unwrap();
    let library = folder.join("planted.so");
    let compiled = Command::new("cc")
        .args(["-shared", "-fPIC", "-o", text(&library), text(&source)])
        .status();
    if !compiled.is_ok_and(|status| status.success()) {
        skipped("there is no C compiler to make a library with");
        return None;
    }
    Some(library)
}

#[test]
fn a_library_that_lies_above_the_working_folder_is_not_loaded() {
    let folder = tempfile::tempdir().unwrap();
    let trace = folder.path().join("it_ran");
    let Some(library) = planted(folder.path(), &trace) else {
        return;
    };
    let capi = folder
        .path()
        .join(".venv/lib/python3.11/site-packages/onnxruntime/capi");
    fs::create_dir_all(&capi).unwrap();
    fs::copy(&library, capi.join("libonnxruntime.so.1.31.1")).unwrap();
    let deep = folder.path().join("some/where");
    fs::create_dir_all(&deep).unwrap();
    fs::copy(&library, deep.join("libonnxruntime.so")).unwrap();
    let detect = |library: Option<&Path>, variable: Option<&str>| {
        let mut command = dtd();
        command
            .args(["detect", text(&corpus(folder.path())), "--again"])
            .args(["--model", text(&repository().join("models/aircraft.onnx"))])
            .current_dir(&deep);
        if let Some(library) = library {
            command.args(["--onnx-runtime", text(library)]);
        }
        if let Some(variable) = variable {
            command.env("ORT_DYLIB_PATH", variable);
        }
        command.output().unwrap()
    };
    let output = detect(None, None);
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    // Neither by a name that is searched for, nor by a path relative to the working folder.
    for relative in ["libonnxruntime.so", "./libonnxruntime.so"] {
        for output in [
            detect(None, Some(relative)),
            detect(Some(Path::new(relative)), None),
        ] {
            assert_eq!(output.status.code(), Some(2), "{}", said(&output));
            assert!(said(&output).contains("absolute"), "{}", said(&output));
        }
    }
    assert!(!trace.exists(), "the planted library ran");
    // The trace would show it: an explicitly named library is loaded.
    let output = detect(Some(&library), None);
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    assert!(trace.exists(), "{}", said(&output));
}
