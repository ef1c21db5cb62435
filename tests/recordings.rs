//! Recordings that no simulator made: every verb reads the imported corpus, and wrong input is named.

use std::fs;
use std::path::Path;

use serde_json::Value;
use testkit::TINY_TRAINING;
use testkit::command::{Dtd, Ending};
use testkit::judged;

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));
const JUDGE: &str = "recorded_arrivals.py";

/// A recording of the judge in `folder/tower`.
fn recording(folder: &Path, arguments: &str) {
    let tower = folder.join("tower").display().to_string();
    let arguments = format!("make {tower} {arguments}");
    judged(JUDGE, &arguments.split(' ').collect::<Vec<_>>());
}

fn import(folder: &Path) -> Value {
    let [recording, corpus] =
        ["tower/recording.toml", "corpus"].map(|name| folder.join(name).display().to_string());
    DTD.json(&["import", &recording, "--out", &corpus, "--json"])
}

#[test]
fn every_verb_reads_an_imported_corpus() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    recording(folder, "rtk 1 10 2 1 --calibrated");
    let outcome = import(folder);
    assert_eq!(outcome["refused"], serde_json::json!([]), "{outcome:#}");
    // As an import leaves it that is killed just after its corpus has appeared.
    let left = folder.join("corpus.partial");
    fs::create_dir(&left).unwrap();
    fs::write(left.join("claim"), "").unwrap();
    DTD.command(&["import", "tower/recording.toml", "--out", "corpus"])
        .current_dir(folder)
        .ends_with(2, &["is there already"]);
    assert!(!left.exists());
    let run = |arguments: &str| {
        let arguments: Vec<&str> = arguments.split(' ').collect();
        DTD.command(&arguments).current_dir(folder).succeeds()
    };
    let verified = run("verify corpus");
    let said = String::from_utf8_lossy(&verified.stdout).into_owned()
        + &String::from_utf8_lossy(&verified.stderr);
    assert!(said.contains("recorded scenarios have none"), "{said}");
    assert!(String::from_utf8_lossy(&run("status corpus").stdout).contains("10 of 10 recorded"));
    run("label corpus");
    fs::write(folder.join("train.toml"), TINY_TRAINING).unwrap();
    run("train corpus --config train.toml --out run");
    let figures = run("evaluate run --corpus corpus --json");
    let figures: Value = serde_json::from_slice(&figures.stdout).unwrap();
    let text = figures.to_string();
    assert!(text.contains("inverse_range_filtered"), "{text}");
    run("predict run --corpus corpus --out predictions.parquet");
    DTD.command(&["export", "corpus", "--to", "coco", "--out", "coco"])
        .current_dir(folder)
        .ends_with(2, &["imported from tables", "Parquet"]);
}

#[test]
fn mistakes_are_named_with_file_line_and_remedy_and_leave_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    recording(folder, "rtk 3 2 2 1 --calibrated");
    let tower = folder.join("tower");
    let file = tower.join("recording.toml");
    let sound = fs::read_to_string(&file).unwrap();
    let [recording, corpus] =
        [&file, &folder.join("corpus")].map(|path| path.display().to_string());
    let fails = |code: i32, words: &[&str]| {
        DTD.ends_with(&["import", &recording, "--out", &corpus], code, words);
        let left = ["corpus", "corpus.partial"].map(|name| folder.join(name).exists());
        assert_eq!(left, [code != 2, false], "{words:?}");
    };
    let cases: [(&str, &str, &[&str]); 12] = [
        (
            "name = \"camera1\"",
            "name = \"camera0\"",
            &["recording.toml:", "is named twice"],
        ),
        (
            "width_px = 1920",
            "width_px = 1280",
            &[
                "calibration.json",
                "1920 x 1280 px, expected 1280 x 1280 px",
            ],
        ),
        (
            "boxes = \"camera0.csv\"",
            "boxs = \"camera0.csv\"",
            &["recording.toml:", "boxs"],
        ),
        (
            "clock_sd_s = 15.0",
            "time = \"mars\"",
            &["time", "expected \"utc\", \"gps\" or local time"],
        ),
        ("EGM2008", "foo", &["geoid", "such as EGM96 or EGM2008"]),
        (
            "clock_sd_s = 15.0",
            "clock_sd_s = 10000",
            &[
                "clock_sd_s",
                "expected a standard deviation in seconds from 0 to 600",
            ],
        ),
        (
            "clock_sd_s = 15.0",
            "images_per_s = inf",
            &["images_per_s", "inf is out of range"],
        ),
        (
            "position_sd_m = 0.05",
            "position_sd_m = -1.0",
            &["position_sd_m", "-1 is out of range"],
        ),
        (
            "position_sd_m = 0.05",
            "delay_sd_s = -1.0",
            &["delay_sd_s", "-1 is out of range"],
        ),
        (
            "width_px = 1920",
            "width_px = 0",
            &["width_px", "expected a size of an image"],
        ),
        ("WSSS/02L", "WSSS/20R", &["refused"]),
        (
            "runway = \"WSSS/02L\"",
            "runway = \"02L\"",
            &["expected airport and runway"],
        ),
    ];
    for (from, to, words) in cases {
        fs::write(&file, sound.replacen(from, to, 1)).unwrap();
        if to.contains("20R") {
            fails(2, &[]);
        } else {
            fails(2, words);
        }
    }
    fs::write(&file, &sound).unwrap();

    // One camera's table is of another resolution: the other camera is used.
    let boxes = fs::read_to_string(tower.join("camera1.csv")).unwrap();
    let columns = boxes.lines().next().unwrap_or_default();
    assert_eq!(columns, "time,cx,cy,width,height,score");
    for (row, words) in [
        ("1772352100.0,500.0,300.0,40.0,20.0,87", "percentages"),
        ("1e300,500.0,300.0,40.0,20.0,0.9", "not a time"),
        (
            "1772352100.0,5000.0,300.0,40.0,20.0,0.9",
            "another resolution",
        ),
    ] {
        let _ = fs::remove_dir_all(folder.join("corpus"));
        fs::write(tower.join("camera1.csv"), format!("{boxes}{row}\n")).unwrap();
        fails(3, &["camera camera1", "camera1.csv", "line ", words]);
    }

    // Latitude and longitude of a track are swapped.
    let _ = fs::remove_dir_all(folder.join("corpus"));
    let swapped = sound.replace(
        "latitude = \"lat\", longitude = \"lon\"",
        "latitude = \"lon\", longitude = \"lat\"",
    );
    fs::write(&file, swapped).unwrap();
    fs::write(tower.join("camera1.csv"), &boxes).unwrap();
    fails(2, &["latitude and longitude are swapped"]);
}
