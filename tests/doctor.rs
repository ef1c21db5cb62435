//! `dtd doctor` against the stand-in, correct and with faults.

use std::process::{Command, Stdio};
use std::sync::mpsc;
use std::thread;

use mock_xplane::server::{Addresses, ServerOptions, serve};
use serde_json::Value;
use testkit::command::{Dtd, Ending, Server};
use tokio::runtime::Runtime;

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

fn stand_in(arguments: &[&str]) -> Server {
    announced(&[arguments, &["--no-beacon"]].concat())
}

/// A simulator with its beacon.
fn announced(arguments: &[&str]) -> Server {
    let well_behaved = (!arguments.contains(&"--quirks")).then_some("--quirks=none");
    let mut all = vec!["mock-xplane"];
    all.extend(well_behaved);
    all.extend(arguments);
    DTD.serve(&all)
}

/// `dtd doctor` with these arguments, on a machine without Web API variables and screen, in a folder without a sweep. Measurements
/// are tested with the stand-in.
fn doctor(arguments: &[&str]) -> Command {
    let mut command = measuring_doctor(arguments);
    command.arg("--no-measure");
    command
}

fn measuring_doctor(arguments: &[&str]) -> Command {
    let mut command = DTD.command(&["doctor", "--json"]);
    command
        .args(arguments)
        .current_dir(std::env::temp_dir())
        .env_remove("DTD_WEB_API")
        .env_remove("DISPLAY");
    command
}

/// Exit code and checks from `dtd doctor`.
fn outcome(mut command: Command) -> (Option<i32>, Vec<Value>) {
    let output = command.output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let checks = serde_json::from_str(&said).unwrap_or_else(|_| {
        panic!("{said}{}", String::from_utf8_lossy(&output.stderr));
    });
    (output.status.code(), checks)
}

/// Examines a simulator whose Web API is not at the expected address.
fn examined(sim: &str) -> (Option<i32>, Vec<Value>) {
    outcome(doctor(&["--sim", sim, "--web-api", "127.0.0.1:9"]))
}

fn check<'a>(checks: &'a [Value], name: &str) -> &'a Value {
    let found = checks.iter().find(|check| check["name"] == name);
    found.unwrap_or_else(|| panic!("no check {name}: {checks:?}"))
}

fn found<'a>(checks: &'a [Value], name: &str) -> &'a str {
    check(checks, name)["found"].as_str().unwrap()
}

fn verdict<'a>(checks: &'a [Value], name: &str) -> &'a str {
    check(checks, name)["verdict"].as_str().unwrap()
}

const POINTS: [&str; 7] = [
    "udp",
    "version",
    "datarefs writable",
    "menus",
    "plugin",
    "lockstep",
    "release",
];

