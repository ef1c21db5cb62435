//! The whole pipeline over real sockets: stand-in, generator, labels, detections, training, evaluation; checked from outside.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;

use dataset::tables::frames::Frames;
use serde_json::Value;
use testkit::command::{Dtd, Ending, json, text};
use testkit::files::{contents, copy_folder};
use testkit::{MadeOnce, program_of_venv, repository};

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

/// A labelled corpus with six scenarios.
fn make(sweep: &str, folder: &Path) {
    let corpus = folder.join("corpus");
    let made = DTD.json(&["generate", sweep, "--out", text(&corpus), "--json"]);
    assert_eq!(made["committed"].as_array().unwrap().len(), 6, "{made}");
    assert_eq!(made["failed"], serde_json::json!([]));
    let labelled = DTD.json(&["label", text(&corpus), "--json"]);
    let count = labelled["labelled"].as_array().unwrap().len();
    assert_eq!(count, 6, "{labelled}");
}

/// Six recorded flights in tiny images.
fn recorded() -> PathBuf {
    static MADE: LazyLock<MadeOnce> = LazyLock::new(|| {
        MadeOnce::made("recorded", |folder| {
            make("tests/data/recorded.toml", folder);
        })
    });
    MADE.path().join("corpus")
}

/// Six approaches in full resolution at a low frame rate.
fn full_size() -> PathBuf {
    static MADE: LazyLock<MadeOnce> =
        LazyLock::new(|| MadeOnce::made("chain", |folder| make("tests/data/chain.toml", folder)));
    MADE.path().join("corpus")
}

/// A recording of a scenario's videos, its cameras and its track, by clocks that the import has to find.
fn recording(scenario: &Path, folder: &Path) -> PathBuf {
    const START_UTC_S: f64 = 1_780_293_600.0;
    let frames = Frames::read(&scenario.join("frames.parquet")).unwrap();
    let mut track = "time,latitude,longitude,altitude_m\n".to_owned();
    for row in &frames.rows {
        let time_s = START_UTC_S + row.time_ns as f64 / 1e9;
        let (at, above_m) = (row.pose, row.pose.altitude_msl_m);
        track += &format!(
            "{time_s},{:.9},{:.9},{above_m:.3}\n",
            at.latitude_deg, at.longitude_deg
        );
    }
    fs::write(folder.join("track.csv"), track).unwrap();
    fs::copy(
        scenario.join("calibration.json"),
        folder.join("calibration.json"),
    )
    .unwrap();
    let mut recording = "name = \"tower\"\nrunway = \"WSSS/02L\"\n".to_owned();
    for (view, first_image) in [
        ("left", "2026-06-01T06:00:02Z"),
        ("right", "2026-06-01T05:59:59.500Z"),
    ] {
        let video = scenario.join("views").join(format!("{view}.mp4"));
        recording += &format!(
            "[[camera]]\nname = \"{view}\"\nwidth_px = 1920\nheight_px = 1280\ncalibration = \"calibration.json\"\n\
             videos = [{{ file = {video:?}, first_image = \"{first_image}\" }}]\n"
        );
    }
    recording += "[[track]]\nfile = \"track.csv\"\nposition_sd_m = 0.05\n\
        columns = { time = \"time\", latitude = \"latitude\", longitude = \"longitude\", altitude_m = \"altitude_m\" }\n";
    let file = folder.join("recording.toml");
    fs::write(&file, recording).unwrap();
    file
}

#[test]
fn videos_with_wrong_clocks_and_a_track_become_a_corpus_with_the_same_distances() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = full_size().join("scenarios/0800-clear-r1");
    let file = recording(&scenario, folder.path());
    let corpus = folder.path().join("imported");
    let made = DTD.json(&["import", text(&file), "--out", text(&corpus), "--json"]);
    assert_eq!(made["refused"], serde_json::json!([]), "{made}");
    for (camera, off_s) in [(0, -2.0), (1, 0.5)] {
        let found_s = made["cameras"][camera]["offset_s"].as_f64().unwrap();
        // The boxes' centres are some metres from the tracked point, which looks like a tenth of a second.
        assert!((found_s - off_s).abs() < 0.15, "{made}");
    }
    let id = made["scenarios"][0].as_str().unwrap();
    let imported = Frames::read(&corpus.join("scenarios").join(id).join("frames.parquet")).unwrap();
    let recorded = Frames::read(&scenario.join("frames.parquet")).unwrap();
    let distances = |frames: &Frames| -> Vec<f64> {
        let labels = frames
            .rows
            .iter()
            .map(|row| row.labels.as_ref().unwrap().dtd_m);
        labels.filter(|dtd_m| *dtd_m > 2_000.0).collect()
    };
    let (found, expected) = (distances(&imported), distances(&recorded));
    assert!(
        found.len() + 3 >= expected.len(),
        "{} of {}",
        found.len(),
        expected.len()
    );
    for dtd_m in &found {
        let nearest = expected.iter().map(|other| (other - dtd_m).abs());
        let nearest = nearest.fold(f64::INFINITY, f64::min);
        assert!(
            nearest < 10.0,
            "{dtd_m} m is {nearest} m from any of {expected:?}"
        );
    }
    let again = DTD.run(&["verify", text(&corpus)]);
    assert!(
        again.status.success(),
        "{}",
        String::from_utf8_lossy(&again.stdout)
    );
}

