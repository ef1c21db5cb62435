//! `dtd evaluate-detector` from outside: every image is accounted for, pycocotools agrees on the average precision, and nothing is
//! written to the corpus.

mod tiny;

use std::collections::HashMap;
use std::fs;
use std::path::Path;
use std::process::Command;

use dataset::corpus::Corpus;
use dataset::corpus::detections::Detections;
use dataset::tables::pixel_box::PixelBox;
use detector_evaluation::{AveragePrecision, PrecisionTally, TrueAircraft};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;
use serde_json::{Value, json};
use testkit::command::{Ending, text};
use testkit::files::contents;
use testkit::{
    judge_in_chromium, onnx_runtime_with_openvino, program_of_venv, repository, skipped,
};
use tiny::{MODEL, SCENARIOS, Tiny};

/// An image's aircraft and detections.
type Pictured = (Option<TrueAircraft>, Vec<(PixelBox, f64)>);

/// pycocotools' figures.
fn pycocotools(pictures: &[Pictured]) -> Value {
    let bbox = |pixel_box: &PixelBox| {
        let [left, top, ..] = pixel_box.edges();
        json!([left, top, pixel_box.width_px, pixel_box.height_px])
    };
    let (mut annotations, mut detections) = (Vec::new(), Vec::new());
    for (image, (truth, found)) in (1..).zip(pictures) {
        if let Some(truth) = truth {
            annotations.push(json!({
                "id": image, "image_id": image, "category_id": 1, "bbox": bbox(&truth.pixel_box),
                "area": truth.pixel_box.area(), "iscrowd": u8::from(truth.is_ignored),
            }));
        }
        detections.extend(found.iter().map(|(pixel_box, score)| {
            json!({"image_id": image, "category_id": 1, "bbox": bbox(pixel_box), "score": score})
        }));
    }
    let images: Vec<_> = (1..=pictures.len()).map(|id| json!({ "id": id })).collect();
    let truth = json!({
        "info": {}, "images": images, "annotations": annotations,
        "categories": [{"id": 1, "name": "aircraft"}],
    });
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, value: &Value| {
        fs::write(folder.path().join(name), value.to_string()).unwrap();
    };
    write("ground_truth.json", &truth);
    write("detections.json", &json!(detections));
    let output = Command::new(program_of_venv("python"))
        .arg(repository().join("tests/judges/coco_ap.py"))
        .args(["ground_truth.json", "detections.json"].map(|name| folder.path().join(name)))
        .succeeds();
    testkit::command::json(&output)
}

fn ours(pictures: &[Pictured]) -> AveragePrecision {
    let mut tally = PrecisionTally::default();
    for (truth, found) in pictures {
        tally.count(*truth, found);
    }
    tally.figures()
}

fn assert_agree(ours: &Value, theirs: &Value) {
    for (name, theirs) in theirs.as_object().unwrap() {
        match (ours[name].as_f64(), theirs.as_f64()) {
            (Some(ours), Some(theirs)) => {
                assert!(
                    (ours - theirs).abs() < 1e-9,
                    "{name}: {ours}, pycocotools {theirs}"
                );
            }
            (ours, theirs) => assert_eq!(ours, theirs, "{name}"),
        }
    }
}

fn random_box(rng: &mut ChaCha12Rng) -> PixelBox {
    PixelBox {
        cx_px: rng.random_range(100.0..1_800.0),
        cy_px: rng.random_range(100.0..1_200.0),
        width_px: rng.random_range(8.0..200.0),
        height_px: rng.random_range(4.0..150.0),
    }
}

#[test]
fn average_precision_is_that_of_pycocotools() {
    for seed in 0..3 {
        let mut rng = ChaCha12Rng::seed_from_u64(seed);
        let pictures: Vec<Pictured> = (0..300)
            .map(|_| {
                let truth = rng.random_bool(0.8).then(|| TrueAircraft {
                    pixel_box: random_box(&mut rng),
                    is_ignored: rng.random_bool(0.15),
                });
                let boxes = (0..rng.random_range(0..4)).map(|_| {
                    let near = truth.filter(|_| rng.random_bool(0.7));
                    let pixel_box = match near {
                        None => random_box(&mut rng),
                        Some(truth) => {
                            let around = truth.pixel_box;
                            let mut off = || rng.random_range(-0.2..0.2);
                            PixelBox {
                                cx_px: around.cx_px + off() * around.width_px,
                                cy_px: around.cy_px + off() * around.height_px,
                                width_px: around.width_px * (1.0 + off()),
                                height_px: around.height_px * (1.0 + off()),
                            }
                        }
                    };
                    // Coarse scores, so that many are equal.
                    (pixel_box, f64::from(rng.random_range(6..20_u32)) / 20.0)
                });
                let boxes: Vec<_> = boxes.collect();
                (truth, boxes)
            })
            .collect();
        let ours = serde_json::to_value(ours(&pictures)).unwrap();
        assert!(ours["ap"].as_f64().unwrap() > 0.05, "{ours}");
        assert_agree(&ours, &pycocotools(&pictures));
    }
}

