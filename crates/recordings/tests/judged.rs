//! Recordings of computed arrivals with known faults: what the judge put in comes out.

use std::fs;
use std::path::Path;

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
    import(&folder.join("tower/recording.toml"), &folder.join("corpus")).unwrap()
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
            ("/pan_tilt_deg/worst_pan", 0.03),
            ("/pan_tilt_deg/worst_tilt", 0.03),
            ("/labels_m/median", 25.0),
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

#[test]
fn local_time_is_corrected_and_named() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    recording(folder, "rtk 4 3 2 1 --calibrated");
    let path = folder.join("tower/camera0.csv");
    let table = fs::read_to_string(&path).unwrap();
    let shifted = table.lines().map(|line| {
        let time_s = line
            .split_once(',')
            .map(|(time, rest)| (time.parse::<f64>(), rest));
        match time_s {
            Some((Ok(time_s), rest)) => format!("{:.4},{rest}", time_s + 28_800.0),
            _ => line.to_owned(),
        }
    });
    fs::write(&path, shifted.collect::<Vec<_>>().join("\n")).unwrap();
    let outcome = imported(folder);
    assert!(
        (-28_831.0..-28_769.0).contains(&outcome.cameras[0].offset_s),
        "{outcome:#?}"
    );
    assert_eq!(outcome.refused, []);
}
