//! `dtd export` from outside: pycocotools reads the COCO files and computes the average precision of `dtd evaluate-detector`, YOLO's label
//! files hold the ground-truth boxes, and the final name never appears before the export is complete.

#[path = "export/crops.rs"]
mod crops;
mod tiny;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use dataset::corpus::Corpus;
use dataset::corpus::detections::models_of;
use dataset::corpus::splits::{Assignment, Side, Splits};
use dataset::work::watch::Silent;
use serde_json::Value;
use testkit::command::{Dtd, Ending, json, said, words};
use testkit::files::{contents, copy_folder};
use testkit::judged;
use testkit::short_corpus;
use testkit::sweep::THREE_VIEWS;
use tiny::Tiny;

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

/// Result of a verb that must succeed.
fn json_of(tiny: &Tiny, line: &str) -> Value {
    json(&tiny.line(&format!("{line} --json")).succeeds())
}

/// Bad input, explained with these words; nothing is written.
fn refused(tiny: &Tiny, line: &str, words: &str) {
    let before = tiny.files();
    tiny.line(line).ends_with(2, &[words]);
    assert_eq!(tiny.files(), before, "{line} wrote something");
}

/// `dtd` within a folder, with the words of a line.
fn command_in(folder: &Path, line: &str) -> Command {
    let mut command = DTD.command(&words(line));
    command.current_dir(folder);
    command
}

fn run_in(folder: &Path, line: &str) -> Output {
    command_in(folder, line).succeeds()
}