/// Runs the verb; its figures.
fn evaluated(tiny: &Tiny, more: &[&str]) -> Value {
    let arguments = [
        "evaluate-detector",
        "corpus",
        "--out",
        "judged",
        "--model",
        MODEL,
        "--json",
    ];
    let output = tiny.dtd(&[&arguments[..], more].concat()).succeeds();
    let evaluation = testkit::command::json(&output);
    let written = fs::read(tiny.path("judged/evaluation.json")).unwrap();
    assert_eq!(
        evaluation,
        serde_json::from_slice::<Value>(&written).unwrap()
    );
    evaluation
}

/// The evaluation without figures that differ between runs.
fn without_cost(mut evaluation: Value) -> Value {
    for figures in evaluation["modes"].as_object_mut().unwrap().values_mut() {
        for key in ["cpu_ms_per_picture", "cpu_ms_by_stage"] {
            figures.as_object_mut().unwrap().remove(key).unwrap();
        }
    }
    evaluation
}

/// A mode's detections, from the files.
fn pictured(tiny: &Tiny, mode: &str) -> Vec<Pictured> {
    let corpus = Corpus::open(&tiny.corpus()).unwrap();
    let mut pictures = Vec::new();
    for folder in corpus.scenarios().unwrap() {
        let scenario = folder.open().unwrap();
        let record = scenario.record().unwrap();
        let path = tiny.path(&format!("judged/searched/{mode}/{}.parquet", record.id));
        let content = fs::read(&path).unwrap();
        let mut found: HashMap<_, Vec<_>> = HashMap::new();
        for seen in Detections::parse(content, &path, record.pictures())
            .unwrap()
            .boxes
        {
            let here = found.entry((seen.tick, seen.view)).or_default();
            here.push((seen.confirmed, (seen.pixel_box, seen.score)));
        }
        let mut truth: HashMap<_, _> = scenario
            .truth_boxes()
            .unwrap()
            .into_iter()
            .map(|real| {
                let aircraft = TrueAircraft {
                    pixel_box: real.pixel_box,
                    is_ignored: real.visible_fraction <= 0.5,
                };
                ((real.tick, real.view), aircraft)
            })
            .collect();
        for tick in 0..record.ticks {
            for view in &record.views {
                let key = (tick, view.clone());
                let mut boxes = found.remove(&key).unwrap_or_default();
                boxes.sort_by_key(|(confirmed, _)| !confirmed);
                let boxes = boxes.into_iter().map(|(_, scored)| scored).collect();
                pictures.push((truth.remove(&key), boxes));
            }
        }
    }
    pictures
}

#[test]
fn openvino_finds_what_onnx_runtime_finds_on_the_processor() {
    let Some(library) = onnx_runtime_with_openvino() else {
        return skipped("no build of ONNX Runtime with OpenVINO for this machine or its Python");
    };
    let tiny = Tiny::made().copy();
    evaluated(&tiny, &["--mode", "full"]);
    let plain = pictured(&tiny, "auto_segmentation");
    let openvino = ["--device", "openvino", "--onnx-runtime", text(&library)];
    evaluated(&tiny, &[&["--mode", "full"], &openvino[..]].concat());
    let rounded = pictured(&tiny, "auto_segmentation");
    let mut found = 0;
    for (index, ((_, plain), (_, rounded))) in plain.iter().zip(&rounded).enumerate() {
        // A box near the lowest score may be on either side.
        for (pixel_box, score) in plain.iter().filter(|(_, score)| *score > 0.5) {
            let same = |(other, other_score): &&(PixelBox, f64)| {
                other.iou(pixel_box) > 0.7 && (other_score - score).abs() < 0.1
            };
            assert!(
                rounded.iter().any(|other| same(&other)),
                "image {index}: {pixel_box:?} {score}, with OpenVINO {rounded:?}"
            );
            found += 1;
        }
    }
    assert!(found > 20, "{found}");
    let boxes =
        |pictures: &[Pictured]| pictures.iter().map(|(_, found)| found.len()).sum::<usize>();
    let (plain, rounded) = (boxes(&plain), boxes(&rounded));
    assert!(
        rounded <= plain + 3,
        "{rounded} boxes, {plain} without OpenVINO"
    );
}

