//! The command as seen from a shell: plans, bad input, a missing simulator.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;
use testkit::command::{Dtd, words};
use testkit::repository;

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

fn plan_json(sweep: &str) -> Value {
    let output = DTD.run(&["plan", sweep, "--json"]);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    serde_json::from_slice(&output.stdout).unwrap()
}

fn values<'a>(plan: &'a Value, key: &str) -> Vec<&'a str> {
    let scenarios = plan["scenarios"].as_array().unwrap();
    let mut found: Vec<&str> = scenarios.iter().map(|s| s[key].as_str().unwrap()).collect();
    found.sort_unstable();
    found.dedup();
    found
}

#[test]
fn the_papers_corpus_is_one_hundred_scenarios_of_five_times_and_four_weathers() {
    let plan = plan_json("scenarios.toml");
    assert_eq!(plan["scenarios"].as_array().unwrap().len(), 100);
    assert_eq!(
        values(&plan, "time_of_day"),
        ["06:00", "08:00", "12:00", "17:00", "18:00"]
    );
    assert_eq!(
        values(&plan, "weather"),
        ["clear", "cloudy", "foggy", "stormy"]
    );
    assert_eq!(values(&plan, "id").len(), 100);
    assert_eq!(plan, plan_json("scenarios.toml"), "two plans of one file");
}

#[test]
fn a_plan_lists_how_long_each_part_of_the_recording_takes() {
    let estimate = |arguments: &[&str]| {
        let all = [&["plan", "tests/data/small.toml", "--json"], arguments].concat();
        DTD.json(&all)["estimate"].clone()
    };
    let parts = ["pictures", "live_flying", "loading", "weather", "restarts"];
    let x_plane = ["--pictures-per-second", "8", "--restart-every", "1"];
    for arguments in [&["--sim", "mock"][..], &x_plane, &[]] {
        let estimate = estimate(arguments);
        let hours = |part: &str| estimate[format!("{part}_h")].as_f64().unwrap();
        let sum: f64 = parts.iter().map(|part| hours(part)).sum();
        assert!(
            (hours("making") - sum).abs() < 1e-9 && sum > 0.0,
            "{estimate}"
        );
        for part in parts {
            let basis = estimate[format!("{part}_basis")].as_str().unwrap();
            assert!(!basis.is_empty(), "{part}: {estimate}");
        }
        // Three of the six flights are live.
        let is_x_plane = arguments == x_plane;
        assert_eq!(
            hours("live_flying") * 3_600.0 > 150.0,
            is_x_plane,
            "{estimate}"
        );
        assert_eq!(hours("restarts") > 0.0, is_x_plane, "{estimate}");
    }
}

#[test]
fn an_evaluation_is_of_a_run_or_of_a_table_of_predictions() {
    for (arguments, needed) in [
        (
            &["evaluate", "run", "--predictions", "mine.csv"][..],
            "cannot be used with",
        ),
        (
            &["evaluate", "--predictions", "mine.csv", "--detections", "m"],
            "cannot be used with",
        ),
        (&["evaluate"], "RUN|--predictions"),
    ] {
        let output = DTD.run(&[arguments, &["--corpus", "."]].concat());
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(message.contains(needed), "{message}");
    }
}

#[test]
fn the_demo_flies_recorded_flights_in_every_weather_at_three_times() {
    let plan = plan_json("demo.toml");
    let scenarios = plan["scenarios"].as_array().unwrap();
    assert!(scenarios.len() >= 8);
    assert_eq!(values(&plan, "weather").len(), 4);
    assert!(values(&plan, "time_of_day").len() >= 3);
    let recorded = scenarios.iter().filter(|s| s["flight"] != "live").count();
    assert!(recorded >= 2, "{recorded} recorded flights");
    for scenario in scenarios {
        assert!(
            scenario["seed"].is_u64() && scenario["ticks"].as_u64().unwrap() > 100,
            "{scenario}"
        );
    }
}

/// The demo's sweep with one part replaced, in a new folder.
fn broken_demo(folder: &Path, from: &str, to: &str) -> PathBuf {
    let flights = repository().join("tests/data/flights");
    let text = fs::read_to_string(repository().join("demo.toml")).unwrap();
    let text = text.replace("tests/data/flights", flights.to_str().unwrap());
    assert!(text.contains(from), "demo.toml has no {from:?}");
    let path = folder.join("sweep.toml");
    fs::write(&path, text.replacen(from, to, 1)).unwrap();
    path
}

