//! Recordings of computed arrivals with known faults: what the judge put in comes out.

use std::fs;
use std::path::Path;

use dataset::work::watch::Silent;
use recordings::{ImportOutcome, import};
use serde_json::Value;
use testkit::judged;

const JUDGE: &str = "recorded_arrivals.py";

/// Makes a recording in `folder/tower`.
fn recording(folder: &Path, arguments: &str) {
    let tower = folder.join("tower").display().to_string();
    let arguments = format!("make {tower} {arguments}");
    judged(JUDGE, &arguments.split(' ').collect::<Vec<_>>());
}

fn imported(folder: &Path) -> ImportOutcome {
    let no_videos = || unreachable!("only videos need a detector");
    let [recording, corpus] = ["tower/recording.toml", "corpus"].map(|name| folder.join(name));
    import(&recording, &corpus, no_videos, &Silent).unwrap()
}

fn verdict(folder: &Path) -> Value {
    let [tower, corpus] = ["tower", "corpus"].map(|name| folder.join(name).display().to_string());
    let verdict = judged(JUDGE, &["judge", &tower, &corpus]);
    println!("{verdict:#}");
    verdict
}

/// Checks figures of a verdict against their ceilings.
fn within(verdict: &Value, ceilings: &[(&str, f64)]) {
    for (path, most) in ceilings {
        let found = verdict.pointer(path).and_then(Value::as_f64);
        let found = found.unwrap_or_else(|| panic!("no {path} in {verdict:#}"));
        assert!(
            found <= *most,
            "{path}, expected at most {most}: {verdict:#}"
        );
    }
}

#[test]
fn guessed_cameras_and_surveillance_are_aligned_and_labelled() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    recording(folder, "adsb 1 10 2 1");
    let outcome = imported(folder);
    println!("{outcome:#?}");
    let verdict = verdict(folder);
    within(
        &verdict,
        &[
            ("/clock_to_track_s/worst_over_stated", 3.0),
            ("/clock_to_track_s/median", 0.1),
            ("/pan_tilt_deg/worst_pan", 0.03),
            ("/pan_tilt_deg/worst_tilt", 0.03),
            ("/focal_pct/worst", 0.7),
            ("/labels_m/median", 10.0),
        ],
    );
}

#[test]
fn exact_tracks_and_calibrated_cameras_give_clocks_within_ten_milliseconds_in_the_median() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    recording(folder, "rtk 2 4 3 2 --calibrated");
    let outcome = imported(folder);
    println!("{outcome:#?}");
    assert!(
        outcome
            .cameras
            .iter()
            .all(|camera| camera.residual_px <= 2.0)
    );
    let verdict = verdict(folder);
    within(
        &verdict,
        &[
            ("/clock_to_track_s/median", 0.01),
            ("/clock_to_track_s/worst_over_stated", 3.0),
            ("/labels_m/median", 1.0),
        ],
    );
}

/// Rewrites a file of the recording.
fn rewrite(folder: &Path, name: &str, by: impl Fn(&str) -> String) {
    let path = folder.join("tower").join(name);
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, by(&text)).unwrap();
}

/// Adds seconds to the times in a table's first column.
fn later(table: &str, by_s: f64) -> String {
    let row = |line: &str| match line.split_once(',') {
        Some((time, rest)) if time.parse::<f64>().is_ok() => {
            format!("{:.4},{rest}\n", time.parse::<f64>().unwrap() + by_s)
        }
        _ => format!("{line}\n"),
    };
    table.lines().map(row).collect()
}

#[test]
fn local_time_of_cameras_and_of_tracks_is_corrected_and_named() {
    for (tables, expected) in [
        (
            &["camera0.csv", "camera1.csv"][..],
            "local time instead of UTC (+8.0 h)",
        ),
        (
            &["tracks.csv"],
            "tracks in local time instead of UTC (+8.0 h)",
        ),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        recording(folder, "rtk 4 3 2 1 --calibrated");
        for table in tables {
            rewrite(folder, table, |table| later(table, 28_800.0));
        }
        let outcome = imported(folder);
        let causes = outcome
            .cameras
            .iter()
            .map(|camera| camera.likely_cause.as_deref());
        assert_eq!(
            causes.collect::<Vec<_>>(),
            [Some(expected); 2],
            "{outcome:#?}"
        );
        assert_eq!(outcome.refused, []);
    }
}

