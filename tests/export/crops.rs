//! Training crops: the webdataset package reads them, mixed over each side's scenarios, and each shows the aircraft where its JSON says.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::process::{Command, Stdio};
use std::thread;
use std::time::Instant;

use dataset::corpus::Corpus;
use dataset::corpus::detections::choose;
use serde_json::Value;
use testkit::command::Ending;
use testkit::files::assert_same_contents;
use testkit::{program_of_venv, repository};

use crate::tiny::Tiny;
use crate::{json_of, refused};

const EXPORT: &str = "export corpus --to crops --out crops --crop-px 96x64 --shards 1";

/// Samples that the judge read, by shard.
fn read(tiny: &Tiny) -> BTreeMap<String, Vec<Value>> {
    let output = Command::new(program_of_venv("python"))
        .arg(repository().join("tests/judges/crops.py"))
        .args(["crops", "coco/images", "corpus"].map(|name| tiny.path(name)))
        .env("PYTHONPATH", repository().join("python"))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .succeeds();
    serde_json::from_value(testkit::command::json(&output)).unwrap()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value}"))
}

/// A box in its whole image, as left, top, width and height.
fn in_picture(of_view: &Value, corners: &Value) -> [f64; 4] {
    let crop = &of_view["crop"];
    let [left, top, width, height] = [0, 1, 2, 3].map(|at| number(&corners["bbox"][at]));
    let (right, down) = (number(&crop["left_px"]), number(&crop["top_px"]));
    [left + right, top + down, width, height]
}

#[test]
fn crops_show_the_aircraft_where_their_boxes_say_and_webdataset_reads_them_mixed_by_side() {
    let tiny = Tiny::made().copy();
    json_of(&tiny, "export corpus --to coco --out coco");
    let counts = json_of(&tiny, EXPORT);
    let shards = read(&tiny);
    let corpus = Corpus::open(&tiny.corpus()).unwrap();
    let splits = corpus.splits().unwrap();
    let (mut keys, mut sights) = (BTreeSet::new(), 0);
    let mut contrasts = Vec::new();
    for (shard, samples) in &shards {
        let mut in_order = Vec::new();
        for sample in samples {
            let about = &sample["json"];
            let id = about["scenario"].as_str().unwrap();
            let side = splits.scenarios[id].side;
            assert_eq!(about["split"], serde_json::to_value(side).unwrap());
            assert!(
                shard.starts_with(about["split"].as_str().unwrap()),
                "{shard}"
            );
            let opened = corpus.scenario(id).open().unwrap();
            let tick = about["tick"].as_u64().unwrap() as u32;
            let row = &opened.frames().unwrap().rows[tick as usize];
            let labels = row.labels.unwrap();
            for (name, expected) in [
                ("dtd_m", labels.dtd_m),
                ("along_track_m", labels.along_track_m),
                ("cross_track_m", labels.cross_track_m),
                ("height_over_target_m", labels.height_over_target_m),
            ] {
                assert_eq!(about[name], expected, "{name}");
            }
            assert_eq!(about["pose"]["latitude_deg"], row.pose.latitude_deg);
            assert_eq!(about["time_ns"], row.time_ns);
            assert_eq!(about["weather"], "clear");
            for (view, of_view) in about["views"].as_object().unwrap() {
                let truth = opened.truth_boxes().unwrap();
                let mut truth = truth.iter();
                let real = truth.find(|real| real.tick == tick && real.view == *view);
                let [left, top, right, bottom] = real.unwrap().pixel_box.edges();
                let expected = [left + 0.5, top + 0.5, right - left, bottom - top];
                let found = in_picture(of_view, &of_view["truth"][0]);
                for (found, expected) in found.iter().zip(expected) {
                    assert!((found - expected).abs() < 1e-9, "{found}, {expected}");
                }
                sights += usize::from(of_view["truth"][0]["sight"] == "in_sight");
                assert!(of_view["detections"].is_array(), "{of_view}");
                let camera = &opened.calibration().unwrap().cameras[view];
                assert_eq!(of_view["calibration"]["k"][0][0], camera.k[0][0]);
                contrasts.extend(sample["contrast"][view].as_f64());
            }
            keys.insert(sample["key"].as_str().unwrap());
            in_order.push((id, tick));
        }
        assert!(
            samples.len() < 12 || !in_order.is_sorted(),
            "{shard} is not mixed"
        );
    }
    assert_eq!(counts["pictures"], 2 * keys.len());
    assert_eq!(counts["boxes"], 2 * keys.len());
    assert!(keys.len() > 20 && sights > 40, "{} {sights}", keys.len());
    assert!(contrasts.len() > keys.len());
    contrasts.sort_by(f64::total_cmp);
    let low = contrasts[contrasts.len() / 10];
    assert!(low > 1.5, "the aircraft does not stand out: {contrasts:?}");
    let sides = [
        "test-000000.tar",
        "train-000000.tar",
        "validation-000000.tar",
    ];
    assert!(shards.keys().eq(sides), "{:?}", shards.keys());
    assert_eq!(json_of(&tiny, EXPORT)["unchanged"], true);
    refused(&tiny, &format!("{EXPORT} --every 2"), "other options");
}

