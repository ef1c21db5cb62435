//! `dtd` in front of a simulator that, behind a relay, answers from a different UDP port than it listens on, as X-Plane does.

use std::fs;
use std::net::{Ipv4Addr, UdpSocket};
use std::path::Path;
use std::process::{Child, Command};
use std::thread::sleep;
use std::time::{Duration, Instant};

use serde_json::Value;
use testkit::command::{Dtd, Ending, Server, json, said, text};
use testkit::free_udp_port;
use testkit::sweep::{FROM_2_NM, SmallSweep};
use testkit_simulator::Relay;
use xplane_tape::TapeReader;

const SWEEP: &str = "tests/data/tape/session.toml";
const GENERATIONS: [&str; 2] = ["11", "12"];
const PATIENCE: Duration = Duration::from_secs(120);

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

fn behind_a_relay(generation: &str) -> (Server, Relay) {
    let arguments = ["mock-xplane", "--no-beacon", "--quirks=none", "--xplane"];
    let simulator = DTD.serve(&[&arguments[..], &[generation]].concat());
    let relay = Relay::start(simulator.address("udp"));
    (simulator, relay)
}

/// A verb that keeps its notes in a folder of the test.
fn dtd(arguments: &[&str], state: &Path) -> Command {
    let mut command = DTD.command(arguments);
    command
        .env("XDG_STATE_HOME", state)
        .env("DTD_WEB_API", "off");
    command
}

fn must(command: &mut Command) {
    command.succeeds();
}

/// The notes of ports in use.
fn notes(state: &Path) -> usize {
    let Ok(simulators) = fs::read_dir(state.join("dtd/udp-ports")) else {
        return 0;
    };
    simulators
        .map(|folder| fs::read_dir(folder.unwrap().path()).unwrap().count())
        .sum()
}

#[test]
fn a_doctor_finds_a_simulator_that_answers_from_another_port() {
    let state = tempfile::tempdir().unwrap();
    for generation in GENERATIONS {
        let (_simulator, relay) = behind_a_relay(generation);
        let sim = relay.address().to_string();
        let port = free_udp_port().to_string();
        let arguments = ["doctor", "--json", "--no-measure", "--sim", &sim];
        let output = dtd(
            &[&arguments[..], &["--udp-port", &port]].concat(),
            state.path(),
        )
        .current_dir(state.path())
        .env_remove("DISPLAY")
        .succeeds();
        let checks: Value = json(&output);
        let mut checks_of_udp = checks.as_array().unwrap().iter();
        let answers = checks_of_udp.any(|check| check["name"] == "udp" && check["verdict"] == "ok");
        assert!(answers, "{checks:#}");
        assert_eq!(notes(state.path()), 0, "a doctor that has ended");
    }
}

#[test]
fn scenarios_are_generated_and_recorded_from_a_simulator_that_answers_from_another_port() {
    for generation in GENERATIONS {
        let folder = tempfile::tempdir().unwrap();
        let (_simulator, relay) = behind_a_relay(generation);
        let sim = relay.address().to_string();
        let direct = folder.path().join("direct");
        let generate = ["generate", SWEEP, "--out", text(&direct), "--sim", &sim];
        let port = free_udp_port().to_string();
        must(&mut dtd(
            &[&generate[..], &["--udp-port", &port]].concat(),
            folder.path(),
        ));

        let tape = folder.path().join("session.mcap");
        let port = free_udp_port().to_string();
        let record = ["tape", "--sim", &sim, "--out", text(&tape)];
        let recorder = Server::start(
            dtd(&record, folder.path())
                .args(["--udp-port", &port])
                .args(["--port", "0", "--until-stdin-ends"]),
        );
        let behind = folder.path().join("behind");
        let generate = ["generate", SWEEP, "--out", text(&behind)];
        must(&mut dtd(
            &[&generate[..], &["--sim", recorder.udp()]].concat(),
            folder.path(),
        ));
        recorder.end();
        let mut reader = TapeReader::open(&tape).unwrap();
        let mut entries = 0;
        while reader.next_entry().unwrap().is_some() {
            entries += 1;
        }
        assert!(entries > 100, "X-Plane {generation}: {entries} entries");
        assert_eq!(notes(folder.path()), 0);
    }
}

