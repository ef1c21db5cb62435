//! `dtd doctor` against the stand-in, sound and with faults.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

use serde_json::Value;

struct StandIn {
    child: Child,
    udp: String,
}

impl StandIn {
    fn start(arguments: &[&str]) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_dtd"))
            .args([
                "mock-xplane",
                "--port",
                "0",
                "--no-beacon",
                "--until-stdin-ends",
            ])
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap())
            .read_line(&mut line)
            .unwrap();
        let ready: Value = serde_json::from_str(&line).unwrap();
        let udp = ready["udp"].as_str().unwrap().to_owned();
        Self { child, udp }
    }
}

impl Drop for StandIn {
    fn drop(&mut self) {
        let _ = self.child.kill();
    }
}

/// Exit code and checks of `dtd doctor`.
fn examined(sim: &str) -> (Option<i32>, Vec<Value>) {
    let output = Command::new(env!("CARGO_BIN_EXE_dtd"))
        .args(["doctor", "--json", "--sim", sim, "--web-api", "127.0.0.1:9"])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let checks = serde_json::from_str(&said).unwrap_or_else(|_| panic!("{said}"));
    (output.status.code(), checks)
}

fn verdict<'a>(checks: &'a [Value], name: &str) -> &'a str {
    let found = checks.iter().find(|check| check["name"] == name);
    found.unwrap_or_else(|| panic!("no check {name}: {checks:?}"))["verdict"]
        .as_str()
        .unwrap()
}

const POINTS: [&str; 9] = [
    "udp",
    "version",
    "datarefs readable",
    "datarefs writable",
    "commands",
    "frame rate",
    "plugin",
    "lockstep",
    "release",
];

#[test]
fn a_sound_simulator_of_either_generation_is_found_well() {
    for generation in ["11", "12"] {
        let simulator = StandIn::start(&["--xplane", generation]);
        let (code, checks) = examined(&simulator.udp);
        for name in POINTS {
            assert_eq!(
                verdict(&checks, name),
                "ok",
                "X-Plane {generation}: {checks:#?}"
            );
        }
        assert_eq!(verdict(&checks, "terrain"), "ok", "{checks:#?}");
        assert_eq!(code, Some(0));
        let web_api = if generation == "11" {
            "skipped"
        } else {
            "warning"
        };
        assert_eq!(
            verdict(&checks, "web api"),
            web_api,
            "nothing listens there"
        );
    }
}

#[test]
fn a_simulator_that_takes_nothing_fails_with_what_to_switch_on_and_skips_the_rest() {
    let simulator = StandIn::start(&["--incoming-off"]);
    let (code, checks) = examined(&simulator.udp);
    assert_eq!(code, Some(1));
    assert_eq!(verdict(&checks, "udp"), "failed");
    let udp = checks.iter().find(|check| check["name"] == "udp").unwrap();
    assert!(
        udp["hint"]
            .as_str()
            .unwrap()
            .contains("Accept incoming connections"),
        "{udp}"
    );
    for name in &POINTS[1..] {
        assert_eq!(verdict(&checks, name), "skipped", "{checks:#?}");
    }
}

#[test]
fn a_simulator_without_our_plugin_is_told_how_to_get_it_and_the_rest_of_udp_is_examined() {
    let simulator = StandIn::start(&["--no-plugin"]);
    let (code, checks) = examined(&simulator.udp);
    assert_eq!(code, Some(1));
    let plugin = checks.iter().find(|check| check["name"] == "plugin");
    let plugin = plugin.unwrap();
    assert_eq!(plugin["verdict"], "failed");
    assert!(
        plugin["hint"].as_str().unwrap().contains("install-plugin"),
        "{plugin}"
    );
    for name in ["udp", "version", "datarefs readable", "commands"] {
        assert_eq!(verdict(&checks, name), "ok", "{checks:#?}");
    }
    for name in ["terrain", "lockstep", "release"] {
        assert_eq!(verdict(&checks, name), "skipped", "{checks:#?}");
    }
}

#[test]
fn every_point_that_is_not_well_comes_with_a_hint() {
    let simulator = StandIn::start(&["--faults", "loss=0.2,seed=3"]);
    let (_, checks) = examined(&simulator.udp);
    assert_eq!(
        verdict(&checks, "datarefs writable"),
        "ok",
        "a fifth of the packets lost: {checks:#?}"
    );
    for check in &checks {
        let needs_hint = matches!(check["verdict"].as_str().unwrap(), "warning" | "failed");
        assert_eq!(check["hint"].is_string(), needs_hint, "{check}");
    }
}
