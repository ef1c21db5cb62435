//! `dtd export` from outside: pycocotools reads what it writes for COCO and gets the average precision of `dtd evaluate-detector`, the
//! label files of YOLO hold the true boxes, and nothing half-made appears under the final name.

mod tiny;

use std::collections::BTreeMap;
use std::fs;
use std::process::Command;

use dataset::corpus::Corpus;
use dataset::splits::Side;
use serde_json::Value;
use testkit::command::said;
use testkit::files::contents;
use testkit::{program_of_venv, repository};
use tiny::{MODEL, Tiny};

fn json_of(tiny: &Tiny, arguments: &[&str]) -> Value {
    let output = tiny.dtd(arguments).output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", said(&output));
    testkit::command::json(&output)
}

fn refused(tiny: &Tiny, arguments: &[&str], words: &str) {
    let before = tiny.files();
    let output = tiny.dtd(arguments).output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    assert!(said(&output).contains(words), "{}", said(&output));
    assert_eq!(tiny.files(), before, "{arguments:?} wrote something");
}

#[test]
fn pycocotools_gets_the_average_precision_of_evaluate_detector_from_a_coco_export() {
    let tiny = Tiny::made().copy();
    let searched = [
        "detect", "corpus", "--model", MODEL, "--mode", "full", "--json",
    ];
    let hash = json_of(&tiny, &searched)["model_hash"]
        .as_str()
        .unwrap()
        .to_owned();
    let export = [
        "export",
        "corpus",
        "--to",
        "coco",
        "--out",
        "coco",
        "--detections",
        &hash,
    ];
    let counts = json_of(&tiny, &[&export[..], &["--json"]].concat());
    let written: Value =
        serde_json::from_slice(&fs::read(tiny.path("coco/annotations.json")).unwrap()).unwrap();
    let images = written["images"].as_array().unwrap();
    assert_eq!(counts["pictures"], images.len());
    assert_eq!(
        counts["boxes"],
        written["annotations"].as_array().unwrap().len()
    );
    assert_eq!(counts["left_out"], 0);
    for image in images {
        let file = tiny
            .path("coco/images")
            .join(image["file_name"].as_str().unwrap());
        assert!(file.is_file(), "{}", file.display());
        assert!(image["calibration"]["k"][0][0].is_number(), "{image}");
    }

    let judged = Command::new(program_of_venv("python"))
        .arg(repository().join("tests/judges/coco_ap.py"))
        .args(["annotations.json", "detections.json"].map(|name| tiny.path("coco").join(name)))
        .output()
        .unwrap();
    assert!(judged.status.success(), "{}", said(&judged));
    let theirs = testkit::command::json(&judged);
    let evaluate = [
        "evaluate-detector",
        "corpus",
        "--out",
        "judged",
        "--model",
        MODEL,
    ];
    let ours = json_of(
        &tiny,
        &[&evaluate[..], &["--mode", "full", "--json"]].concat(),
    );
    let ours = &ours["modes"]["auto_segmentation"]["average_precision"];
    assert!(ours["ap50"].as_f64().unwrap() > 0.5, "{ours}");
    for name in ["ap", "ap50", "ap75"] {
        let (ours, theirs) = (ours[name].as_f64().unwrap(), theirs[name].as_f64().unwrap());
        assert!(
            (ours - theirs).abs() < 1e-9,
            "{name}: {ours}, pycocotools {theirs}"
        );
    }

    // The same again is there already, and whole; another selection does not replace it.
    let again = json_of(&tiny, &[&export[..], &["--json"]].concat());
    assert_eq!(
        (&again["unchanged"], &again["pictures"]),
        (&true.into(), &counts["pictures"])
    );
    refused(
        &tiny,
        &[&export[..], &["--every", "2"]].concat(),
        "other options",
    );
}