#[test]
fn a_flight_in_two_files_counts_once_and_mixed_numbers_of_tracks_do_not_count() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    recording(folder, "rtk 5 3 2 1 --calibrated");
    let sound = imported(folder);
    fs::remove_dir_all(folder.join("corpus")).unwrap();
    fs::copy(
        folder.join("tower/tracks.csv"),
        folder.join("tower/again.csv"),
    )
    .unwrap();
    rewrite(folder, "recording.toml", |text| {
        let (_, track) = text.split_once("[[track]]").unwrap();
        format!(
            "{text}\n[[track]]{}",
            track.replace("tracks.csv", "again.csv")
        )
    });
    // Another separator, and one number for all aircraft.
    rewrite(folder, "camera0.csv", |text| {
        let rows = text.lines().enumerate().map(|(number, line)| {
            let track = if number == 0 { "track" } else { "7" };
            format!("{};{track}\n", line.replace(',', ";"))
        });
        rows.collect()
    });
    let outcome = imported(folder);
    assert_eq!(outcome.scenarios.len(), 3, "{outcome:#?}");
    assert_eq!(outcome.cameras[0].matched, sound.cameras[0].matched);
    let same = outcome
        .refused
        .iter()
        .filter(|of| of.reason.contains("is the same flight as"));
    assert_eq!(same.count(), 3, "{outcome:#?}");
}

#[test]
fn a_camera_that_is_not_where_it_is_stated_is_refused_with_the_likely_cause() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    recording(folder, "adsb 6 6 2 1");
    let sound = imported(folder);
    assert!(
        sound.cameras.iter().all(|camera| camera.doubts.is_empty()),
        "{sound:#?}"
    );
    let stated = |key: &str, by: &dyn Fn(f64) -> f64| {
        fs::remove_dir_all(folder.join("corpus")).unwrap();
        let kept = fs::read_to_string(folder.join("tower/recording.toml")).unwrap();
        let first = kept.lines().find(|line| line.starts_with(key)).unwrap();
        let value: f64 = first.split_once(" = ").unwrap().1.parse().unwrap();
        let changed = kept.replacen(first, &format!("{key} = {}", by(value)), 1);
        fs::write(folder.join("tower/recording.toml"), changed).unwrap();
        let outcome = imported(folder);
        fs::write(folder.join("tower/recording.toml"), kept).unwrap();
        println!("{outcome:#?}");
        assert_eq!(outcome.cameras.len(), 1);
        outcome
            .refused
            .into_iter()
            .map(|of| of.reason)
            .collect::<Vec<_>>()
            .join("\n")
    };
    let said = stated("altitude_m", &|metres| metres / 0.3048);
    assert!(said.contains("is its altitude in feet"), "{said}");
    let said = stated("latitude_deg", &|degrees| degrees + 0.003);
    assert!(said.contains("its place"), "{said}");
}

#[test]
fn boxes_in_parts_of_the_image_and_of_smaller_images_are_named() {
    for (scale, words) in [(0.0005, "parts of the image"), (0.5, "another resolution")] {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        recording(folder, "rtk 7 3 2 1 --calibrated");
        rewrite(folder, "camera0.csv", |text| {
            let scaled = |(column, cell): (usize, &str)| match cell.parse::<f64>() {
                Ok(number) if (1..5).contains(&column) => format!("{}", number * scale),
                _ => cell.to_owned(),
            };
            let row = |line: &str| {
                line.split(',')
                    .enumerate()
                    .map(scaled)
                    .collect::<Vec<_>>()
                    .join(",")
            };
            text.lines().map(|line| row(line) + "\n").collect()
        });
        let outcome = imported(folder);
        assert_eq!(outcome.cameras.len(), 1, "{outcome:#?}");
        assert!(
            outcome.refused.iter().any(|of| of.reason.contains(words)),
            "{outcome:#?}"
        );
    }
}