#[test]
fn a_sound_simulator_of_either_generation_is_found_well() {
    for generation in ["11", "12"] {
        let simulator = stand_in(&["--xplane", generation]);
        let (code, checks) = examined(simulator.udp());
        for name in POINTS {
            assert_eq!(
                verdict(&checks, name),
                "ok",
                "X-Plane {generation}: {checks:#?}"
            );
        }
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
    let simulator = stand_in(&["--state", "incoming-off"]);
    let (code, checks) = examined(simulator.udp());
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
    // One that has been running for more than a minute.
    let simulator = stand_in(&["--state", "no-plugin", "--clock-rate", "20"]);
    let (code, checks) = examined(simulator.udp());
    assert_eq!(code, Some(1));
    let plugin = checks.iter().find(|check| check["name"] == "plugin");
    let plugin = plugin.unwrap();
    assert_eq!(plugin["verdict"], "failed");
    assert!(
        plugin["hint"].as_str().unwrap().contains("install-plugin"),
        "{plugin}"
    );
    for name in ["udp", "version", "datarefs writable", "menus"] {
        assert_eq!(verdict(&checks, name), "ok", "{checks:#?}");
    }
    for name in ["lockstep", "release"] {
        assert_eq!(verdict(&checks, name), "skipped", "{checks:#?}");
    }
}

#[test]
fn every_point_that_is_not_well_comes_with_a_hint() {
    let simulator = stand_in(&["--faults", "loss=0.2,seed=3"]);
    let (_, checks) = examined(simulator.udp());
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

#[test]
fn our_own_plugin_is_found_well_although_nobody_knows_where_its_window_lies() {
    // X-Plane 12 has its images only on the screen, and there is none here.
    for (generation, window) in [("11", "ok"), ("12", "warning")] {
        let simulator = stand_in(&[
            "--xplane",
            generation,
            "--plugin",
            "xplane-bridge/plugin",
            "--plugin-window",
            "480x300",
        ]);
        let (code, checks) = examined(simulator.udp());
        for check in &checks {
            assert_ne!(
                check["verdict"], "failed",
                "X-Plane {generation}: {checks:#?}"
            );
        }
        assert_eq!(code, Some(0));
        // Where the machine is busy, an image takes long.
        for name in POINTS.into_iter().filter(|name| *name != "lockstep") {
            assert_eq!(
                verdict(&checks, name),
                "ok",
                "X-Plane {generation}: {checks:#?}"
            );
        }
        assert_eq!(verdict(&checks, "window"), window, "{checks:#?}");
        assert!(found(&checks, "window").contains("480x300"), "{checks:#?}");
        let unseen = found(&checks, "lockstep").contains("was not seen");
        assert_eq!(unseen, generation == "12", "{checks:#?}");
    }
}

#[test]
fn a_window_of_another_size_than_the_sweeps_pictures_is_named_with_both_ways_out_and_a_fitting_one_with_the_command_to_run()
 {
    let sweep = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/tape/session.toml");
    for (window, verdict_of_window) in [("480x300", "warning"), ("96x64", "ok")] {
        let simulator = stand_in(&[
            "--xplane",
            "11",
            "--plugin",
            "xplane-bridge/plugin",
            "--plugin-window",
            window,
        ]);
        let (code, checks) = outcome(doctor(&["--sim", simulator.udp(), "--sweep", sweep]));
        assert_eq!(code, Some(0), "{checks:#?}");
        assert_eq!(verdict(&checks, "window"), verdict_of_window, "{checks:#?}");
        let next = found(&checks, "next");
        if verdict_of_window == "ok" {
            let command = format!(
                "dtd generate {sweep} --out corpus --sim {}",
                simulator.udp()
            );
            assert_eq!(next, command);
        } else {
            let hint = check(&checks, "window")["hint"].as_str().unwrap();
            for words in ["--window=96x64", "width_px = 480 and height_px = 300"] {
                assert!(hint.contains(words), "{words}: {hint}");
            }
            assert!(next.starts_with("fix the window first"), "{next}");
        }
    }
}

#[test]
fn an_installation_is_measured_once_by_the_command_too() {
    let simulator = stand_in(&["--xplane", "11"]);
    let measure = |arguments: &[&str]| {
        outcome(measuring_doctor(
            &[&["--sim", simulator.udp()], arguments].concat(),
        ))
        .1
    };
    assert_eq!(verdict(&measure(&[]), "still pictures"), "ok");
    assert!(found(&measure(&[]), "profile").contains("--measure measures again"));
    assert_eq!(verdict(&measure(&["--measure"]), "pause"), "ok");
}

#[test]
fn a_first_hour_lands_restarts_and_leaves_a_report_and_a_tape_that_replays() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("first-hour");
    let simulator = stand_in(&["--clock-rate", "20"]);
    let sweep = testkit::repository().join("demo.toml");
    let mut command = measuring_doctor(&["--sim", simulator.udp(), "--web-api", "off"]);
    command
        .arg("--first-hour")
        .arg(&out)
        .arg("--sweep")
        .arg(sweep);
    command.args(["--restart-simulator", "test $DTD_SIMULATOR"]);
    let (code, checks) = outcome(command);
    assert_eq!(code, Some(0), "{checks:#?}");
    for name in [
        "still pictures",
        "flaps and gear",
        "load",
        "autopilot",
        "restart",
    ] {
        assert_eq!(verdict(&checks, name), "ok", "{checks:#?}");
    }
    assert!(
        found(&checks, "moving parts").contains("settled"),
        "{checks:#?}"
    );
    let report = std::fs::read(out.join("report.json")).unwrap();
    assert_eq!(
        serde_json::from_slice::<Vec<Value>>(&report).unwrap(),
        checks
    );
    let tape = out.join("session.mcap");
    let replay = DTD.serve(&[
        "mock-xplane",
        "--no-beacon",
        "--tape",
        tape.to_str().unwrap(),
    ]);
    let (_, again) = examined(replay.udp());
    assert_eq!(verdict(&again, "plugin"), "ok", "{again:#?}");
}

#[test]
fn a_menu_is_named() {
    let menu = stand_in(&["--state", "main-menu"]);
    let (code, checks) = examined(menu.udp());
    assert_eq!(
        (code, verdict(&checks, "menus")),
        (Some(1), "failed"),
        "{checks:#?}"
    );
    assert!(found(&checks, "next").contains("menus"));
}

#[test]
fn a_web_api_is_well_only_if_it_is_that_of_this_simulator_with_a_flight_loaded() {
    let one = stand_in(&[]);
    let other = stand_in(&[]);
    let menu = stand_in(&["--state", "main-menu"]);
    for (sim, web_api, expected, words) in [
        (&one, one.web_api(), "ok", "the same simulator"),
        (&one, other.web_api(), "warning", "to another simulator"),
        (&menu, menu.web_api(), "warning", "no flight is loaded"),
    ] {
        let (_, checks) = outcome(doctor(&["--sim", sim.udp(), "--web-api", web_api]));
        assert_eq!(verdict(&checks, "web api"), expected, "{checks:#?}");
        assert!(found(&checks, "web api").contains(words), "{checks:#?}");
    }
}

#[test]
fn the_environment_says_where_the_web_api_is_by_name_too_and_what_it_cannot_say_is_refused() {
    let simulator = stand_in(&[]);
    let with = |place: &str| {
        let mut command = doctor(&["--sim", simulator.udp()]);
        command.env("DTD_WEB_API", place);
        command
    };
    let (_, port) = simulator.web_api().rsplit_once(':').unwrap();
    let (_, checks) = outcome(with(&format!("localhost:{port}")));
    assert_eq!(verdict(&checks, "web api"), "ok", "{checks:#?}");
    let (_, checks) = outcome(with("off"));
    assert_eq!(verdict(&checks, "web api"), "skipped", "{checks:#?}");

    let folder = tempfile::tempdir().unwrap();
    let mut generate = DTD.command(&["generate", "demo.toml", "--sim", simulator.udp(), "--out"]);
    generate.arg(folder.path()).env("DTD_WEB_API", "localhost");
    for mut command in [with("localhost"), generate] {
        let said = command.ends_with(2, &[]);
        for word in ["DTD_WEB_API", "\"localhost\"", "expected HOST:PORT"] {
            assert!(said.contains(word), "{said}");
        }
    }
}

#[test]
fn a_web_api_that_refuses_tells_that_incoming_connections_are_off_without_a_beacon() {
    let simulator = stand_in(&["--state", "incoming-off"]);
    let (code, checks) = outcome(doctor(&[
        "--sim",
        simulator.udp(),
        "--web-api",
        simulator.web_api(),
    ]));
    assert_eq!(code, Some(1));
    assert_ne!(verdict(&checks, "beacon"), "ok");
    assert!(
        found(&checks, "udp").contains("refuses (403)"),
        "{checks:#?}"
    );
    let hint = check(&checks, "udp")["hint"].as_str().unwrap();
    assert!(
        hint.starts_with("It is there, but takes nothing") && hint.contains("Accept incoming"),
        "{hint}"
    );
}

#[test]
fn auto_is_the_simulator_that_announces_itself_for_the_doctor_and_the_recorder_too() {
    // Other tests' stand-ins may announce themselves as well: then both say so.
    let simulator = announced(&[]);
    let (_, checks) = outcome(doctor(&["--sim", "auto", "--web-api", "off"]));
    let beacon = found(&checks, "beacon");
    let (_, port) = simulator.udp().rsplit_once(':').unwrap();
    assert!(beacon.contains(port), "{beacon}");

    let folder = tempfile::tempdir().unwrap();
    let output = DTD
        .command(&["tape", "--sim", "auto", "--port", "0"])
        .arg("--until-stdin-ends")
        .arg("--out")
        .arg(folder.path().join("tape.mcap"))
        .stdin(Stdio::null())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains(port), "{said}");
    let expected = if said.contains("several simulators") {
        2
    } else {
        0
    };
    assert_eq!(output.status.code(), Some(expected), "{said}");
}

#[test]
fn the_name_in_a_beacon_cannot_steer_the_terminal() {
    let (tell, ready) = mpsc::channel();
    thread::spawn(move || {
        let options = ServerOptions {
            port: 0,
            beacon_name: Some("steer-\u{1b}[31m-test".into()),
            ..ServerOptions::default()
        };
        let told = move |addresses: Addresses| tell.send(addresses.udp).unwrap();
        Runtime::new().unwrap().block_on(serve(options, told))
    });
    let mut command = DTD.command(&["doctor", "--no-measure", "--web-api", "off"]);
    command.args(["--sim", &ready.recv().unwrap().to_string()]);
    let said = String::from_utf8(command.output().unwrap().stdout).unwrap();
    assert!(said.contains("steer-\\u{1b}[31m-test"), "{said}");
    assert!(!said.contains('\u{1b}'), "{said}");
}