/// Runs a Python check on a corpus; returns its result.
fn judge(script: &str, corpus: &Path) -> Value {
    let output = Command::new(program_of_venv("python"))
        .arg(repository().join("tests/judges").join(script))
        .arg(corpus)
        .succeeds();
    json(&output)
}

#[test]
fn dtd_labels_of_the_recorded_flights_agree_with_geographiclib_to_a_millimetre() {
    let verdict = judge("geodesic_dtd.py", &recorded());
    assert_eq!(verdict["scenarios"], 6);
    assert!(verdict["rows"].as_u64().unwrap() > 1_000, "{verdict}");
}

#[test]
fn true_boxes_hold_the_aircraft_as_an_independent_projection_sees_it() {
    let verdict = judge("projection.py", &full_size());
    assert!(verdict["boxes"].as_u64().unwrap() > 200, "{verdict}");
}

#[test]
fn a_fresh_corpus_has_no_faults_and_one_picture_per_tick_and_view() {
    for corpus in [recorded(), full_size()] {
        let report = DTD.json(&["verify", text(&corpus), "--json"]);
        assert_eq!(report["findings"], serde_json::json!([]));
        assert_eq!(report["labelled"], 6);
        assert_eq!(
            report["pictures"].as_u64().unwrap(),
            2 * report["ticks"].as_u64().unwrap()
        );
    }
}

fn generated_again(corpus: &Path) -> Value {
    let sweep = "tests/data/recorded.toml";
    DTD.json(&["generate", sweep, "--out", text(corpus), "--json"])
}

#[test]
fn generating_and_labelling_again_changes_no_byte() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = folder.path().join("corpus");
    copy_folder(&recorded(), &corpus);
    let before = contents(&corpus);
    let again = generated_again(&corpus);
    assert_eq!(again["skipped"].as_array().unwrap().len(), 6, "{again}");
    assert_eq!(again["committed"], serde_json::json!([]));
    let again = DTD.json(&["label", text(&corpus), "--json"]);
    assert_eq!(again["unchanged"].as_array().unwrap().len(), 6, "{again}");
    assert!(before == contents(&corpus), "a file changed");
}

#[test]
fn a_scenario_that_is_made_again_has_the_same_bytes_in_its_tables() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = folder.path().join("corpus");
    copy_folder(&recorded(), &corpus);
    let scenario = corpus.join("scenarios/1200-clear-r3");
    let frames = fs::read(scenario.join("frames.parquet")).unwrap();
    let boxes = fs::read(scenario.join("boxes_truth.parquet")).unwrap();
    fs::remove_dir_all(&scenario).unwrap();
    let again = generated_again(&corpus);
    assert_eq!(again["committed"], serde_json::json!(["1200-clear-r3"]));
    DTD.json(&["label", text(&corpus), "--json"]);
    assert!(
        frames == fs::read(scenario.join("frames.parquet")).unwrap(),
        "frames.parquet differs"
    );
    assert!(
        boxes == fs::read(scenario.join("boxes_truth.parquet")).unwrap(),
        "boxes_truth.parquet differs"
    );
}

