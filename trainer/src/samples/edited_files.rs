//! Files that training and evaluation reject because they do not match the seal or their source. Both read samples through
//! [`Samples::read`].

use std::fs;
use std::os::unix::fs::symlink;

use dataset::corpus::detections::record_path;
use dataset::corpus::seal::seal_folder;
use dataset::tables::columns::TableWriter;

use super::*;
use testkit::synthetic::{MODEL_HASH, SyntheticCorpus};

const ALL: DistanceRange = DistanceRange {
    min_nm: 0.0,
    max_nm: None,
};

/// Error message for a tiny corpus after an edit of its first scenario; the second is a source for copies.
fn said_after(edit: impl FnOnce(&ScenarioFolder, &ScenarioFolder)) -> String {
    let folder = tempfile::tempdir().unwrap();
    let corpus = SyntheticCorpus::tiny().write(folder.path()).unwrap();
    assert!(Samples::read(&corpus, None, ALL).is_ok());
    let scenarios = corpus.scenarios().unwrap();
    edit(&scenarios[0], &scenarios[1]);
    match Samples::read(&corpus, None, ALL) {
        Ok(_) => panic!("the edited corpus was read"),
        Err(error) => error.to_string(),
    }
}

#[test]
fn halved_distances_are_refused() {
    let message = said_after(|folder, _| {
        let mut frames = folder.open().unwrap().frames().unwrap();
        for row in &mut frames.rows {
            row.labels.as_mut().unwrap().dtd_m /= 2.0;
        }
        frames.write(&folder.frames_path()).unwrap();
    });
    assert!(
        message.contains("0000/frames.parquet: does not match its seal"),
        "{message}"
    );
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
        let message = said_after(|folder, _| {
            let planned = serde_json::json!({"id": id, "config_hash": config_hash});
            let plan = serde_json::json!({"plan_version": 2, "scenarios": [planned]});
            let path = folder.root().join("../../plan.json");
            dataset::files::json_file::write_json(&path, &plan).unwrap();
        });
        assert!(
            message.contains("plan.json") && message.contains(words),
            "{message}"
        );
    }
}

#[test]
fn a_copy_of_a_scenario_under_another_name_is_refused() {
    let message = said_after(|folder, other| {
        fs::remove_dir_all(other.root()).unwrap();
        fs::create_dir(other.root()).unwrap();
        for entry in fs::read_dir(folder.root()).unwrap().flatten() {
            if entry.path().is_file() {
                fs::copy(entry.path(), other.root().join(entry.file_name())).unwrap();
            }
        }
    });
    assert!(
        message.contains("has the id \"0000\", expected \"0001\""),
        "{message}"
    );
}

#[test]
fn the_table_of_another_scenario_is_refused() {
    let message = said_after(|folder, other| {
        fs::copy(other.frames_path(), folder.frames_path()).unwrap();
    });
    assert!(
        message.contains("0000/frames.parquet: does not match its seal"),
        "{message}"
    );
}

#[test]
fn an_edited_calibration_is_refused() {
    let message = said_after(|folder, _| {
        let path = folder.calibration_path();
        let text = fs::read_to_string(&path).unwrap();
        fs::write(path, text.replacen("1920", "1921", 1)).unwrap();
    });
    assert!(
        message.contains("calibration.json: does not match its seal"),
        "{message}"
    );
}

#[test]
fn detections_of_a_scenario_that_was_recorded_again_are_refused() {
    let message = said_after(|folder, _| {
        fs::create_dir(folder.root().join("views")).unwrap();
        fs::write(folder.root().join("views/left.mp4"), "another video").unwrap();
        seal_folder(folder.root(), "synthetic").unwrap();
    });
    assert!(
        message.contains("made from other videos") && message.contains("run `dtd detect`"),
        "{message}"
    );
}

#[test]
fn detections_of_another_scenario_are_refused() {
    let message = said_after(|folder, other| {
        let path = |folder: &ScenarioFolder| folder.detections_path(MODEL_HASH);
        fs::copy(path(other), path(folder)).unwrap();
    });
    assert!(
        message.contains("is not what its record says: its hash differs"),
        "{message}"
    );
}

#[test]
fn detections_that_do_not_say_what_they_were_made_from_are_refused() {
    let message = said_after(|folder, _| {
        let path = dataset::corpus::detections::record_path(folder, MODEL_HASH);
        fs::write(path, r#"{"model": "aircraft.onnx"}"#).unwrap();
    });
    assert!(
        message.contains("does not say what its table was made from")
            && message.contains("run `dtd detect`"),
        "{message}"
    );
}

#[test]
fn a_box_that_is_no_number_is_an_error_with_its_row_and_column() {
    let message = said_after(|folder, _| {
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
        let record = dataset::corpus::detections::record_path(folder, MODEL_HASH);
        let mut provenance = dataset::corpus::detections::provenance(folder, MODEL_HASH)
            .unwrap()
            .unwrap();
        provenance.table_blake3 = dataset::corpus::seal::hash_file(&path).unwrap();
        dataset::files::json_file::write_json(&record, &provenance).unwrap();
    });
    assert!(
        message.contains(&format!("{MODEL_HASH}.parquet row 3: width_px")),
        "{message}"
    );
}

#[test]
fn links_out_of_the_corpus_are_refused() {
    let table = format!("detections/{MODEL_HASH}.parquet");
    for name in ["frames.parquet", &table, "detections"] {
        let outside = tempfile::tempdir().unwrap();
        let target = outside.path().join("target");
        let message = said_after(|folder, _| {
            let path = folder.root().join(name);
            fs::rename(&path, &target).unwrap();
            symlink(&target, &path).unwrap();
        });
        assert!(message.contains("is a symbolic link"), "{name}: {message}");
    }
}

#[test]
fn views_registered_with_different_cameras_are_refused_with_a_remedy() {
    let register = |folder: &ScenarioFolder, with: serde_json::Value| {
        let path = record_path(folder, MODEL_HASH);
        let text = fs::read_to_string(&path).unwrap();
        let mut record: serde_json::Value = serde_json::from_str(&text).unwrap();
        record["registration"] = with;
        dataset::files::json_file::write_json(&path, &record).unwrap();
    };
    let run = serde_json::json!({"cameras_of_run": "ab".repeat(32)});
    let message = said_after(|folder, other| {
        register(folder, run.clone());
        register(other, serde_json::json!({}));
    });
    let expected = "registered with the cameras of calibration.json, the views of scenario 0000 with the cameras of run abababababab";
    assert!(
        message.contains(expected) && message.contains("--registration-of RUN"),
        "{message}"
    );

    let folder = tempfile::tempdir().unwrap();
    let corpus = SyntheticCorpus::tiny().write(folder.path()).unwrap();
    for scenario in corpus.scenarios().unwrap() {
        register(&scenario, run.clone());
    }
    let samples = Samples::read(&corpus, None, ALL).unwrap();
    let expected = RegisteredWith::Run("ab".repeat(32));
    assert_eq!(samples.registered_with(), Some(&expected));
}