#[test]
fn bad_sweeps_are_refused_with_the_place_and_what_was_expected_and_nothing_is_written() {
    // The original, its replacement, and words that the message must contain.
    let cases = [
        ("repeats = 1", "repeat = 1", vec!["repeat", "repeats"]),
        ("frame_rate = 1", "frame_rate = -1", vec!["-1", "frame"]),
        ("frame_rate = 1", "frame_rate = \"0/1\"", vec!["0/1"]),
        (
            "\"clear\", \"cloudy\"",
            "\"clear\", \"snowy\"",
            vec!["snowy", "foggy"],
        ),
        (
            "airport = \"WSSS\"",
            "airport = \"XXXX\"",
            vec!["XXXX", "WSSS"],
        ),
        ("runway = \"02L\"", "runway = \"99Z\"", vec!["99Z", "02L"]),
        ("01_calm_ils.csv", "01_lost.csv", vec!["01_lost.csv"]),
        ("\"06:00\"", "\"26:00\"", vec!["26:00"]),
        (
            "rig = \"wide-baseline\"",
            "rig = \"narrow\"",
            vec!["narrow", "wide-baseline"],
        ),
        (
            "visibility_m = 80000",
            "visibility_m = -5",
            vec!["-5", "visibility"],
        ),
        (
            "cover_ratio = 0.6",
            "cover_ratio = 1.6",
            vec!["1.6", "0 to 1"],
        ),
        (
            "preset = \"superfast\"",
            "preset = \"warp\"",
            vec!["warp", "superfast"],
        ),
        ("seed = 7", "seed = \"seven\"", vec!["seven", "expected"]),
        (
            "aircraft = \"B737-800\"",
            "aircraft = \"A320\"",
            vec!["A320", "B737-800"],
        ),
    ];
    for (from, to, words) in cases {
        let folder = tempfile::tempdir().unwrap();
        let sweep = broken_demo(folder.path(), from, to);
        let corpus = folder.path().join("corpus");
        let output = DTD.run(&[
            "generate",
            sweep.to_str().unwrap(),
            "--out",
            corpus.to_str().unwrap(),
        ]);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{to}: {message}");
        let place = message
            .split_once("sweep.toml:")
            .and_then(|(_, rest)| rest.split(':').next())
            .and_then(|line| line.parse::<usize>().ok());
        assert!(place.is_some(), "{to}: no line in {message}");
        let line = format!("{} | ", place.unwrap_or_default());
        assert!(
            message.contains(&line) && message.contains(" ^"),
            "{to}: the line is not shown in {message}"
        );
        for word in words {
            assert!(message.contains(word), "{to}: no {word:?} in {message}");
        }
        assert!(!corpus.exists(), "{to}: something was written");
    }
}

#[test]
fn a_plan_of_a_shipped_sweep_fits_into_80_columns() {
    for sweep in ["demo.toml", "scenarios.toml", "paper.toml", "detector.toml"] {
        let output = DTD.run(&["plan", sweep]);
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(text.lines().count() > 20, "{sweep}: {text}");
        for line in text.lines() {
            let columns = line.chars().count();
            assert!(columns <= 80, "{sweep}: {columns} columns: {line}");
        }
    }
}

#[test]
fn a_wrong_call_names_what_is_wrong_once() {
    for (arguments, words) in [
        (
            &["plan", "lost.toml"][..],
            "error: cannot read lost.toml: No such file",
        ),
        (
            &["doctor", "--sweep", "lost.toml"],
            "error: cannot read lost.toml: No such file",
        ),
        (
            &["fetch", "lost", "--out", "x"],
            "it does not begin with a scheme; expected s3://BUCKET/PREFIX",
        ),
        (
            &["mock-xplane", "--plugin", "lost"],
            "--plugin lost: it has no PI_dtd_bridge.py",
        ),
    ] {
        let output = DTD.run(arguments);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
        assert!(message.contains(words), "{arguments:?}: {message}");
    }
}

#[test]
fn what_is_not_there_is_bad_input_with_its_name() {
    let cases: [(&[&str], &str); 6] = [
        (&["plan", "lost.toml"], "lost.toml"),
        (&["label", "lost-corpus"], "lost-corpus"),
        (&["verify", "lost-corpus"], "dtd generate"),
        (&["train", "lost-corpus", "--out", "run"], "lost-corpus"),
        (
            &words("generate demo.toml --out target/x --sim nowhere"),
            "HOST:PORT",
        ),
        (
            &words("generate demo.toml --out target/x --only 0099"),
            "0099",
        ),
    ];
    for (arguments, word) in cases {
        let output = DTD.run(arguments);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
        assert!(message.contains(word), "{arguments:?}: {message}");
    }
}