#[test]
fn label_files_of_yolo_hold_the_true_boxes_by_side_of_the_split() {
    let tiny = Tiny::made().copy();
    let export = [
        "export",
        "corpus",
        "--to",
        "yolo",
        "--out",
        "yolo",
        "--pictures",
        "jpeg",
    ];
    let counts = json_of(&tiny, &[&export[..], &["--json"]].concat());
    let corpus = Corpus::open(&tiny.corpus()).unwrap();
    let mut expected = BTreeMap::new();
    for folder in corpus.scenarios().unwrap() {
        let id = folder.id();
        let side = match corpus.splits().unwrap().scenarios[&id].side {
            Side::Train => "train",
            Side::Validation => "val",
            Side::Test => "test",
        };
        for real in folder.open().unwrap().truth_boxes().unwrap() {
            let stem = format!("{side}/{id}_{}_{:06}", real.view, real.tick);
            expected.insert(stem, real.pixel_box);
        }
    }
    let mut pictures = 0;
    for (path, text) in contents(&tiny.path("yolo/labels")) {
        pictures += 1;
        let stem = path.with_extension("").to_string_lossy().into_owned();
        let image = tiny.path("yolo/images").join(format!("{stem}.jpg"));
        assert!(image.is_file(), "{}", image.display());
        let text = String::from_utf8(text).unwrap();
        let Some(real) = expected.remove(&stem) else {
            assert_eq!(text, "");
            continue;
        };
        let numbers: Vec<f64> = text
            .split_whitespace()
            .map(|n| n.parse().unwrap())
            .collect();
        let found = [
            numbers[1] * 480.0,
            numbers[2] * 320.0,
            numbers[3] * 480.0,
            numbers[4] * 320.0,
        ];
        let real = [
            real.cx_px + 0.5,
            real.cy_px + 0.5,
            real.width_px,
            real.height_px,
        ];
        for (found, real) in found.iter().zip(real) {
            assert!((found - real).abs() < 1e-3, "{stem}: {text}");
        }
    }
    assert_eq!(expected, BTreeMap::new(), "boxes without a label");
    assert_eq!(counts["pictures"], pictures);
    let yaml = fs::read_to_string(tiny.path("yolo/data.yaml")).unwrap();
    for line in [
        "train: images/train",
        "val: images/val",
        "test: images/test",
        "  0: aircraft",
    ] {
        assert!(yaml.lines().any(|found| found == line), "{yaml}");
    }
}

#[test]
fn a_wrong_request_is_refused_and_writes_nothing() {
    let tiny = Tiny::made().copy();
    let export = |more: &[&'static str]| -> Vec<&'static str> {
        let common = ["export", "corpus", "--to", "coco", "--out", "out"];
        [&common[..], more].concat()
    };
    refused(
        &tiny,
        &["export", "corpus", "--to", "pascal", "--out", "out"],
        "possible values",
    );
    refused(&tiny, &export(&["--only", "nowhere"]), "nowhere");
    refused(&tiny, &export(&["--views", "top"]), "top");
    refused(
        &tiny,
        &export(&["--detections", "other.onnx"]),
        "aircraft.onnx",
    );
    std::os::unix::fs::symlink("corpus", tiny.path("link")).unwrap();
    for out in [
        "corpus",
        ".",
        "corpus/export",
        "corpus/scenarios/1200-clear-r1/export",
        "link/export",
    ] {
        let into = ["export", "corpus", "--to", "coco", "--out", out];
        refused(&tiny, &into, "choose a folder elsewhere");
    }
    fs::rename(tiny.corpus(), tiny.path("out.partial")).unwrap();
    refused(
        &tiny,
        &["export", "out.partial", "--to", "coco", "--out", "out"],
        "choose a folder elsewhere",
    );
    fs::rename(tiny.path("out.partial"), tiny.corpus()).unwrap();
    fs::create_dir(tiny.path("out")).unwrap();
    fs::write(tiny.path("out/thesis.txt"), "mine").unwrap();
    refused(&tiny, &export(&[]), "thesis.txt");
}

#[test]
fn a_damaged_video_is_named_and_no_export_appears() {
    let tiny = Tiny::made().copy();
    let video = tiny.scenarios()[1].join("views/left.mp4");
    let mut bytes = fs::read(&video).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x55;
    fs::write(&video, bytes).unwrap();
    let output = tiny
        .dtd(&["export", "corpus", "--to", "coco", "--out", "out"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    assert!(said(&output).contains("left.mp4"), "{}", said(&output));
    assert!(!tiny.path("out").exists());
}
