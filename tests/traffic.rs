//! A corpus with several aircraft: plan, flights, images, labels, verification.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use dataset::corpus::Corpus;
use dataset::corpus::open_scenario::OpenScenario;
use dataset::tables::pixel_box::TruthBox;
use serde_json::json;
use testkit::command::{Dtd, text};
use testkit::files::copy_folder;
use testkit::sweep::{SmallSweep, starting_from};
use testkit_simulator::judged_boxes;

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));
const ID: &str = "1200-clear-r1";

/// A sweep of one approach from 3 NM, with images that are hardly compressed.
fn sweep(traffic: &str) -> String {
    let sweep = SmallSweep {
        name: "traffic",
        seed: 5,
        weathers: &["clear"],
        repeats: 1,
        size_px: (960, 640),
        frame_rate: "1/3",
        tables: &format!(
            "{}\n[video]\ncrf = 3\n\n[weather.clear]\nvisibility_m = 80000\n{traffic}",
            starting_from(3.0, 3.0, 300)
        ),
    };
    sweep.toml()
}

/// An arrival behind the first aircraft, a departure before it, one that taxies, one that is parked, and one that partly hides the arrival.
const TRAFFIC: &str = r#"
[[traffic]]
role = "arrival"
type = "A359"
spacing_nm = 3

[[traffic]]
role = "departure"
type = "A320neo"
after_s = -60

[[traffic]]
role = "taxi"
after_s = -20

[[traffic]]
role = "parked"
type = "ATR72-600"

[[traffic]]
role = "missed-approach"
type = "MD-82"
spacing_nm = 2.88
"#;

/// Pixels at least this many levels apart show something else: compression and the glow of lamps make less.
const LEVELS: u8 = 16;
/// Reach of an aircraft's own lamps beyond its box, pixels.
const GLOW_PX: f64 = 8.0;

#[test]
fn every_aircraft_is_drawn_where_its_box_is_and_nothing_else_changes() {
    let [with, without] = [TRAFFIC, ""].map(|traffic| DTD.recorded(&sweep(traffic)));
    let [with, without] = [with, without].map(|folder| {
        let corpus = Corpus::open(&folder.path().join("corpus")).unwrap();
        (folder, corpus)
    });
    let [several, alone] = [&with, &without].map(|(_, corpus)| corpus.scenario(ID).open().unwrap());

    let record = several.record().unwrap();
    assert_eq!((record.schema_version, record.aircraft_count()), (5, 6));
    assert_eq!(alone.record().unwrap().schema_version, 1);
    assert!(alone.aircraft().unwrap().is_none());
    assert!(!alone.folder().aircraft_path().exists());
    // Nothing changes for the first aircraft.
    assert_eq!(several.frames().unwrap().rows, alone.frames().unwrap().rows);

    let boxes = several.truth_boxes().unwrap();
    let first = boxes
        .iter()
        .filter(|of| of.is_of_first())
        .map(|of| TruthBox {
            aircraft_number: None,
            occluded_fraction: None,
            ..of.clone()
        });
    assert_eq!(first.collect::<Vec<_>>(), alone.truth_boxes().unwrap());
    let mut shown = BTreeMap::new();
    for view in &record.views {
        compare(view, &several, &alone, &boxes, &mut shown);
    }
    assert_eq!(shown.keys().copied().collect::<Vec<_>>(), [1, 2, 3, 4, 5]);
    assert!(shown.values().all(|count| *count >= 4), "{shown:?}");

    let rows = several.aircraft().unwrap().unwrap();
    for row in &rows {
        assert_eq!(row.dtd_m.is_some(), row.aircraft_number < 2, "{row:?}");
    }
    // When the first one touches down, the second is 3 NM out.
    let last = rows.iter().rev().find(|row| row.aircraft_number == 1);
    let ahead_m = last.unwrap().dtd_m.unwrap() - 3.0 * 1_852.0;
    assert!(ahead_m.abs() < 300.0, "{ahead_m}");

    let corpus = with.0.path().join("corpus");
    let report = DTD.json(&["verify", text(&corpus), "--json"]);
    assert_eq!(report["findings"], json!([]));
    let again = DTD.json(&["label", text(&corpus), "--json"]);
    assert_eq!(again["unchanged"], json!([ID]), "{again}");

    let verdict = judged_boxes(&corpus, &[0.75, 0.25, 0.0]);
    for aircraft in ["B737-800", "A350-900", "A320neo", "ATR72-600", "MD-82"] {
        assert!(verdict[aircraft]["boxes"].as_u64() > Some(4), "{verdict}");
    }
    let hidden = &verdict["A350-900"]["partly_hidden"];
    assert!(hidden.as_u64() > Some(8), "{verdict}");

    exported(&corpus, true);
    exported(&without.0.path().join("corpus"), false);
    // A detector learns all of them, but none beside another one.
    let model = with.0.path().join("new.onnx");
    let mut train = vec!["train-detector", text(&corpus), "--out", text(&model)];
    train.extend(["--minutes", "0.001", "--json"]);
    let report = DTD.json(&train);
    let [learned, left_out] = ["pieces_with_aircraft", "left_out_with_several_aircraft"]
        .map(|count| report[count].as_u64().unwrap());
    let of_first = boxes.iter().filter(|of| of.is_of_first()).count() as u64;
    let backgrounds = 3 * record.views.len() as u64;
    assert!(learned > 0 && left_out > 0, "{report}");
    assert!(learned + left_out > of_first + backgrounds, "{report}");
}