#[test]
fn a_simulator_that_is_not_there_is_a_failure_that_says_what_to_do() {
    // A port that was free a moment ago.
    let port = std::net::UdpSocket::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap()
        .port();
    let folder = tempfile::tempdir().unwrap();
    let corpus = folder.path().join("corpus");
    let address = format!("127.0.0.1:{port}");
    let output = DTD.run(&[
        "generate",
        "demo.toml",
        "--out",
        corpus.to_str().unwrap(),
        "--sim",
        &address,
    ]);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(
        message.contains(&address) && message.contains("--sim mock"),
        "{message}"
    );
    assert!(!corpus.exists(), "something was written");
}

/// A folder as X-Plane 12 leaves it, with XPPython3.
fn x_plane_folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::create_dir_all(path("Resources/default scenery")).unwrap();
    let xppython3 = path("Resources/plugins/XPPython3/lin_x64");
    fs::create_dir_all(&xppython3).unwrap();
    fs::write(xppython3.join("XPPython3.xpl"), "").unwrap();
    fs::write(
        path("Log.txt"),
        "Log.txt for X-Plane 12.4.0-r2-9b69b91a (build 124210)\n",
    )
    .unwrap();
    folder
}

#[test]
fn the_plugin_goes_into_an_x_plane_folder_and_other_folders_are_bad_input() {
    let folder = x_plane_folder();
    let path = folder.path().to_str().unwrap();
    let output = DTD.run(&["install-plugin", path]);
    let said = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.starts_with("X-Plane 12.4.0"), "{said}");
    assert!(said.contains("Accept incoming connections"), "{said}");
    let installed = folder
        .path()
        .join("Resources/plugins/PythonPlugins/PI_dtd_bridge.py");
    let source = repository().join("xplane-bridge/plugin/PI_dtd_bridge.py");
    assert_eq!(fs::read(installed).unwrap(), fs::read(source).unwrap());

    let output = DTD.run(&["install-plugin", path, "--json"]);
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let files = report["files"].as_array().unwrap();
    assert!(
        files.iter().all(|file| file["change"] == "unchanged"),
        "{report}"
    );

    let elsewhere = tempfile::tempdir().unwrap();
    let output = DTD.run(&["install-plugin", elsewhere.path().to_str().unwrap()]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("is not X-Plane's folder"), "{said}");
}

#[test]
fn an_output_that_is_a_device_a_fifo_or_a_link_to_one_is_refused_before_anything_is_done() {
    let folder = tempfile::tempdir().unwrap();
    let fifo = folder.path().join("fifo");
    assert!(
        Command::new("mkfifo")
            .arg(&fifo)
            .status()
            .unwrap()
            .success()
    );
    let link = folder.path().join("link");
    std::os::unix::fs::symlink("/dev/null", &link).unwrap();
    let before = fs::read_dir(folder.path()).unwrap().count();
    for out in [Path::new("/dev/null"), &fifo, &link] {
        let out = out.to_str().unwrap();
        for verb in [
            &["generate", "demo.toml"][..],
            &["fetch", "file:///nowhere"],
            &["train", "corpus"],
            &["train-detector", "corpus"],
            &["tape", "--sim", "127.0.0.1:49000"],
            &["demo"],
        ] {
            let output = DTD.run(&[verb, &["--out", out]].concat());
            let said = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(2), "{verb:?} {out}: {said}");
            assert!(said.contains("is a device, FIFO or socket"), "{said}");
        }
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), before);
}

#[test]
fn a_demo_refuses_a_sweep_a_model_and_a_folder_that_are_none_before_it_begins() {
    let folder = tempfile::tempdir().unwrap();
    let [out, none, file] =
        ["out", "none", "file"].map(|name| folder.path().join(name).display().to_string());
    fs::write(&file, "").unwrap();
    for (arguments, expected) in [
        (&["--out", &out, "--sweep", &none][..], &*none),
        (&["--out", &out, "--model", &none], "--model expects"),
        (&["--out", &file], "expected a folder"),
    ] {
        let output = DTD.run(&[&["demo"], arguments].concat());
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(expected), "{said}");
        assert!(!Path::new(&out).exists());
    }
}

#[test]
fn help_has_help_as_every_verb_has() {
    let shown = |arguments: &[&str]| {
        let output = DTD.run(arguments);
        assert!(output.status.success(), "{arguments:?}");
        String::from_utf8(output.stdout).unwrap()
    };
    let all = shown(&["help"]);
    assert!(all.contains("mock-xplane"), "{all}");
    for flag in ["--help", "-h"] {
        assert_eq!(shown(&["help", flag]), all);
    }
}