#[test]
fn every_picture_is_accounted_for_and_the_corpus_stays_as_it_is() {
    let tiny = Tiny::made().copy();
    let before = contents(&tiny.corpus());
    let evaluation = evaluated(&tiny, &[]);
    assert!(before == contents(&tiny.corpus()), "the corpus has changed");
    assert_eq!(evaluation["scenarios"].as_array().unwrap().len(), SCENARIOS);
    assert_eq!(evaluation["range_weather"], "clear");
    for mode in ["auto_segmentation", "scaled", "tracked"] {
        let figures = &evaluation["modes"][mode];
        let number = |path: &str| {
            let found = figures.pointer(path).and_then(Value::as_u64);
            found.unwrap_or_else(|| panic!("{mode}{path}: {figures}"))
        };
        let pictures = pictured(&tiny, mode);
        assert_eq!(number("/pictures/total"), pictures.len() as u64);
        let expected = pictures
            .iter()
            .filter(|(truth, _)| truth.is_some_and(|t| !t.is_ignored));
        assert_eq!(
            number("/pictures/in_sight/expected"),
            expected.count() as u64,
            "{mode}"
        );
        let absent = pictures.iter().filter(|(truth, _)| truth.is_none()).count();
        assert_eq!(number("/pictures/not_expected/absent"), absent as u64);
        for part in ["in_sight", "hidden_by_haze", "maybe_hidden_by_cloud"] {
            let missed = figures["pictures"][part]["missed"].as_object().unwrap();
            let missed: u64 = missed.values().map(|count| count.as_u64().unwrap()).sum();
            let [expected, found] =
                ["expected", "found"].map(|key| number(&format!("/pictures/{part}/{key}")));
            assert_eq!(expected, found + missed, "{mode} {part}");
        }
        assert_agree(&figures["average_precision"], &pycocotools(&pictures));
        assert!(figures["cpu_ms_per_picture"].as_f64().unwrap() > 0.0);
    }
    let found = evaluation["modes"]["auto_segmentation"]["recall"]["recall"].as_f64();
    assert!(found > Some(0.9), "{evaluation}");
    let disparity = evaluation["registration"]["disparity_sd_px"].as_f64();
    assert!(disparity.is_some_and(|px| px < 1.0), "{evaluation}");

    judge_in_chromium("report_page.py", tiny.path("judged/report.html"));
    let report = fs::read_to_string(tiny.path("judged/report.html")).unwrap();
    for words in ["<svg", "data:image/png;base64,", "Where every image went"] {
        assert!(report.contains(words), "{words}");
    }
    // The name of SVG's vocabulary is no address: nothing is loaded from it.
    let report = report.replace("http://www.w3.org/2000/svg", "");
    for words in ["http:", "https:", "=\"//", "<link", "@import"] {
        assert!(!report.contains(words), "not self-contained: {words:?}");
    }
}

#[test]
fn what_was_searched_before_is_used_again_unless_it_is_damaged() {
    let tiny = Tiny::made().copy();
    let only = ["--mode", "full"];
    let first = evaluated(&tiny, &only);
    let searched = tiny.path("judged/searched/auto_segmentation");
    let stamps = || {
        let files = fs::read_dir(&searched).unwrap().map(|entry| entry.unwrap());
        let stamp = |entry: fs::DirEntry| {
            (
                entry.file_name(),
                entry.metadata().unwrap().modified().unwrap(),
            )
        };
        files.map(stamp).collect::<HashMap<_, _>>()
    };
    let before = stamps();
    assert_eq!(before.len(), 3 * SCENARIOS);
    assert_eq!(evaluated(&tiny, &only), first, "costs are kept, too");
    assert_eq!(stamps(), before);

    let damaged = tiny.scenarios()[1]
        .file_name()
        .unwrap()
        .to_str()
        .unwrap()
        .to_owned()
        + ".parquet";
    fs::write(searched.join(&damaged), "no table").unwrap();
    let again = evaluated(&tiny, &only);
    assert_eq!(without_cost(again), without_cost(first));
    assert_ne!(fs::read(searched.join(&damaged)).unwrap(), b"no table");
}

#[test]
fn what_cannot_be_evaluated_is_refused_before_anything_is_searched() {
    let tiny = Tiny::made().copy();
    let refused = |arguments: &[&str], words: &str| {
        tiny.dtd(&[&["evaluate-detector"], arguments].concat())
            .ends_with(2, &[words]);
    };
    fs::create_dir(tiny.path("thesis")).unwrap();
    fs::write(tiny.path("thesis/thesis.tex"), "").unwrap();
    refused(
        &["corpus", "--out", "thesis", "--model", MODEL],
        "holds thesis.tex",
    );
    refused(
        &["corpus", "--out", "corpus/scenarios/x", "--model", MODEL],
        "contains its own files only",
    );
    refused(
        &["corpus", "--out", "judged", "--model", "sweep.toml"],
        "sweep.toml",
    );
    refused(&["corpus", "--out", "judged", "--mode", "guess"], "scaled");
    tiny.line("generate sweep.toml --out bare").succeeds();
    refused(&["bare", "--out", "judged", "--model", MODEL], "dtd label");
    assert!(!Path::new(&tiny.path("judged/evaluation.json")).exists());
}