#[test]
fn a_port_where_no_program_listens_is_noticed_before_any_timeout_and_a_taken_local_port_is_named() {
    let state = tempfile::tempdir().unwrap();
    let sim = format!("127.0.0.1:{}", free_udp_port());
    let doctor = ["doctor", "--no-measure", "--sim", &sim];
    let output = dtd(&doctor, state.path()).output().unwrap();
    let said_by_doctor = said(&output);
    assert!(
        said_by_doctor.contains(&format!("no program listens on {sim}")),
        "{said_by_doctor}"
    );

    let (_simulator, relay) = behind_a_relay("12");
    let taken = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    let sim = relay.address().to_string();
    let doctor = ["doctor", "--no-measure", "--sim", &sim, "--udp-port", &port];
    let output = dtd(&doctor, state.path()).output().unwrap();
    let said = said(&output);
    assert!(
        said.contains(&format!("cannot use UDP port {port} of this computer")),
        "{said}"
    );
}

/// True if the simulator sends anything within a while.
fn sends(relay: &Relay) -> bool {
    // Settings are watched at four values a second.
    let before = relay.answers();
    sleep(Duration::from_secs(1));
    relay.answers() > before
}

/// Begins to record some 2,000 images per view from a simulator, into `corpus` beside the folder of notes, until images come.
fn recording_from(sim: &str, folder: &Path, state: &Path) -> Child {
    let sweep = SmallSweep {
        name: "killed",
        seed: 5,
        weathers: &["clear"],
        repeats: 1,
        size_px: (96, 64),
        frame_rate: "30",
        tables: &format!("{FROM_2_NM}\n[weather.clear]\nvisibility_m = 80000\n"),
    };
    let file = folder.join("sweep.toml");
    fs::write(&file, sweep.toml()).unwrap();
    let corpus = folder.join("corpus");
    let generate = ["generate", text(&file), "--out", text(&corpus)];
    let mut recording = dtd(&[&generate[..], &["--sim", sim]].concat(), state)
        .spawn()
        .unwrap();
    let began = Instant::now();
    while !is_recording(&corpus) {
        assert!(began.elapsed() < PATIENCE, "nothing is recorded");
        assert!(recording.try_wait().unwrap().is_none(), "it has ended");
        sleep(Duration::from_millis(10));
    }
    recording
}

/// Ends a process by SIGKILL.
fn kill(mut process: Child) {
    process.kill().unwrap();
    process.wait().unwrap();
}

/// The next client ends the subscriptions that a killed one, with a note in this folder, has left.
fn assert_ended_by_the_next(sim: &str, relay: &Relay, folder: &Path, state: &Path) {
    assert!(
        sends(relay),
        "the simulator goes on sending to a killed client"
    );
    assert!(notes(state) > 0, "the port of the killed client is noted");
    let doctor = ["doctor", "--no-measure", "--sim", sim];
    must(dtd(&doctor, state).current_dir(folder));
    assert!(!sends(relay), "subscriptions are left");
    assert_eq!(notes(state), 0);
}

#[test]
fn the_next_client_ends_the_subscriptions_of_one_that_was_killed() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state");
    let (_simulator, relay) = behind_a_relay("12");
    let sim = relay.address().to_string();
    kill(recording_from(&sim, folder.path(), &state));
    assert_ended_by_the_next(&sim, &relay, folder.path(), &state);
}

#[test]
fn the_next_client_ends_the_subscriptions_of_a_recorder_that_was_killed() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state");
    let (_simulator, relay) = behind_a_relay("12");
    let sim = relay.address().to_string();
    let tape = folder.path().join("session.mcap");
    let record = ["tape", "--sim", &sim, "--out", text(&tape)];
    let recorder = Server::start(dtd(&record, &state).args(["--port", "0", "--until-stdin-ends"]));
    let of_generate = folder.path().join("state-of-generate");
    let recording = recording_from(recorder.udp(), folder.path(), &of_generate);
    // By SIGKILL.
    drop(recorder);
    kill(recording);
    assert_ended_by_the_next(&sim, &relay, folder.path(), &state);
}

/// True once a scenario has come to its images, when its settings are watched.
fn is_recording(corpus: &Path) -> bool {
    let Ok(scenarios) = fs::read_dir(corpus.join("scenarios")) else {
        return false;
    };
    scenarios.flatten().any(|scenario| {
        fs::read_dir(scenario.path().join("views")).is_ok_and(|mut views| views.next().is_some())
    })
}