/// Checks that boxes in exports have numbers of aircraft if, and only if, there are several.
fn exported(corpus: &Path, has_traffic: bool) {
    for (format, file) in [
        ("coco", "annotations.json"),
        ("huggingface", "data/boxes/train.parquet"),
        ("webdataset", "train-000000.tar"),
    ] {
        let out = corpus.with_file_name(format);
        DTD.succeeds(&["export", text(corpus), "--to", format, "--out", text(&out)]);
        let bytes = fs::read(out.join(file)).unwrap();
        for name in ["aircraft_number", "occluded_fraction"] {
            let mut parts = bytes.windows(name.len());
            let is_there = parts.any(|part| part == name.as_bytes());
            assert_eq!(is_there, has_traffic, "{format}: {name}");
        }
    }
}

/// Counts the other aircraft whose boxes have changed, and checks that all that changed is in a box.
fn compare(
    view: &str,
    several: &OpenScenario,
    alone: &OpenScenario,
    boxes: &[TruthBox],
    shown: &mut BTreeMap<u32, usize>,
) {
    let mut videos = [several, alone].map(|scenario| scenario.open_video(view).unwrap());
    let width_px = videos[0].width() as usize;
    let [mut rgb, mut plain] = [Vec::new(), Vec::new()];
    for tick in 0.. {
        let has_frame = videos[0].next_frame(&mut rgb).unwrap().is_some();
        assert_eq!(
            videos[1].next_frame(&mut plain).unwrap().is_some(),
            has_frame
        );
        if !has_frame {
            break;
        }
        let others: Vec<&TruthBox> = boxes
            .iter()
            .filter(|of| of.tick == tick && of.view == view && !of.is_of_first())
            .collect();
        let mut changed = vec![0; others.len()];
        for (index, (a, b)) in rgb.chunks(3).zip(plain.chunks(3)).enumerate() {
            if a.iter().zip(b).all(|(a, b)| a.abs_diff(*b) < LEVELS) {
                continue;
            }
            let (x, y) = ((index % width_px) as f64, (index / width_px) as f64);
            let mut is_in_some = false;
            for (other, count) in others.iter().zip(&mut changed) {
                let [left, top, right, bottom] = other.pixel_box.edges();
                let is_near = |by: f64| {
                    x >= left - by && x <= right + by && y >= top - by && y <= bottom + by
                };
                *count += usize::from(is_near(0.5));
                is_in_some |= is_near(GLOW_PX);
            }
            assert!(is_in_some, "{view}, tick {tick}: ({x}, {y}) has changed");
        }
        for (other, count) in others.into_iter().zip(changed) {
            let share = count as f64 / other.pixel_box.area();
            if other.is_expected() && share > 0.1 {
                *shown.entry(other.number()).or_default() += 1;
            }
        }
    }
}

#[test]
fn a_table_of_aircraft_that_was_changed_or_lost_is_found() {
    let folder = DTD.recorded(&sweep(TRAFFIC));
    let corpus = Corpus::open(&folder.path().join("corpus")).unwrap();
    let scenario = corpus.scenario(ID);
    let mut rows = scenario.open().unwrap().aircraft().unwrap().unwrap();
    let expected = folder.path().join("expected");
    copy_folder(&folder.path().join("corpus"), &expected);
    let findings = || {
        let corpus = folder.path().join("corpus");
        let arguments = [
            "verify",
            text(&corpus),
            "--json",
            "--against",
            text(&expected),
        ];
        let report = testkit::command::json(&DTD.run(&arguments));
        report["findings"].to_string()
    };
    let seal = |rows: &[dataset::tables::aircraft::AircraftRow]| {
        let claim = scenario.claim().unwrap();
        let write = |_: &str, path: &std::path::Path| {
            dataset::tables::image_rows::ImageRow::write(rows, path)
        };
        let names = ["aircraft.parquet"];
        dataset::corpus::seal::replace_files(&claim, scenario.root(), &names, write).unwrap();
    };
    let right = rows.clone();
    rows[6].pose.latitude_deg += 1e-4;
    rows[13].dtd_m = None;
    rows[27].pose.latitude_deg += 0.2;
    seal(&rows);
    let found = findings();
    for words in [
        "of aircraft 0 differs from the tick of frames.parquet",
        "is null, expected",
        "of aircraft 3 is 2",
        "m from the expected place",
    ] {
        assert!(found.contains(words), "{words}: {found}");
    }
    seal(&right[..right.len() - 1]);
    assert!(findings().contains("rows, expected"), "{}", findings());
    seal(&right);
    assert_eq!(findings(), "[]");
}

#[test]
fn traffic_that_cannot_be_is_refused_at_its_table_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sweep.toml");
    let other = |lines: &str| format!("\n[[traffic]]\n{lines}\n");
    for (traffic, words) in [
        (
            other("role = \"arrival\"\nafter_s = 90\ntype = \"A35\""),
            "the nearest is A350-900",
        ),
        (
            other("role = \"arrival\"\nafter_s = 1"),
            "expected at least 150 m in the air",
        ),
        (
            other("role = \"departure\"\nafter_s = -10"),
            "change after_s or spacing_nm",
        ),
        (
            other("role = \"arrival\""),
            "has neither, expected either after_s or spacing_nm",
        ),
        (
            other("role = \"parked\"\nafter_s = 3"),
            "expected neither after_s nor spacing_nm",
        ),
        (
            other("role = \"taxi\"\nspacing_nm = 1"),
            "expected after_s alone",
        ),
        (
            other("role = \"glider\"\nafter_s = 3"),
            "expected one of `arrival`, `departure`",
        ),
        (
            other("role = \"arrival\"\nafter_s = 1000"),
            "expected a time in seconds from -900 to 900",
        ),
        (
            other("role = \"parked\"").repeat(8),
            "has 8 other aircraft with this one, expected at most 7",
        ),
    ] {
        fs::write(&path, sweep(&traffic)).unwrap();
        DTD.ends_with(&["plan", text(&path)], 2, &["sweep.toml:", words]);
    }
}