#[test]
fn crops_around_detections_are_around_the_best_one_and_have_the_true_boxes_as_well() {
    let tiny = Tiny::made().copy();
    let boxes = "--boxes detections --detections aircraft.onnx";
    let counts = json_of(&tiny, &format!("{EXPORT} {boxes}"));
    let corpus = Corpus::open(&tiny.corpus()).unwrap();
    let folders = corpus.scenarios().unwrap();
    let model = choose(&folders, None).unwrap().unwrap().hash;
    let (mut pictures, mut expected) = (0, BTreeMap::new());
    for folder in &folders {
        let opened = folder.open().unwrap();
        let mut best: BTreeMap<(u32, String), (f64, [f64; 2])> = BTreeMap::new();
        for found in opened.detections(&model).unwrap().into_confirmed() {
            let centre = [found.pixel_box.cx_px, found.pixel_box.cy_px];
            let entry = best
                .entry((found.tick, found.view))
                .or_insert((found.score, centre));
            if found.score > entry.0 {
                *entry = (found.score, centre);
            }
        }
        for tick in 0..opened.frames().unwrap().rows.len() as u32 {
            let views = ["left", "right"].map(|view| best.get(&(tick, view.to_owned())));
            let [Some(left), Some(right)] = views else {
                continue;
            };
            pictures += 2;
            expected.insert(format!("{}_{tick:06}", folder.id()), [left.1, right.1]);
        }
    }
    assert_eq!(counts["pictures"], pictures);
    let ticks: usize = (folders.iter())
        .map(|folder| folder.open().unwrap().frames().unwrap().rows.len())
        .sum();
    assert_eq!(counts["left_out"], 2 * ticks - pictures);
    let read = crate::judged("web_dataset.py", &[&tiny.path("crops")]);
    let samples = read["samples"].as_object().unwrap();
    assert!(samples.keys().eq(expected.keys()));
    let mut near = 0;
    for (key, centres) in expected {
        for (view, centre) in ["left", "right"].into_iter().zip(centres) {
            let of_view = &samples[&key]["json"]["views"][view];
            let crop = &of_view["crop"];
            // Moved at an edge, it still has the centre of the box, which is in the image.
            let (left, top) = (number(&crop["left_px"]), number(&crop["top_px"]));
            let within = |centre: f64, start: f64, side: f64, picture: f64| {
                let start_at = (centre - (side - 1.0) / 2.0).clamp(0.0, picture - side);
                (start - start_at).abs() <= 0.5
            };
            assert!(within(centre[0], left, 96.0, 480.0), "{key} {view}: {crop}");
            assert!(within(centre[1], top, 64.0, 320.0), "{key} {view}: {crop}");
            let detections = of_view["detections"].as_array().unwrap();
            assert!(detections.iter().all(|found| found["score"].is_f64()));
            let [x, y, width, height] = in_picture(of_view, &of_view["truth"][0]);
            let (dx, dy) = (
                x + width / 2.0 - 0.5 - centre[0],
                y + height / 2.0 - 0.5 - centre[1],
            );
            near += usize::from(dx.hypot(dy) < 3.0);
        }
    }
    assert!(10 * near > 9 * pictures, "{near} of {pictures}");
}

#[test]
fn an_export_of_crops_that_is_killed_again_and_again_ends_with_the_bytes_of_an_undisturbed_one() {
    let tiny = Tiny::made().copy();
    let began = Instant::now();
    let straight = EXPORT.replace("--out crops", "--out straight");
    json_of(&tiny, &straight);
    let whole = began.elapsed();
    const KILLS: u32 = 12;
    for kill in 1..=KILLS {
        let mut command = tiny.line(EXPORT);
        let silent = command.stdout(Stdio::null()).stderr(Stdio::null());
        let mut process = silent.spawn().unwrap();
        thread::sleep(whole * kill / KILLS);
        process.kill().unwrap();
        process.wait().unwrap();
        if kill % 4 == 0 {
            // Otherwise later kills would meet only the remaining work.
            let _ = fs::remove_dir_all(tiny.path("crops"));
            let _ = fs::remove_dir_all(tiny.path("crops.partial"));
        }
    }
    json_of(&tiny, EXPORT);
    assert_same_contents(&tiny.path("crops"), &tiny.path("straight"));
    assert!(!tiny.path("crops.partial").exists());
}