#[test]
fn pycocotools_gets_the_average_precision_of_evaluate_detector_from_a_coco_export() {
    let tiny = Tiny::made().copy();
    let searched = json_of(&tiny, "detect corpus --model {model} --mode full");
    let hash = searched["model_hash"].as_str().unwrap();
    let export = format!("export corpus --to coco --out coco --detections {hash}");
    let counts = json_of(&tiny, &export);
    let written: Value =
        serde_json::from_slice(&fs::read(tiny.path("coco/annotations.json")).unwrap()).unwrap();
    assert_eq!(written["licenses"], serde_json::json!([]));
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

    let files = ["annotations.json", "detections.json"].map(|name| tiny.path("coco").join(name));
    let theirs = judged("coco_ap.py", &files);
    let ours = json_of(
        &tiny,
        "evaluate-detector corpus --out judged --model {model} --mode full",
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

    // A repeated export exists already and is whole; a different selection does not replace it.
    let mut again = json_of(&tiny, &export);
    assert_eq!(again["unchanged"].take(), Value::Bool(true));
    again["unchanged"] = counts["unchanged"].clone();
    assert_eq!(again, counts);
    refused(&tiny, &format!("{export} --every 2"), "other options");
    fs::write(tiny.path("coco/annotations.json"), "").unwrap();
    refused(&tiny, &export, "annotations.json");
}

#[test]
fn label_files_of_yolo_hold_the_true_boxes_by_side_of_the_split() {
    let tiny = Tiny::made().copy();
    let counts = json_of(&tiny, "export corpus --to yolo --out yolo --pictures jpeg");
    let corpus = Corpus::open(&tiny.corpus()).unwrap();
    let mut expected = BTreeMap::new();
    for folder in corpus.scenarios().unwrap() {
        let id = folder.id();
        let side = match corpus.splits().unwrap().scenarios[&id].side {
            Side::Validation => "val".to_owned(),
            side => split_of(side),
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
    let checked = judged("yolo_labels.py", &[&tiny.path("yolo")]);
    let sides = checked["sides"].as_object().unwrap().values();
    let sum = |names: &[&str]| -> u64 {
        let of_side = |side: &Value| {
            names
                .iter()
                .map(|name| side[name].as_u64().unwrap())
                .sum::<u64>()
        };
        sides.clone().map(of_side).sum()
    };
    assert_eq!(counts["pictures"], sum(&["labelled", "empty"]));
    assert_eq!(counts["boxes"], sum(&["boxes"]));
    let classes = fs::read_to_string(tiny.path("yolo/classes.txt")).unwrap();
    assert_eq!(classes, "aircraft\n");
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

/// A corpus whose five scenarios are on these sides, without videos that matter.
fn on_sides(folder: &Path, sides: &[Side]) -> Corpus {
    let ids: Vec<String> = (0..sides.len()).map(|n| format!("{n:04}-a")).collect();
    let names: Vec<&str> = ids.iter().map(String::as_str).collect();
    let paint = |_: &str, _: u32, rgb: &mut [u8]| rgb.fill(90);
    let corpus =
        short_corpus::write_with_videos(&folder.join("corpus"), &names, 64, 64, Some(&paint));
    let assigned = ids.iter().zip(sides).map(|(id, side)| {
        let assignment = Assignment {
            trajectory: id.clone(),
            side: *side,
        };
        (id.clone(), assignment)
    });
    let splits = Splits::new(assigned.collect()).unwrap();
    splits.write(&corpus.splits_path()).unwrap();
    labeller::label_corpus(&corpus, &Silent).unwrap();
    corpus
}

#[test]
fn data_yaml_names_a_side_by_its_own_pictures_only_and_says_where_val_repeats_train() {
    use Side::{Test, Train, Validation};
    let repeats = "there is no validation side, so `val` of data.yaml repeats `train`";
    let has_no_train = "there is no training side, so data.yaml has no `train`";
    for (sides, expected, remark) in [
        (
            &[Train, Validation, Test][..],
            &[
                "train: images/train",
                "val: images/val",
                "test: images/test",
            ][..],
            None,
        ),
        (
            &[Train, Test],
            &[
                "train: images/train",
                "val: images/train",
                "test: images/test",
            ],
            Some(repeats),
        ),
        (
            &[Train],
            &["train: images/train", "val: images/train"],
            Some(repeats),
        ),
        (
            &[Validation, Test],
            &["val: images/val", "test: images/test"],
            Some(has_no_train),
        ),
        (&[Test], &["test: images/test"], Some(has_no_train)),
        (&[Validation], &["val: images/val"], Some(has_no_train)),
    ] {
        let folder = tempfile::tempdir().unwrap();
        on_sides(folder.path(), sides);
        let export = "export corpus --to yolo --out yolo";
        let printed = said(&run_in(folder.path(), export));
        let yaml = fs::read_to_string(folder.path().join("yolo/data.yaml")).unwrap();
        let named: Vec<&str> = yaml
            .lines()
            .filter(|line| line.contains("images/"))
            .collect();
        assert_eq!(named, expected, "{sides:?}");
        for text in [&printed, &yaml] {
            for words in [repeats, has_no_train] {
                assert_eq!(text.contains(words), remark == Some(words), "{text}");
            }
        }
        let again = json(&run_in(folder.path(), &format!("{export} --json")));
        assert_eq!(again["remark"].as_str(), remark);
    }
}

#[test]
fn data_yaml_names_no_side_whose_pictures_are_all_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let small = fs::read_to_string("tests/data/small.toml").unwrap();
    // A stratus between cameras and aircraft: it cannot be said whether the first image shows it.
    let low = "[weather.clear]\nclouds = [{ kind = \"stratus\", cover_ratio = 0.9, base_msl_m = 20, top_msl_m = 3000 }]\n";
    let (before, recorded) = small.split_once("[[recorded]]").unwrap();
    let (_, weathers) = recorded.split_once("[weather.clear]\n").unwrap();
    let sweep = before.replace("[\"clear\", \"foggy\"]", "[\"clear\"]");
    fs::write(
        folder.path().join("sweep.toml"),
        format!("{sweep}{low}{weathers}"),
    )
    .unwrap();
    run_in(folder.path(), "generate sweep.toml --out corpus");
    run_in(folder.path(), "label corpus");
    let export = "export corpus --to yolo --out yolo --every 100";
    let printed = said(&run_in(folder.path(), export));
    assert!(printed.contains("0 images"), "{printed}");
    let yaml = fs::read_to_string(folder.path().join("yolo/data.yaml")).unwrap();
    assert!(!yaml.contains("images/"), "{yaml}");
    assert!(yaml.contains("there is no training side"), "{yaml}");
}

#[test]
fn coco_has_the_annotations_of_each_side_beside_those_of_all() {
    let tiny = Tiny::made().copy();
    json_of(&tiny, "export corpus --to coco --out coco");
    let read = |name: &str| -> Value {
        serde_json::from_slice(&fs::read(tiny.path("coco").join(name)).unwrap()).unwrap()
    };
    let all = read("annotations.json");
    let items = |of: &Value, list: &str| of[list].as_array().unwrap().clone();
    let mut seen = BTreeMap::from([("images", Vec::new()), ("annotations", Vec::new())]);
    for (side, name) in [("train", "train"), ("validation", "val"), ("test", "test")] {
        let of_side = read(&format!("annotations/instances_{name}.json"));
        assert_eq!(of_side["categories"], all["categories"]);
        let images = items(&of_side, "images");
        assert!(!images.is_empty() && images.iter().all(|image| image["side"] == side));
        for annotation in items(&of_side, "annotations") {
            let of_image = |image: &&Value| image["id"] == annotation["image_id"];
            assert!(images.iter().any(|image| of_image(&image)), "{annotation}");
        }
        for (list, seen) in &mut seen {
            seen.extend(items(&of_side, list));
        }
    }
    for (list, mut seen) in seen {
        seen.sort_by_key(|item| item["id"].as_u64());
        assert_eq!(seen, items(&all, list), "{list}");
    }
}

/// A side's name in other projects' formats, which is that of `splits.json`.
fn split_of(side: Side) -> String {
    serde_json::from_value(serde_json::to_value(side).unwrap()).unwrap()
}

/// Table rows over all splits.
fn rows_of<'a>(tables: &'a Value, table: &str) -> Vec<&'a Value> {
    let splits = tables[table].as_object().unwrap().values();
    let rows = |split: &'a Value| split["rows"].as_array().unwrap();
    splits.flat_map(rows).collect()
}

#[test]
fn datasets_loads_every_table_of_a_huggingface_export_and_its_videos_are_those_of_the_corpus() {
    let tiny = Tiny::made().copy();
    let export = "export corpus --to huggingface --out hf --run run";
    let licensed = format!("{export} --license CC-BY-4.0");
    let counts = json_of(&tiny, &licensed);
    let loaded = judged("hugging_face.py", &[&tiny.path("hf")]);
    let tables = &loaded["tables"];
    let corpus = Corpus::open(&tiny.corpus()).unwrap();
    let splits = corpus.splits().unwrap();
    let (mut boxes, mut detections) = (Vec::new(), 0);
    for folder in corpus.scenarios().unwrap() {
        let id = folder.id();
        let split = split_of(splits.scenarios[&id].side);
        let mine = |table: &str| -> Vec<&Value> {
            let rows = tables[table][&split]["rows"].as_array().unwrap().iter();
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

    // The card describes exactly the columns of the tables.
    let card = fs::read_to_string(tiny.path("hf/README.md")).unwrap();
    assert!(card.contains("license: \"cc-by-4.0\""), "{card}");
    let mut sections = card.split("\n## ").skip(1);
    for name in [
        "scenarios",
        "views",
        "ticks",
        "boxes",
        "detections",
        "predictions",
    ] {
        let section = sections.next().unwrap();
        assert_eq!(section.lines().next(), Some(name));
        let rows = section.lines().filter_map(|line| line.strip_prefix("| `"));
        let described: Vec<_> = rows.map(|row| row.split_once('`').unwrap().0).collect();
        for split in tables[name].as_object().unwrap().values() {
            assert_eq!(split["columns"], serde_json::json!(described), "{name}");
        }
    }
    assert_eq!(sections.next(), None);
    assert_eq!(json_of(&tiny, &licensed)["unchanged"], true);
    refused(&tiny, export, "other options");
}

#[test]
fn webdataset_iterates_samples_of_all_views() {
    let tiny = Tiny::made().copy();
    let export = "export corpus --to webdataset --out shards --every 2 --pictures jpeg";
    let counts = json_of(&tiny, export);
    let judged_samples = judged("web_dataset.py", &[&tiny.path("shards")]);
    let samples = judged_samples["samples"].as_object().unwrap();
    let corpus = Corpus::open(&tiny.corpus()).unwrap();
    let splits = corpus.splits().unwrap();
    let mut expected = 0;
    for folder in corpus.scenarios().unwrap() {
        let id = folder.id();
        let opened = folder.open().unwrap();
        let truth = opened.truth_boxes().unwrap();
        for row in opened.frames().unwrap().rows.iter().step_by(2) {
            expected += 1;
            let sample = &samples[&format!("{id}_{:06}", row.tick)];
            let about = &sample["json"];
            assert_eq!(about["dtd_m"], row.labels.unwrap().dtd_m);
            assert_eq!(about["pose"]["pitch_deg"], row.pose.pitch_deg);
            let split = split_of(splits.scenarios[&id].side);
            assert!(sample["shard"].as_str().unwrap().starts_with(&split));
            for view in ["left", "right"] {
                let picture = &sample["pictures"][format!("{view}.jpg")];
                assert_eq!(*picture, serde_json::json!([320, 480, 3]));
                let mut boxes = truth.iter();
                let real = boxes.find(|real| real.view == view && real.tick == row.tick);
                let found = &about["views"][view]["boxes"];
                match real {
                    None => assert_eq!(found.as_array().unwrap().len(), 0),
                    Some(real) => {
                        let left = real.pixel_box.edges()[0] + 0.5;
                        assert_eq!(found[0]["bbox"][0], left);
                    }
                }
            }
        }
    }
    assert_eq!(samples.len(), expected);
    assert_eq!(counts["pictures"], 2 * expected);
    let shards: Vec<_> = judged_samples["shards"]
        .as_array()
        .unwrap()
        .iter()
        .collect();
    // Half the ticks of three scenarios: fewer samples than 16, each in a shard.
    let train = splits.side(Side::Train).count() * 3;
    let name = format!("train-{:06}.tar", train - 1);
    assert!(
        shards.iter().any(|shard| **shard == name.as_str()),
        "{shards:?}"
    );
}

#[test]
fn three_views_at_30000_1001_pass_the_judges_of_all_formats_with_the_packets_of_their_videos() {
    let folder = DTD.recorded(THREE_VIEWS);
    let path = |name: &str| folder.path().join(name);
    let corpus = Corpus::open(&path("corpus")).unwrap();
    let scenario = corpus.scenarios().unwrap().remove(0);
    let id = scenario.id();
    let export = |format: &str, more: &str| -> Value {
        let line = format!("export corpus --to {format} --out {format} --only {id} --json {more}");
        json(&run_in(folder.path(), &line))
    };
    let opened = scenario.open().unwrap();
    let frames = opened.frames().unwrap();
    let ticks = frames.rows.len();

    assert_eq!(export("mcap", "")["pictures"], 3 * ticks);
    let file = path("mcap").join(format!("{id}.mcap"));
    let read = judged("foxglove_mcap.py", &[&file, &scenario.root().join("views")]);
    let messages = &read["messages"];
    for view in ["lens", "mast", "tower_2"] {
        assert_eq!(read["pictures"][format!("/{view}/video")], ticks);
        let calibration = &messages[format!("/{view}/calibration")][0];
        let camera = &opened.calibration().unwrap().cameras[view];
        assert_eq!(calibration["K"][2], camera.k[0][2]);
        let lens = calibration["D"].as_array().map_or(0, Vec::len);
        assert_eq!(lens, camera.distortion.len());
    }
    let rows = &frames.rows;
    let labels = messages["/labels"].as_array().unwrap();
    let poses = messages["/aircraft/pose"].as_array().unwrap();
    let fixes = messages["/aircraft/location"].as_array().unwrap();
    assert_eq!([labels.len(), poses.len(), fixes.len()], [ticks; 3]);
    let number = |value: &Value| value.as_f64().unwrap_or(0.0);
    for (tick, row) in rows.iter().enumerate() {
        let real = row.labels.unwrap();
        assert_eq!(labels[tick]["dtd_m"], real.dtd_m);
        assert_eq!(labels[tick]["time_ns"], row.time_ns);
        assert_eq!(fixes[tick]["latitude"], row.pose.latitude_deg);
        let pose = &poses[tick]["pose"];
        let [x, y, z] = ["x", "y", "z"].map(|axis| number(&pose["position"][axis]));
        // Over a kilometre of ground, the plane of the target and the geodesic differ by less than this.
        assert!(
            (x.hypot(y) - real.dtd_m).abs() < 0.2,
            "tick {tick}: {x}, {y}"
        );
        assert!(
            (z - real.height_over_target_m).abs() < 0.2,
            "tick {tick}: {z}"
        );
        // The nose, x forward, points where the heading says.
        let [i, j, k, w] = ["x", "y", "z", "w"].map(|axis| number(&pose["orientation"][axis]));
        let nose = glam::DQuat::from_xyzw(i, j, k, w) * glam::DVec3::X;
        let heading_deg = nose.x.atan2(nose.y).to_degrees().rem_euclid(360.0);
        let turned = (heading_deg - row.pose.heading_true_deg).rem_euclid(360.0);
        assert!(
            turned.min(360.0 - turned) < 0.05,
            "tick {tick}: {heading_deg}"
        );
        assert!((nose.z.asin().to_degrees() - row.pose.pitch_deg).abs() < 0.05);
    }
    let boxes: usize = ["lens", "mast", "tower_2"]
        .iter()
        .flat_map(|view| messages[format!("/{view}/boxes")].as_array().unwrap())
        .map(|found| found["points"].as_array().map_or(0, Vec::len))
        .sum();
    assert_eq!(boxes, opened.truth_boxes().unwrap().len());

    export("huggingface", "");
    let loaded = judged("hugging_face.py", &[&path("huggingface")]);
    let views = rows_of(&loaded["tables"], "views");
    assert_eq!(views.len(), 3);
    assert_eq!(views[0]["k1"], -0.25);
    assert!(
        loaded["videos"]
            .as_object()
            .unwrap()
            .values()
            .all(|n| *n == ticks)
    );
    let found = rows_of(&loaded["tables"], "ticks");
    assert!(
        found
            .iter()
            .zip(rows)
            .all(|(found, row)| found["time_ns"] == row.time_ns)
    );

    let few = "--every 40 --views lens,tower_2";
    let pictures = export("webdataset", few)["pictures"].as_u64().unwrap();
    let read = judged("web_dataset.py", &[&path("webdataset")]);
    assert_eq!(
        2 * read["samples"].as_object().unwrap().len() as u64,
        pictures
    );
    for format in ["coco", "yolo"] {
        export(format, few);
    }
}

/// Options after `export corpus`, and words of the message.
#[rustfmt::skip]
const WRONG_REQUESTS: &[(&str, &str)] = &[
    ("--to pascal --out out", "possible values"),
    ("--to mcap", "--out <FOLDER>"),
    ("--to huggingface --out out --pictures jpeg", "no use for --pictures"),
    ("--to huggingface --out out --run corpus", "no predictions"),
    ("--to huggingface --out out --license free,for,all", "SPDX"),
    ("--to mcap --out out --every 2", "no use for --every"),
    ("--to coco --out out --run run", "no use for --run"),
    ("--to yolo --out out --license CC-BY-4.0", "no use for --license"),
    ("--to coco --out out --shards 4", "no use for --shards"),
    ("--to coco --out out --only nowhere", "nowhere"),
    ("--to coco --out out --views top", "top"),
    ("--to coco --out out --detections other.onnx", "aircraft.onnx"),
    ("--to coco --out out --crop-px 96x64", "no use for --crop-px"),
    ("--to crops --out out --crop-px 481x64", "a crop of 481x64 px does not fit into images of 480x320 px"),
    ("--to crops --out out --crop-px 0x64", "is not a size"),
    ("--to crops --out out --run run", "no use for --run"),
    ("--to crops --out out --detections other", "aircraft.onnx"),
    ("--to coco --out corpus", "is a corpus"),
    ("--to coco --out .", "choose a folder elsewhere"),
    ("--to coco --out corpus/export", "its own files only"),
    ("--to coco --out corpus/scenarios/1200-clear-r1/export", "its own files only"),
    ("--to coco --out link/export", "its own files only"),
    ("--to coco --out file", "is a file"),
    ("--to coco --out dangling", "is a symbolic link"),
    ("--to coco --out file/below", "file, which is a file"),
    ("--to coco --out dangling/", "is a symbolic link"),
];

#[test]
fn a_wrong_request_is_refused_and_writes_nothing() {
    let tiny = Tiny::made().copy();
    std::os::unix::fs::symlink("corpus", tiny.path("link")).unwrap();
    std::os::unix::fs::symlink("nowhere", tiny.path("dangling")).unwrap();
    fs::write(tiny.path("file"), "mine").unwrap();
    for (options, words) in WRONG_REQUESTS {
        refused(&tiny, &format!("export corpus {options}"), words);
    }
    fs::rename(tiny.corpus(), tiny.path("out.partial")).unwrap();
    refused(
        &tiny,
        "export out.partial --to coco --out out",
        "choose a folder elsewhere",
    );
    fs::rename(tiny.path("out.partial"), tiny.corpus()).unwrap();
    let export = "export corpus --to coco --out out";
    fs::create_dir(tiny.path("out")).unwrap();
    fs::write(tiny.path("out/thesis.txt"), "mine").unwrap();
    refused(&tiny, export, "thesis.txt");
    fs::remove_dir_all(tiny.path("out")).unwrap();
    fs::write(tiny.path("out.partial"), "mine").unwrap();
    refused(&tiny, export, "not a folder");
    for scenario in tiny.scenarios() {
        fs::remove_dir_all(scenario.join("detections")).unwrap();
        fs::remove_dir_all(scenario.join("registrations")).unwrap();
    }
    refused(
        &tiny,
        "export corpus --to crops --out elsewhere --boxes detections",
        "have no detections",
    );
}

#[test]
fn a_slash_after_the_name_of_the_folder_makes_no_difference() {
    let tiny = Tiny::made().copy();
    fs::create_dir(tiny.path("out")).unwrap();
    let export = |out| {
        let line = format!("export corpus --to coco --out {out} --every 8 --pictures jpeg");
        json_of(&tiny, &line)
    };
    assert_eq!(export("./out//")["unchanged"], false);
    assert_eq!(export("out/.")["unchanged"], true);
    assert!(!tiny.path("out.partial").exists());
    assert!(tiny.path("out/annotations.json").exists());
}

#[test]
fn predictions_for_scenarios_of_the_same_names_in_another_corpus_are_refused() {
    let tiny = Tiny::made().copy();
    let tables = "export corpus --to huggingface --out hf --run run";
    let corpus = Corpus::open(&tiny.corpus()).unwrap();
    let splits = corpus.splits().unwrap();
    let of_side = |side| splits.side(side).next().unwrap().to_owned();
    let (judged, learned) = (of_side(Side::Test), of_side(Side::Train));
    refused(
        &tiny,
        &format!("{tables} --only {learned}"),
        "none of the selected scenarios",
    );
    // A different flight under the judged scenario's name.
    let folder = tiny.corpus().join("scenarios").join(&judged);
    let flown = tiny.corpus().join("scenarios").join(&learned);
    fs::remove_dir_all(&folder).unwrap();
    copy_folder(&flown, &folder);
    let record = folder.join("scenario.json");
    let text = fs::read_to_string(&record).unwrap();
    fs::write(&record, text.replace(&learned, &judged)).unwrap();
    let sealed = dataset::corpus::seal::read_seal(&folder).unwrap().unwrap();
    fs::remove_file(folder.join("DONE.json")).unwrap();
    fs::remove_file(folder.join("MANIFEST.b3")).unwrap();
    dataset::corpus::seal::seal_folder(&folder, &sealed.config_hash).unwrap();
    refused(
        &tiny,
        &format!("{tables} --only {judged}"),
        "was judged on another corpus",
    );
}

#[test]
fn a_damaged_video_is_named_and_no_export_appears() {
    let tiny = Tiny::made().copy();
    let video = tiny.scenarios()[1].join("views/left.mp4");
    let mut bytes = fs::read(&video).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x55;
    fs::write(&video, bytes).unwrap();
    tiny.line("export corpus --to coco --out out")
        .ends_with(2, &["left.mp4"]);
    assert!(!tiny.path("out").exists() && !tiny.path("out.partial").exists());
}
