//! Clocks of two files that began at different times.

use std::fs;

use serde_json::{Value, json};
use testkit::command::{Ending, text};

use crate::workshop::{Workshop, ffmpeg};

/// The second file begins so much later.
const SHIFT_S: f64 = 0.4;

#[test]
fn a_kept_offset_joins_two_files_from_the_start_and_without_one_the_first_answers_alone() {
    let workshop = Workshop::shared();
    let [left, right] = workshop.flight();
    let shifted = workshop.folder.path().join("right-shifted.mp4");
    let shift = format!("{SHIFT_S}");
    let arguments = ["-itsoffset", &shift, "-i", text(right), "-c", "copy"];
    let timescale = ["-video_track_timescale", "90000", text(&shifted)];
    ffmpeg(&[&arguments[..], &timescale].concat());
    let sources = [text(left), text(&shifted)];
    let options = ["--as-fast-as-possible", "--offset", "right=auto"];
    let lines = workshop.lines(sources, &options);
    assert_eq!(
        told_offset(&lines),
        Some(Value::Null),
        "nobody knows it yet"
    );
    let kept = workshop.folder.path().join("offsets.json");
    let offset =
        json!({"offset_s": -SHIFT_S, "sd_s": 0.005, "drift_ppm": 0.0, "drift_sd_ppm": 10.0});
    let known =
        json!({"run": lines[0]["run"], "views": {"right": {"sources": sources, "offset": offset}}});
    fs::write(&kept, known.to_string()).unwrap();
    let options = [&options[..], &["--keep-offsets", text(&kept)]].concat();
    let again = workshop.lines(sources, &options);
    let found_s = told_offset(&again).unwrap().as_f64().unwrap();
    assert!((found_s + SHIFT_S).abs() < 1e-9, "{found_s}");
    let together = [&lines, &again].map(|lines| used_together(lines));
    assert!(together[1] > together[0] + 50, "{together:?}");
    // The cameras changed places.
    let swapped = [sources[1], sources[0]];
    workshop
        .command(swapped)
        .args(&options)
        .ends_with(2, &["remove this one"]);
}

/// The first offset that is told.
fn told_offset(lines: &[Value]) -> Option<Value> {
    let told = lines.iter().find(|line| line["event"] == "offset")?;
    Some(told["offset_s"].clone())
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
