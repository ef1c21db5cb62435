//! The command as seen from a shell: plans, bad input, a missing simulator.

use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::Value;
use testkit::command::{Dtd, Ending, text, words};
use testkit::{free_udp_port, repository};

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

fn plan_json(sweep: &str) -> Value {
    DTD.json(&["plan", sweep, "--json"])
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
    let parts = ["pictures", "live_flying", "loading", "weather"];
    for arguments in [&["--sim", "mock"][..], &[]] {
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
        // Three of the six flights are live, and the bundled simulator does not fly in real time.
        assert!(hours("live_flying") * 3_600.0 < 150.0, "{estimate}");
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

/// Each call with words that its message must contain. `OUT` stands for a folder that does not exist and must not exist afterwards,
/// `EMPTY` for a corpus without scenarios, `FILE` for a file.
#[rustfmt::skip]
const WRONG_CALLS: &[(&str, &str)] = &[
    ("plan lost.toml", "error: cannot read lost.toml: No such file"),
    ("doctor --sweep lost.toml", "error: cannot read lost.toml: No such file"),
    ("doctor --sim nowhere", "--sim \"nowhere\" is neither `auto` nor HOST:PORT"),
    ("tape --sim nowhere --out OUT", "--sim \"nowhere\" is neither `auto` nor HOST:PORT"),
    ("mock-xplane --plugin lost", "--plugin lost: it has no PI_dtd_bridge.py"),
    ("fetch lost --out OUT", "it does not begin with a scheme; expected s3://BUCKET/PREFIX"),
    ("label lost-corpus", "lost-corpus"),
    ("label EMPTY", "dtd generate"),
    ("detect EMPTY", "dtd generate"),
    ("verify lost-corpus", "dtd generate"),
    ("verify EMPTY", "contains no complete scenario"),
    ("train lost-corpus --out OUT", "lost-corpus"),
    ("evaluate run --predictions mine.csv --corpus .", "cannot be used with"),
    ("evaluate --predictions mine.csv --detections m --corpus .", "cannot be used with"),
    ("evaluate --corpus .", "RUN|--predictions"),
    ("predict run --corpus EMPTY --out OUT.csv", "ends in .parquet"),
    ("demo --out OUT --sweep lost", "lost"),
    ("demo --out OUT --model lost", "--model expects"),
    ("demo --out FILE", "expected a folder"),
    ("generate demo.toml --out FILE", "FILE"),
    ("install-plugin EMPTY", "is not X-Plane's folder"),
    // Nobody, not even root, can create a folder there.
    ("generate demo.toml --out /proc/corpus", "/proc/corpus"),
    ("generate demo.toml --out OUT --sim nowhere", "HOST:PORT"),
    ("generate demo.toml --out OUT --only 0600-clear-r1,0099", "no scenario 0099"),
    ("generate demo.toml --out OUT --keep-staged", "--keep-staged"),
    ("generate demo.toml --out OUT --restart-simulator true", "by dtd itself"),
    ("generate demo.toml --out OUT --sim mock --udp-port 50000", "a simulator that runs already"),
    ("generate demo.toml --out OUT --sim 127.0.0.1:49000,127.0.0.1:49100 --udp-port 65535", "2 simulators"),
    ("generate demo.toml --out OUT --sim 127.0.0.1:49000 --udp-port 0", "--udp-port"),
];

#[test]
fn a_wrong_call_is_bad_input_that_names_what_is_wrong_and_writes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let [out, empty, file] = ["out", "empty", "file"].map(|name| folder.path().join(name));
    fs::create_dir_all(empty.join("scenarios")).unwrap();
    fs::write(&file, "").unwrap();
    for (line, expected) in WRONG_CALLS {
        let fill = |word: &str| match word {
            "EMPTY" => text(&empty).to_owned(),
            "FILE" => text(&file).to_owned(),
            _ => word.replace("OUT", text(&out)),
        };
        let arguments: Vec<String> = words(line).into_iter().map(fill).collect();
        DTD.ends_with(&arguments, 2, &[&fill(expected)]);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2, "{line}");
    }
}

#[test]
fn a_simulator_that_is_not_there_is_a_failure_that_says_what_to_do() {
    let port = free_udp_port();
    let folder = tempfile::tempdir().unwrap();
    let corpus = folder.path().join("corpus");
    let address = format!("127.0.0.1:{port}");
    let generate = ["generate", "demo.toml", "--out", text(&corpus)];
    let arguments = [&generate[..], &["--sim", &address]].concat();
    DTD.ends_with(&arguments, 1, &[&address, "--sim mock"]);
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
    let log = "Log.txt for X-Plane 12.4.0-r2-9b69b91a (build 124210)\n";
    fs::write(path("Log.txt"), log).unwrap();
    folder
}

#[test]
fn the_plugin_goes_into_an_x_plane_folder_once() {
    let folder = x_plane_folder();
    let path = folder.path().to_str().unwrap();
    let words = ["Accept incoming connections"];
    let said = DTD.ends_with(&["install-plugin", path], 0, &words);
    assert!(said.starts_with("X-Plane 12.4.0"), "{said}");
    let installed = folder
        .path()
        .join("Resources/plugins/PythonPlugins/PI_dtd_bridge.py");
    let source = repository().join("xplane-bridge/plugin/PI_dtd_bridge.py");
    assert_eq!(fs::read(installed).unwrap(), fs::read(source).unwrap());

    let report = DTD.json(&["install-plugin", path, "--json"]);
    let files = report["files"].as_array().unwrap();
    assert!(
        files.iter().all(|file| file["change"] == "unchanged"),
        "{report}"
    );
}

#[test]
fn an_output_that_is_a_device_a_fifo_or_a_link_to_one_is_refused_before_anything_is_done() {
    let folder = tempfile::tempdir().unwrap();
    let fifo = folder.path().join("fifo");
    Command::new("mkfifo").arg(&fifo).succeeds();
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
            DTD.ends_with(
                &[verb, &["--out", out]].concat(),
                2,
                &["is a device, FIFO or socket"],
            );
        }
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), before);
}

#[test]
fn help_has_help_as_every_verb_has() {
    let shown = |arguments: &[&str]| String::from_utf8(DTD.succeeds(arguments).stdout).unwrap();
    let all = shown(&["help"]);
    assert!(all.contains("mock-xplane"), "{all}");
    for flag in ["--help", "-h"] {
        assert_eq!(shown(&["help", flag]), all);
    }
}