#[test]
fn the_detector_finds_the_aircraft_and_the_estimators_learn_its_distance() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = folder.path().join("corpus");
    copy_folder(&full_size(), &corpus);
    let detected = DTD.json(&["detect", text(&corpus), "--json"]);
    let truth = &detected["counts"]["against_truth"];
    let [expected, found] = ["expected", "found"].map(|key| truth[key].as_f64().unwrap());
    println!("{found} of {expected} found");
    assert!(found > 0.98 * expected, "{detected}");
    let center_error_px = truth["sum_center_error_px"].as_f64().unwrap() / found;
    println!("boxes {center_error_px:.3} px off");
    assert!(center_error_px < 1.1, "{center_error_px} px");

    let run = folder.path().join("run");
    DTD.json(&[
        "train",
        text(&corpus),
        "--out",
        text(&run),
        "--quick",
        "--json",
    ]);
    let evaluated = DTD.run(&["evaluate", text(&run), "--corpus", text(&corpus), "--json"]);
    let progress = String::from_utf8_lossy(&evaluated.stderr);
    // Two flights, each with all views, with each of them alone, and with views removed at random and in bursts of three lengths.
    let all_done = "evaluate: 14/14 steps";
    assert!(progress.contains(all_done), "{progress}");
    let metrics = json(&evaluated);
    let written: Value =
        serde_json::from_slice(&fs::read(run.join("metrics.json")).unwrap()).unwrap();
    assert_eq!(metrics, written);
    // Measured with seed 0: all 418 boxes found, 0.81 px off, 65 test samples to 10 NM. Below the lower bound an estimator would be
    // better than its method, which is a leak from the training side.
    for (name, measured, lowest, highest) in [
        ("triangulation", "0.081", 0.05, 0.13),
        // Arithmetic of other machines moves it by 0.1 in the demo.
        ("paper_lstm", "1.05", 0.5, 1.6),
        ("inverse_range", "0.014", 0.005, 0.03),
        ("inverse_range_filtered", "0.015", 0.005, 0.03),
        ("inverse_range_smoothed", "0.015", 0.005, 0.03),
        // The cameras are fitted to fewer flights than in the demo.
        ("self_calibrated", "0.020", 0.005, 0.05),
        ("mono_network_box", "0.77", 0.5, 1.6),
        ("mono_network", "3.37", 2.2, 4.5),
        ("mono_pinhole", "3.22", 2.7, 4.2),
    ] {
        let estimator = &metrics["estimators"][name];
        assert_eq!(estimator["samples"], 65, "{name}");
        let found = estimator["mape_pct"].as_f64().unwrap();
        println!("{name}: {found:.3} %, measured before {measured} %");
        assert!(
            (lowest..highest).contains(&found),
            "{name}: {found} %, expected {measured} %"
        );
    }
    let report = fs::read_to_string(run.join("report.html")).unwrap();
    for (name, figures) in metrics["estimators"].as_object().unwrap() {
        let [mape, sd] = ["mape_pct", "sd_pct"].map(|key| figures["dual"][key].as_f64().unwrap());
        assert!(0.0 < mape && 0.0 < sd, "{name}: {figures}");
        // What is before the first row names the best ones.
        let mut rows = report.split("<tr").skip(1);
        let row = rows.find(|row| row.contains(&format!("<code>{name}</code>")));
        let row = row.unwrap_or_else(|| panic!("no row of {name} in the report"));
        for cell in [
            format!(">{mape:.3}<"),
            format!(">{sd:.3}<"),
            ">65<".to_owned(),
        ] {
            assert!(row.contains(&cell), "{name}: no {cell} in {row}");
        }
    }
    // Of the best, the typical and the worst tick; a view may have seen nothing there.
    let pictures = report.matches("<image href=\"data:image/").count();
    assert!((3..=6).contains(&pictures), "{pictures} images");
    assert_eq!(report.matches("<svg").count(), 4 + pictures, "plots");
    let place = |words: &str| report.find(words).unwrap_or_else(|| panic!("no {words:?}"));
    assert!(place("Recommended: <code>") < place("The best by distance"));
    assert!(place("logarithmic") < place("<table"));
    assert!(
        place("bursts_5_s") < place("bursts_20_s") && place("bursts_20_s") < place("bursts_60_s")
    );
    // Every estimator has a row by weather, by time and while views fail, and the oracle is explained.
    let condition_tables =
        &report[place("<h2>By weather and time of day</h2>")..place("<h2>Spread of the error")];
    for name in metrics["estimators"].as_object().unwrap().keys() {
        let row = format!("<td class=\"word\"><code>{name}</code>");
        assert_eq!(condition_tables.matches(&row).count(), 3, "{name}");
    }
    place("The oracle is no competitor.");
    assert!(report.matches("<rect").count() > 20, "empty plots");
    // The name of SVG's vocabulary is no address: nothing is loaded from it.
    let report = report.replace("http://www.w3.org/2000/svg", "");
    for words in ["http:", "https:", "=\"//", "<link", "@import"] {
        assert!(!report.contains(words), "not self-contained: {words:?}");
    }
}
