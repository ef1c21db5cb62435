//! Clocks of two files that began at different times.

use std::fs;
use std::path::Path;

use serde_json::Value;
use testkit::command::text;

use crate::workshop::{Workshop, ffmpeg};

/// The second file begins so much later.
const SHIFT_S: f64 = 0.4;

#[test]
fn the_offset_of_two_files_is_measured_and_kept_for_the_next_start() {
    let workshop = Workshop::shared();
    let [left, right] = workshop.flight();
    let shifted = workshop.folder.path().join("right-shifted.mp4");
    let shift = format!("{SHIFT_S}");
    let arguments = ["-itsoffset", &shift, "-i", text(right), "-c", "copy"];
    ffmpeg(
        &[
            &arguments[..],
            &["-video_track_timescale", "90000", text(&shifted)],
        ]
        .concat(),
    );
    let kept = workshop.folder.path().join("offsets.json");
    let options = ["--as-fast-as-possible", "--offset", "right=auto"];
    let options = [&options[..], &["--keep-offsets", text(&kept)]].concat();
    let lines = workshop.lines([text(left), text(&shifted)], &options);
    let offsets = offsets(&lines);
    assert_eq!(offsets[0]["offset_s"], Value::Null, "nobody knows it yet");
    let (known, last) = (&offsets[1], offsets.last().unwrap());
    for told in [known, last] {
        let [offset_s, sd_s] = ["offset_s", "sd_s"].map(|key| told[key].as_f64().unwrap());
        let error_s = offset_s + SHIFT_S;
        assert!(error_s.abs() < 3.0 * sd_s && sd_s <= 0.03, "{offsets:#?}");
    }
    // Until it was known, the first view answered alone.
    let known_s = known["time_s"].as_f64().unwrap();
    for line in lines.iter().filter(|line| line["state"] == "fresh") {
        let views = line["views"].as_array().unwrap();
        let is_before = line["time_s"].as_f64().unwrap() < known_s;
        assert!(!is_before || views.len() == 1, "{line}");
    }
    assert!(used_together(&lines) > 20, "{offsets:#?}");
    let after = read(&kept);
    assert_eq!(after["right"]["offset_s"], last["offset_s"]);
    let again = workshop.lines([text(left), text(&shifted)], &options);
    let first = &self::offsets(&again)[0];
    let [first_s, last_s] = [first, last].map(|told| told["offset_s"].as_f64().unwrap());
    assert!((first_s - last_s).abs() < 1e-9, "{first} {last}");
    assert!(used_together(&again) > used_together(&lines));
}

fn offsets(lines: &[Value]) -> Vec<Value> {
    let offsets = lines.iter().filter(|line| line["event"] == "offset");
    offsets.cloned().collect()
}

/// Number of answers from both views.
fn used_together(lines: &[Value]) -> usize {
    let both = |line: &&Value| {
        line["views"]
            .as_array()
            .is_some_and(|views| views.len() == 2)
    };
    lines.iter().filter(both).count()
}

fn read(path: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}
