//! Files that training and evaluation reject because they do not match the seal or their source. Both read samples through
//! [`Samples::read`].

use std::fs;
use std::os::unix::fs::symlink;

use dataset::corpus::detections::{provenance, record_path};
use dataset::corpus::seal::hash_file;
use dataset::files::json_file::write_json;
use dataset::tables::columns::TableWriter;

use super::*;

/// Edits the first scenario of a tiny corpus, and expects an error with these words; the second scenario is a source for copies.
fn refused(words: &[&str], edit: impl FnOnce(&ScenarioFolder, &ScenarioFolder)) {
    let folder = tempfile::tempdir().unwrap();
    let corpus = SyntheticCorpus::tiny().write(folder.path()).unwrap();
    assert!(Samples::read(&corpus, None).is_ok());
    let scenarios = corpus.scenarios().unwrap();
    edit(&scenarios[0], &scenarios[1]);
    let message = Samples::read(&corpus, None).unwrap_err().to_string();
    for word in words {
        assert!(message.contains(word), "{word}: {message}");
    }
}

#[test]
fn a_scenario_that_the_plan_does_not_have_or_has_otherwise_is_refused() {
    for (id, config_hash, words) in [
        (
            "0000",
            "another",
            "scenario 0000 with the config_hash another",
        ),
        ("0001", "synthetic", "has no scenario 0000"),
    ] {
        refused(&["plan.json", words], |folder, _| {
            let planned = serde_json::json!({"id": id, "config_hash": config_hash});
            let plan = serde_json::json!({"plan_version": 2, "scenarios": [planned]});
            let path = folder.root().join("../../plan.json");
            write_json(&path, &plan).unwrap();
        });
    }
}

/// The first of two scenarios is edited.
type Edit = fn(&ScenarioFolder, &ScenarioFolder);

#[test]
fn files_that_are_not_what_they_were_are_refused_by_name() {
    let cases: [(&[&str], Edit); 6] = [
        (
            &["0000/frames.parquet: does not match its seal"],
            |folder, other| {
                fs::copy(other.frames_path(), folder.frames_path()).unwrap();
            },
        ),
        (
            &["calibration.json: does not match its seal"],
            |folder, _| {
                let path = folder.calibration_path();
                let text = fs::read_to_string(&path).unwrap();
                fs::write(path, text.replacen("1920", "1921", 1)).unwrap();
            },
        ),
        (
            &["has the id \"0000\", expected \"0001\""],
            |folder, other| {
                fs::remove_dir_all(other.root()).unwrap();
                fs::create_dir(other.root()).unwrap();
                for entry in fs::read_dir(folder.root()).unwrap().flatten() {
                    if entry.path().is_file() {
                        fs::copy(entry.path(), other.root().join(entry.file_name())).unwrap();
                    }
                }
            },
        ),
        (
            &["made from other videos", "run `dtd detect`"],
            |folder, _| {
                fs::create_dir(folder.root().join("views")).unwrap();
                fs::write(folder.root().join("views/left.mp4"), "another video").unwrap();
                seal_folder(folder.root(), "synthetic").unwrap();
            },
        ),
        (
            &["is not what its record says: its hash differs"],
            |folder, other| {
                let path = |folder: &ScenarioFolder| folder.detections_path(MODEL_HASH);
                fs::copy(path(other), path(folder)).unwrap();
            },
        ),
        (
            &[
                "does not say what its table was made from",
                "run `dtd detect`",
            ],
            |folder, _| {
                let record = r#"{"model": "aircraft.onnx"}"#;
                fs::write(record_path(folder, MODEL_HASH), record).unwrap();
            },
        ),
    ];
    for (words, edit) in cases {
        refused(words, edit);
    }
}

#[test]
fn a_box_that_is_no_number_is_an_error_with_its_row_and_column() {
    refused(
        &[&format!("{MODEL_HASH}.parquet row 3: width_px")],
        |folder, _| {
            let scenario = folder.open().unwrap();
            let mut found = scenario.detections(MODEL_HASH).unwrap().boxes;
            found[3].pixel_box.width_px = f64::NAN;
            let path = folder.detections_path(MODEL_HASH);
            // Our own writer rejects such a number.
            TableWriter::new()
                .u32("tick", found.iter().map(|d| d.tick))
                .text("view", found.iter().map(|d| &d.view))
                .f64("cx_px", found.iter().map(|d| d.pixel_box.cx_px))
                .f64("cy_px", found.iter().map(|d| d.pixel_box.cy_px))
                .f64("width_px", found.iter().map(|d| d.pixel_box.width_px))
                .f64("height_px", found.iter().map(|d| d.pixel_box.height_px))
                .f64("score", found.iter().map(|d| d.score))
                .u32("tile", found.iter().map(|d| d.tile))
                .write(&path)
                .unwrap();
            let record = record_path(folder, MODEL_HASH);
            let mut made = provenance(folder, MODEL_HASH).unwrap().unwrap();
            made.table_blake3 = hash_file(&path).unwrap();
            write_json(&record, &made).unwrap();
        },
    );
}

#[test]
fn links_out_of_the_corpus_are_refused() {
    let table = format!("detections/{MODEL_HASH}.parquet");
    for name in ["frames.parquet", &table, "detections"] {
        let outside = tempfile::tempdir().unwrap();
        let target = outside.path().join("target");
        refused(&["is a symbolic link"], |folder, _| {
            let path = folder.root().join(name);
            fs::rename(&path, &target).unwrap();
            symlink(&target, &path).unwrap();
        });
    }
}

#[test]
fn views_registered_with_different_cameras_are_refused_with_a_remedy() {
    let register = |folder: &ScenarioFolder, with: serde_json::Value| {
        let path = record_path(folder, MODEL_HASH);
        let text = fs::read_to_string(&path).unwrap();
        let mut record: serde_json::Value = serde_json::from_str(&text).unwrap();
        record["registration"] = with;
        write_json(&path, &record).unwrap();
    };
    let run = serde_json::json!({"cameras_of_run": "ab".repeat(32)});
    refused(
        &[
            "registered with the cameras of calibration.json, the views of scenario 0000 with the cameras of run abababababab",
            "--registration-of RUN",
        ],
        |folder, other| {
            register(folder, run.clone());
            register(other, serde_json::json!({}));
        },
    );

    let folder = tempfile::tempdir().unwrap();
    let corpus = SyntheticCorpus::tiny().write(folder.path()).unwrap();
    for scenario in corpus.scenarios().unwrap() {
        register(&scenario, run.clone());
    }
    let samples = Samples::read(&corpus, None).unwrap();
    let expected = RegisteredWith::Run("ab".repeat(32));
    assert_eq!(samples.registered_with(), Some(&expected));
}
