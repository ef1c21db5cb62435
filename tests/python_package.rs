//! The Python package in `python/`, on a corpus of three views that was just recorded: a lens, refraction and 10000/1001 images a
//! second. Cameras and pixels are judged against this project's own, samples against torch's own loaders.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use dataset::corpus::Corpus;
use dataset::geometry::geodesy::Geodetic;
use serde_json::{Value, json};
use testkit::command::{Dtd, Ending, said, text};
use testkit::files::{contents, copy_folder};
use testkit::sweep::THREE_VIEWS;
use testkit::{program_of_venv, python_with_torch, repository, skipped};

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));
/// An image away from key frames.
const TICK: usize = 47;

/// A flight to learn from, and one to judge by.
const SPLIT: &str = "
[split]
train = 0.5
validation = 0
test = 0.5
";

/// Points around the path as projected by this project's camera, and a decoded image.
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
    // The notebook learns from ticks beyond 1 NM.
    let further = THREE_VIEWS
        .replace("dtd_nm = 0.5", "dtd_nm = 1.5")
        .replace("30000/1001", "10000/1001");
    assert!(further.contains("1.5") && further.contains("10000/1001"));
    let folder = DTD.recorded(&format!("{further}{SPLIT}"));
    let corpus = folder.path().join("corpus");
    let judged = folder.path().join("expected.json");
    fs::write(&judged, expected(&corpus).to_string()).unwrap();
    let python = repository().join("python");
    let run = |program: PathBuf, arguments: &[&str]| {
        let output = Command::new(program)
            .args(arguments)
            .current_dir(&python)
            .env("PYTHONPATH", &python)
            .env("PYTHONDONTWRITEBYTECODE", "1")
            // If a worker crashes, it says where.
            .env("PYTHONFAULTHANDLER", "1")
            .env("DTD_CORPUS", &corpus)
            .env("DTD_EXPECTED", &judged)
            .succeeds();
        assert!(!said(&output).contains("skipped"), "{}", said(&output));
        output
    };
    let tests = ["-W", "error", "-m", "unittest", "discover", "-v", "-s"];
    run(
        program_of_venv("python"),
        &[&tests[..], &["tests"]].concat(),
    );
    run(python_with_torch(), &["tests/torch_loader.py"]);

    let judge = repository().join("tests/judges/notebook.py");
    let notebook = [text(&judge), "approach.ipynb", "error_percent"];
    let ran = testkit::command::json(&run(program_of_venv("python"), &notebook));
    assert_eq!(ran["figures"], 3);
    let errors = ran["held"]["error_percent"].as_array().unwrap();
    let mut errors: Vec<f64> = errors.iter().map(|error| error.as_f64().unwrap()).collect();
    errors.sort_by(f64::total_cmp);
    assert!(errors.len() > 100, "{errors:?}");
    assert!(errors[errors.len() / 2] < 0.1, "{errors:?}");
}

#[test]
fn installing_the_package_leaves_nothing_in_the_checkout() {
    let python = program_of_venv("python");
    let has_backend = Command::new(&python)
        .args(["-c", "import flit_core"])
        .status()
        .unwrap();
    if !has_backend.success() {
        return skipped("flit_core is not installed; run `bash scripts/setup.sh`");
    }
    let folder = tempfile::tempdir().unwrap();
    let sources = folder.path().join("python");
    copy_folder(&repository().join("python"), &sources);
    let before = contents(&sources);
    let installed = folder.path().join("installed");
    Command::new(&python)
        .args([
            "-m",
            "pip",
            "install",
            "--quiet",
            "--no-index",
            "--no-deps",
            "--no-build-isolation",
            "--target",
        ])
        .arg(&installed)
        .arg(&sources)
        .succeeds();
    assert!(installed.join("dtd/py.typed").is_file());
    assert!(contents(&sources) == before, "something is left");
}
