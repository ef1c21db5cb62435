//! A damaged seal: every verb that reads a whole corpus goes on with the other scenarios, names the damaged one, and says what to do.

use std::fs;

use super::tiny::{self, Tiny};
use super::{assert_says, dtd};

const DAMAGED: &str = "DONE.json: is empty, expected a seal";

/// A copy of the corpus where a training scenario's seal is empty, as after a power failure; and that scenario.
fn damaged() -> (Tiny, String) {
    let tiny = Tiny::made().copy();
    let splits = fs::read(tiny.path("corpus/splits.json")).unwrap();
    let splits: serde_json::Value = serde_json::from_slice(&splits).unwrap();
    let sides = splits["scenarios"].as_object().unwrap();
    let (id, _) = sides.iter().find(|(_, on)| on["side"] == "train").unwrap();
    fs::write(tiny.path(&format!("corpus/scenarios/{id}/DONE.json")), "").unwrap();
    (tiny, id.clone())
}

#[test]
fn a_damaged_scenario_is_left_out_and_named_with_the_way_to_replace_it() {
    let (tiny, id) = damaged();
    let folder = format!("corpus/scenarios/{id}");
    for verb in [
        &testkit::command::words("train corpus --out new --config training.toml")[..],
        &["evaluate", "run", "--corpus", "corpus", "--out", "judged"],
        &testkit::command::words("predict run --corpus corpus --out new.parquet"),
        &["export", "corpus", "--to", "coco", "--out", "coco"],
    ] {
        let words = [
            id.as_str(),
            DAMAGED,
            "is damaged or may not be read, and is left out",
            "move its folder out of corpus/scenarios",
        ];
        assert_says(&tiny, verb, 3, &words);
    }
    assert!(tiny.path("new/run.json").is_file() && tiny.path("judged/report.html").is_file());
    assert!(tiny.path("new.parquet").is_file() && tiny.path("coco/annotations.json").is_file());
    let store = format!("file://{}", tiny.path("store").display());
    for verb in [&["label", "corpus"][..], &["push", "corpus", &store]] {
        assert_says(&tiny, verb, 3, &[&id, DAMAGED]);
    }
    let generate = ["generate", "sweep.toml", "--out", "corpus"];
    assert_says(
        &tiny,
        &generate,
        3,
        &[
            &folder,
            DAMAGED,
            "4 complete already, 1 failed",
            "move it away first",
        ],
    );
    for name in ["MANIFEST.b3", "frames.parquet"] {
        let tiny = Tiny::made().copy();
        fs::write(tiny.path(&folder).join(name), "").unwrap();
        let words = [name, "4 complete already, 1 failed", "move it away first"];
        assert_says(&tiny, &generate, 3, &words);
    }
    fs::rename(tiny.path(&folder), tiny.path("elsewhere")).unwrap();
    let generated = dtd(&tiny, &generate);
    assert!(generated.status.success(), "{generated:?}");
}

#[test]
fn a_scenario_that_lost_its_seal_or_its_detections_is_never_left_out_silently() {
    let (tiny, id) = damaged();
    let folder = tiny.path(&format!("corpus/scenarios/{id}"));
    fs::remove_file(folder.join("DONE.json")).unwrap();
    let predict = testkit::command::words("predict run --corpus corpus --out new.parquet");
    for verb in [
        &["label", "corpus"][..],
        &["detect", "corpus", "--model", tiny::MODEL],
        &predict,
        &["export", "corpus", "--to", "coco", "--out", "coco"],
    ] {
        let words = [id.as_str(), "has no DONE.json", "out of corpus/scenarios"];
        assert_says(&tiny, verb, 3, &words);
    }

    let tiny = Tiny::made().copy();
    let folder = tiny.path(&format!("corpus/scenarios/{id}"));
    for found in ["detections", "registrations", "health", "backgrounds"] {
        fs::remove_dir_all(folder.join(found)).unwrap();
    }
    for verb in [
        &testkit::command::words("train corpus --out new --config training.toml")[..],
        &["evaluate", "run", "--corpus", "corpus", "--out", "judged"],
        &predict,
    ] {
        let words = ["1 scenario is not searched by", id.as_str(), "`dtd detect`"];
        assert_says(&tiny, verb, 3, &words);
    }
    let yolo = testkit::command::words("export corpus --to yolo --boxes detections --out yolo");
    assert_says(&tiny, &yolo, 3, &[&id, "is left out", "`dtd detect`"]);
    for side in fs::read_dir(tiny.path("yolo/labels")).unwrap() {
        for labels in fs::read_dir(side.unwrap().path()).unwrap() {
            let name = labels.unwrap().file_name();
            assert!(!name.to_string_lossy().contains(&id), "{name:?}");
        }
    }
}

#[test]
fn a_truncated_video_costs_an_export_its_scenario_only() {
    let tiny = Tiny::made().copy();
    let folder = &tiny.scenarios()[1];
    let video = folder.join("views/left.mp4");
    let video = fs::File::options().write(true).open(video).unwrap();
    video.set_len(2_000).unwrap();
    let export = ["export", "corpus", "--to", "coco", "--out", "coco"];
    let words = ["left.mp4", "is left out", "4 scenarios"];
    assert_says(&tiny, &export, 3, &words);
}

#[test]
fn verify_names_each_missing_scenario() {
    let tiny = Tiny::made().copy();
    let folders = tiny.scenarios();
    for folder in &folders[..2] {
        fs::remove_dir_all(folder).unwrap();
    }
    let id = |at: usize| folders[at].file_name().unwrap().to_string_lossy();
    let words = format!("2 planned scenarios are missing: {}, {}", id(0), id(1));
    assert_says(&tiny, &["verify", "corpus", "--no-decode"], 0, &[&words]);
}

#[test]
fn a_run_with_a_damaged_seal_says_how_to_go_on() {
    let tiny = Tiny::made().copy();
    fs::write(tiny.path("run/DONE.json"), "").unwrap();
    let predict = testkit::command::words("predict run --corpus corpus --out new.parquet");
    let words = "run/DONE.json: is empty, expected a seal; put the right file back, or train again";
    assert_says(&tiny, &predict, 2, &[words]);
}
