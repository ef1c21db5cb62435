//! The Python package in `python/`, on a corpus of three views that was just recorded: a lens, refraction and 30000/1001 pictures a
//! second. Cameras and pixels are judged against this project's own.

use std::fs;
use std::path::Path;
use std::process::Command;

use dataset::corpus::Corpus;
use dataset::geodesy::Geodetic;
use serde_json::{Value, json};
use testkit::command::{Dtd, said, text};
use testkit::{program_of_venv, repository};

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));
/// A picture away from key frames.
const TICK: usize = 47;

const SWEEP: &str = r#"
[corpus]
name = "python"
seed = 3

[approach]
airport = "WSSS"
runway = "02L"
aircraft = "B737-800"
rig = "three"

[[rig.three.cameras]]
id = "lens"
beyond_touchdown_m = 1200
right_m = 300
height_m = 40
inward_deg = 3
pitch_deg = 1.5
hfov_deg = 60
distortion = { k1 = -0.25, k2 = 0.06, p1 = 0.001, p2 = -0.0005 }

[[rig.three.cameras]]
id = "mast"
beyond_touchdown_m = 1200
right_m = -300
height_m = 10
inward_deg = 0
pitch_deg = 1.6
hfov_deg = 20

[[rig.three.cameras]]
id = "tower_2"
beyond_touchdown_m = 900
right_m = 500
height_m = 60
inward_deg = 20
pitch_deg = 0
hfov_deg = 40

[grid]
times = ["12:00"]
weathers = ["clear"]
repeats = 2
day_of_year = 172
utc_offset_h = 8

[imaging]
refraction_coefficient = 0.13

[picture]
width_px = 160
height_px = 96
frame_rate = "30000/1001"

[start]
dtd_nm = 0.5
speed_mps = 72
profiles = ["short"]

[profile.short]
kind = "glide_path"
level_altitude_msl_m = 200

[weather.clear]
visibility_m = 80000
wind_speed_mps = 2
wind_from_true_deg = 20
"#;

/// Where this project's own camera sees points around the path, and a decoded picture.
fn expected(corpus: &Path) -> Value {
    let corpus = Corpus::open(corpus).unwrap();
    let scenario = corpus.scenarios().unwrap().remove(0).open().unwrap();
    let calibration = scenario.calibration().unwrap();
    let frames = scenario.frames().unwrap();
    let here = frames.rows[0].pose.position();
    let points: Vec<Geodetic> = (0..40)
        .map(|k| Geodetic {
            altitude_msl_m: here.altitude_msl_m + 20.0 * f64::from(k),
            latitude_deg: here.latitude_deg - 0.004 * f64::from(k),
            longitude_deg: here.longitude_deg + 0.003 * f64::from(k % 7),
        })
        .collect();
    let mut cameras = serde_json::Map::new();
    for (view, entry) in &calibration.cameras {
        let camera = entry.camera();
        let pixels: Vec<Value> = points
            .iter()
            .map(|point| match camera.project(point.to_ecef()) {
                Some(pixel) => json!([pixel.x, pixel.y]),
                None => Value::Null,
            })
            .collect();
        cameras.insert(view.clone(), pixels.into());
    }
    let points: Vec<Value> = points
        .iter()
        .map(|point| {
            json!([
                point.latitude_deg,
                point.longitude_deg,
                point.altitude_msl_m
            ])
        })
        .collect();
    let mut reader = scenario.open_video("mast").unwrap();
    let mut rgb = Vec::new();
    for _ in 0..=TICK {
        reader.next_frame(&mut rgb).unwrap().unwrap();
    }
    json!({
        "scenario": scenario.id(),
        "ticks": frames.rows.len(),
        "points": points,
        "cameras": cameras,
        "tick": TICK,
        "picture": rgb,
    })
}

#[test]
fn the_package_reads_tables_cameras_and_pictures_as_this_project_does() {
    let folder = tempfile::tempdir().unwrap();
    let (sweep, corpus) = (
        folder.path().join("three.toml"),
        folder.path().join("corpus"),
    );
    fs::write(&sweep, SWEEP).unwrap();
    for arguments in [
        &["generate", text(&sweep), "--out", text(&corpus)][..],
        &["label", text(&corpus)],
    ] {
        let output = DTD.run(arguments);
        assert!(output.status.success(), "{}", said(&output));
    }
    let judged = folder.path().join("expected.json");
    fs::write(&judged, expected(&corpus).to_string()).unwrap();
    let python = repository().join("python");
    let output = Command::new(program_of_venv("python"))
        .args([
            "-W", "error", "-m", "unittest", "discover", "-v", "-s", "tests",
        ])
        .current_dir(&python)
        .env("PYTHONPATH", &python)
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .env("DTD_CORPUS", &corpus)
        .env("DTD_EXPECTED", &judged)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", said(&output));
    assert!(!said(&output).contains("skipped"), "{}", said(&output));
}
