//! `dtd estimate`: recordings against `dtd predict --online`, a real RTSP server with faults, signals, and refused input.

#[path = "estimate/clocks.rs"]
mod clocks;
#[path = "estimate/faults.rs"]
mod faults;
#[path = "estimate/hostile.rs"]
mod hostile;
#[path = "estimate/refusals.rs"]
mod refusals;
#[path = "estimate/running.rs"]
mod running;
#[path = "estimate/server.rs"]
mod server;
#[path = "estimate/streams.rs"]
mod streams;
#[path = "estimate/workshop.rs"]
mod workshop;

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use dataset::tables::columns::Table;
use rustix::process::Signal;
use serde_json::Value;
use testkit::command::text;

use self::running::Running;
use self::workshop::{DTD, Workshop, videos};

/// The distances of arrivals by time in milliseconds.
fn distances(lines: &[Value]) -> BTreeMap<i64, f64> {
    let answers = lines.iter().filter(|line| line["phase"] == "arrival");
    let known = answers.filter_map(|line| {
        let time_ms = (line["time_s"].as_f64()? * 1e3).round() as i64;
        Some((time_ms, line["dtd_m"].as_f64()?))
    });
    known.collect()
}

#[test]
fn a_recording_gives_what_predict_gives_online_from_the_corpus_and_from_its_videos() {
    let workshop = Workshop::shared();
    let table = workshop.folder.path().join("online.parquet");
    DTD.succeeds(&[
        "predict",
        text(&workshop.run()),
        "--corpus",
        text(&workshop.corpus()),
        "--online",
        "--out",
        text(&table),
    ]);
    let table = Table::read(&table, 10_000).unwrap();
    let ids = table.text("scenario").unwrap();
    let times_ns = table.i64("time_ns").unwrap();
    let source = workshop.source();
    let scenario = &workshop.scenarios()[0];
    let lines = workshop.lines([&source, &source], &["--as-fast-as-possible"]);
    assert_eq!(lines[0]["event"], "start");
    assert_eq!(lines[0]["run"].as_str().unwrap().len(), 64);
    assert_eq!(lines.last().unwrap()["event"], "end");
    let estimator = lines[0]["estimator"].as_str().unwrap();
    let expected = table.optional_f64(&format!("{estimator}_dtd_m")).unwrap();
    let found = distances(&lines);
    let mut compared = 0;
    for ((id, time_ns), expected_m) in ids.iter().zip(&times_ns).zip(expected) {
        let Some(expected_m) = expected_m.filter(|_| id == scenario) else {
            continue;
        };
        let found_m = found.get(&(time_ns / 1_000_000));
        let found_m = found_m.unwrap_or_else(|| panic!("nothing at {time_ns} ns: {lines:#?}"));
        assert!(
            (found_m / expected_m - 1.0).abs() < 1e-9,
            "{found_m} m, {expected_m} m"
        );
        compared += 1;
    }
    assert!(compared >= 5, "{compared} of {}: {lines:#?}", ids.len());
    let videos = videos(&workshop.corpus());
    let sources = [text(&videos[0]), text(&videos[1])];
    let of_videos = workshop.lines(sources, &["--as-fast-as-possible"]);
    assert_eq!(distances(&of_videos), found);
}

#[test]
fn an_answer_has_the_names_that_scripts_rely_on() {
    let workshop = Workshop::shared();
    let source = workshop.source();
    let lines = workshop.lines([&source, &source], &["--as-fast-as-possible"]);
    let answer = lines.iter().find(|line| line["state"] == "fresh").unwrap();
    let mut names: Vec<&String> = answer.as_object().unwrap().keys().collect();
    names.sort();
    let expected = [
        "age_s",
        "dtd_from_m",
        "dtd_m",
        "dtd_sd_m",
        "dtd_to_m",
        "ground_speed_mps",
        "height_m",
        "latitude_deg",
        "longitude_deg",
        "phase",
        "position_sd_m",
        "state",
        "time_s",
        "time_to_touchdown_s",
        "time_utc",
        "track",
        "views",
    ];
    assert_eq!(names, expected);
    assert_eq!(answer["time_utc"], Value::Null);
    for event in lines.iter().filter(|line| line["event"].is_string()) {
        assert!(
            event["time_s"].is_f64() && event["dtd_m"].is_null(),
            "{event}"
        );
    }
}

#[test]
fn a_signal_ends_it_with_zero_within_two_seconds() {
    let workshop = Workshop::shared();
    let source = workshop.source();
    // Played in its own time, four seconds an image.
    let mut running = Running::start(&mut workshop.command([&source, &source]));
    assert_eq!(running.next()["event"], "start");
    let began = Instant::now();
    running.signal(Signal::TERM);
    assert_eq!(running.last()["cause"], "signal");
    assert!(running.child.wait().unwrap().success());
    assert!(began.elapsed() < Duration::from_secs(2));
}
