//! `dtd export` from outside: pycocotools reads what it writes for COCO and gets the average precision of `dtd evaluate-detector`, the
//! label files of YOLO hold the true boxes, and nothing half-made appears under the final name.

mod tiny;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

use dataset::corpus::Corpus;
use dataset::detections::models_of;
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

/// What another program says of a file or folder.
fn judged(judge: &str, path: &Path) -> Value {
    let output = Command::new(program_of_venv("python"))
        .arg(repository().join("tests/judges").join(judge))
        .arg(path)
        .output()
        .unwrap();
    assert!(output.status.success(), "{judge}: {}", said(&output));
    testkit::command::json(&output)
}

/// Rows of a table over all splits.
fn rows_of<'a>(tables: &'a Value, table: &str) -> Vec<&'a Value> {
    let splits = tables[table].as_object().unwrap().values();
    let rows = |split: &'a Value| split["rows"].as_array().unwrap();
    splits.flat_map(rows).collect()
}

#[test]
fn datasets_loads_every_table_of_a_huggingface_export_and_its_videos_are_those_of_the_corpus() {
    let tiny = Tiny::made().copy();
    let export = [
        "export",
        "corpus",
        "--to",
        "huggingface",
        "--out",
        "hf",
        "--run",
        "run",
        "--license",
        "CC-BY-4.0",
    ];
    let counts = json_of(&tiny, &[&export[..], &["--json"]].concat());
    let loaded = judged("huggingface.py", &tiny.path("hf"));
    let tables = &loaded["tables"];
    let corpus = Corpus::open(&tiny.corpus()).unwrap();
    let splits = corpus.splits().unwrap();
    let (mut boxes, mut detections) = (Vec::new(), 0);
    for folder in corpus.scenarios().unwrap() {
        let id = folder.id();
        let split = match splits.scenarios[&id].side {
            Side::Train => "train",
            Side::Validation => "validation",
            Side::Test => "test",
        };
        let mine = |table: &str| -> Vec<&Value> {
            let rows = tables[table][split]["rows"].as_array().unwrap().iter();
            rows.filter(|row| row["scenario"] == id.as_str()).collect()
        };
        let opened = folder.open().unwrap();
        let frames = opened.frames().unwrap();
        let ticks = mine("ticks");
        assert_eq!(ticks.len(), frames.rows.len());
        for (found, row) in ticks.iter().zip(&frames.rows) {
            assert_eq!(found["tick"], row.tick);
            assert_eq!(found["time_ns"], row.time_ns);
            assert_eq!(found["latitude_deg"], row.pose.latitude_deg);
            assert_eq!(found["dtd_m"], row.labels.unwrap().dtd_m);
        }
        let calibration = opened.calibration().unwrap();
        for view in mine("views") {
            let name = view["view"].as_str().unwrap();
            let camera = &calibration.cameras[name];
            assert_eq!(view["focal_px"], camera.k[0][0]);
            assert_eq!(view["r01"], camera.ecef_from_camera.rotation[0][1]);
            assert_eq!(view["k1"], Value::Null);
            let video = view["video"].as_str().unwrap();
            assert_eq!(loaded["videos"][video], frames.rows.len());
            assert_eq!(
                fs::read(tiny.path("hf").join(video)).unwrap(),
                fs::read(folder.video_path(name)).unwrap()
            );
        }
        boxes.extend(opened.truth_boxes().unwrap().into_iter().map(|real| {
            let pixel_box = real.pixel_box;
            (id.clone(), real.view, real.tick, pixel_box.cx_px)
        }));
        for model in models_of(&folder).unwrap() {
            detections += opened.detections(&model).unwrap().boxes.len();
        }
    }
    let found: Vec<_> = rows_of(tables, "boxes")
        .into_iter()
        .map(|row| {
            let text = |name: &str| row[name].as_str().unwrap().to_owned();
            let tick = row["tick"].as_u64().unwrap() as u32;
            let cx_px = row["cx_px"].as_f64().unwrap();
            (text("scenario"), text("view"), tick, cx_px)
        })
        .collect();
    let sorted = |mut all: Vec<(String, String, u32, f64)>| {
        all.sort_by(|a, b| a.partial_cmp(b).unwrap());
        all
    };
    assert_eq!(counts["boxes"], found.len());
    assert_eq!(sorted(found), sorted(boxes));
    assert!(detections > 0);
    assert_eq!(rows_of(tables, "detections").len(), detections);
    assert_eq!(rows_of(tables, "scenarios").len(), tiny::SCENARIOS);
    let predictions = rows_of(tables, "predictions");
    assert!(
        predictions
            .iter()
            .any(|row| row["predicted_dtd_m"].is_f64())
    );
    assert!(predictions.iter().all(|row| row["run"] == "run"));

    // What the card and `croissant.json` say of the columns is what the tables have.
    let described = judged("croissant.py", &tiny.path("hf"));
    let card = fs::read_to_string(tiny.path("hf/README.md")).unwrap();
    assert!(card.contains("license: \"cc-by-4.0\""), "{card}");
    for (name, table) in tables.as_object().unwrap() {
        let rows = described["records"][name].as_array().unwrap();
        assert_eq!(rows.len(), rows_of(tables, name).len(), "{name}");
        for split in table.as_object().unwrap().values() {
            for column in split["columns"].as_array().unwrap() {
                let column = column.as_str().unwrap();
                assert!(rows[0].get(column).is_some(), "{name}: {column}");
                assert!(card.contains(&format!("| `{column}` |")), "{column}");
            }
        }
        let columns = rows[0].as_object().unwrap().len();
        assert!(
            table
                .as_object()
                .unwrap()
                .values()
                .all(|split| { split["columns"].as_array().unwrap().len() == columns })
        );
    }
    assert!(
        json_of(&tiny, &[&export[..], &["--json"]].concat())["unchanged"]
            .as_bool()
            .unwrap()
    );
    refused(&tiny, &export[..8], "other options");
}

#[test]
fn croissant_json_of_pictures_and_boxes_is_valid_and_gives_their_records() {
    let tiny = Tiny::made().copy();
    for (format, set, pictures) in [
        ("coco", "images", "pictures"),
        ("yolo", "pictures", "images"),
    ] {
        let export = [
            "export", "corpus", "--to", format, "--out", format, "--every", "2",
        ];
        let counts = json_of(&tiny, &[&export[..], &["--json"]].concat());
        let described = judged("croissant.py", &tiny.path(format));
        let records = described["records"][set].as_array().unwrap();
        assert_eq!(counts["pictures"], records.len());
        assert_eq!(counts["pictures"], described["files"][pictures]);
        if format == "coco" {
            let annotations = described["records"]["annotations"].as_array().unwrap();
            assert_eq!(counts["boxes"], annotations.len());
            assert!(records[0]["scenario"].as_str().unwrap().starts_with("1200"));
        } else {
            assert!(records.iter().any(|record| record["split"] == "val"));
            assert!(
                records
                    .iter()
                    .any(|r| r["boxes"].as_str().unwrap().starts_with("0 0."))
            );
        }
        assert_eq!(described["records"]["splits"].as_array().unwrap().len(), 3);
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
    let tables = ["export", "corpus", "--to", "huggingface", "--out", "out"];
    for (option, value, words) in [
        ("--pictures", "jpeg", "no use for --pictures"),
        ("--run", "corpus", "no predictions"),
        ("--license", "free for all", "SPDX"),
    ] {
        refused(&tiny, &[&tables[..], &[option, value]].concat(), words);
    }
    refused(&tiny, &export(&["--run", "run"]), "no use for --run");
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
