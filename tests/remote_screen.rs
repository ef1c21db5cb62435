//! X-Plane 12 on a remote computer: a `dtd` without a display gets its images from the screen that the plugin grabs there.
//!
//! One computer plays both. The plugin is changed in two places: it takes every client for a remote one, and it may show its screen, as
//! with `grab = on`.
#![cfg(target_os = "linux")]

use std::fs;
use std::path::Path;
use std::process::Output;

use mock_xplane::window::X11Window;
use testkit::command::{Dtd, Server, said};
use testkit::pictures::pictures;
use testkit_simulator::{SWEEP, SimulatorProcess, plugin};
use xplane_bridge::{LINK_TOKEN_VARIABLE, WEB_API_VARIABLE};
use xplane_tape::TapeReader;

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));
const TOKEN: &str = "open sesame";
/// A recorded flight without a cloud.
const HAZE: &str = "1200-hazy-r1";

const ELSEWHERE: (&str, &str, &str) = (
    "server.py",
    "return client != here and not client.is_loopback",
    "return True",
);
const GRAB_ON: (&str, &str, &str) = ("settings.py", "grab: bool = False", "grab: bool = True");

/// An X-Plane 12 with the changed plugin.
fn simulator(folder: &Path, changes: &[(&str, &str, &str)]) -> SimulatorProcess {
    let plugin = plugin::with(folder, changes);
    SimulatorProcess::start_with_token(DTD, "12", Some("none"), &plugin, TOKEN)
}

/// A verb of `dtd` on the other computer, which has no display.
fn from_elsewhere(simulator: &SimulatorProcess, arguments: &[&str]) -> Output {
    let mut command = simulator.dtd(arguments);
    command.env("DISPLAY", "").output().unwrap()
}

fn generate(simulator: &SimulatorProcess, corpus: &Path) -> Output {
    let corpus = corpus.to_str().unwrap();
    let arguments = [
        "-v", "generate", SWEEP, "--pixels", "screen", "--only", HAZE, "--out", corpus,
    ];
    from_elsewhere(simulator, &arguments)
}

#[test]
fn pictures_that_the_plugin_grabs_are_those_that_are_grabbed_beside_it_to_the_last_bit() {
    let here = SimulatorProcess::start(DTD, "12", Some("none"), &plugin::folder());
    let beside = here.folder().join("corpus");
    let output = here.generate(HAZE, &beside);
    assert!(output.status.success(), "{}", said(&output));

    let folder = tempfile::tempdir().unwrap();
    let there = simulator(folder.path(), &[ELSEWHERE, GRAB_ON]);
    let corpus = there.folder().join("corpus");
    let output = generate(&there, &corpus);
    assert!(output.status.success(), "{}{}", said(&output), there.log());
    assert!(
        said(&output).contains("of 127.0.0.1, grabbed by its plugin"),
        "{}",
        said(&output)
    );
    let (grabbed, wanted) = (pictures(&corpus, HAZE), pictures(&beside, HAZE));
    assert!(wanted.len() > 10 && grabbed == wanted, "images differ");
}

#[test]
fn a_screen_that_may_not_be_shown_or_a_window_that_is_covered_is_refused_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let closed = simulator(folder.path(), &[ELSEWHERE]);
    let corpus = closed.folder().join("corpus");
    let output = generate(&closed, &corpus);
    let text = said(&output);
    assert_eq!(output.status.code(), Some(2), "{text}");
    for words in ["another one than this", "grab = on", "dtd_bridge.ini"] {
        assert!(text.contains(words), "no {words:?} in {text}");
    }
    assert!(!corpus.exists());

    let folder = tempfile::tempdir().unwrap();
    let open = simulator(folder.path(), &[ELSEWHERE, GRAB_ON]);
    let output = from_elsewhere(&open, &["doctor", "--no-measure"]);
    let text = said(&output);
    let seen = "found on the screen of 127.0.0.1, grabbed by its plugin, by its check pattern";
    assert!(text.contains(seen), "{text}");
    // A window with margins is for a dtd beside X-Plane.
    let small = folder.path().join("small.toml");
    let sweep = fs::read_to_string(SWEEP).unwrap();
    let sweep = sweep.replace("width_px = 96", "width_px = 64").replace(
        "../data/",
        concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/"),
    );
    fs::write(&small, sweep).unwrap();
    let small = small.to_str().unwrap();
    let corpus = folder.path().join("small");
    let examining = from_elsewhere(&open, &["doctor", "--no-measure", "--sweep", small]);
    let generating = from_elsewhere(
        &open,
        &[
            "generate",
            small,
            "--pixels",
            "screen",
            "--only",
            HAZE,
            "--out",
            corpus.to_str().unwrap(),
        ],
    );
    assert_eq!(generating.status.code(), Some(2), "{}", said(&generating));
    for text in [said(&examining), said(&generating)] {
        let (exact, larger) = ("--window=64x64", "--window=96x96");
        assert!(text.contains(exact) && !text.contains(larger), "{text}");
    }
    let above = X11Window::open(Some(open.display()), (48, 32)).unwrap();
    let output = from_elsewhere(&open, &["doctor", "--no-measure"]);
    let text = said(&output);
    for words in ["grabbed by its plugin", "in front of all others"] {
        assert!(text.contains(words), "no {words:?} in {text}");
    }
    drop(above);
}

#[test]
fn pictures_of_the_screen_pass_a_recorder_and_do_not_reach_the_tape() {
    let folder = tempfile::tempdir().unwrap();
    let there = simulator(folder.path(), &[ELSEWHERE, GRAB_ON]);
    let tape = folder.path().join("session.mcap");
    let recorder = Server::start(
        there
            .dtd(&["tape", "--port", "0", "--until-stdin-ends"])
            .arg("--out")
            .arg(&tape),
    );
    let output = DTD
        .command(&["doctor", "--no-measure", "--sim", recorder.udp()])
        .env("DISPLAY", "")
        .env(LINK_TOKEN_VARIABLE, TOKEN)
        .env(WEB_API_VARIABLE, "off")
        .output()
        .unwrap();
    let text = said(&output);
    assert!(
        text.contains("grabbed by its plugin, by its check"),
        "{text}"
    );
    recorder.end();

    let mut tape = TapeReader::open(&tape).unwrap();
    let mut messages = Vec::new();
    while let Some(entry) = tape.next_entry().unwrap() {
        messages.push(String::from_utf8_lossy(&entry.data).into_owned());
    }
    let has = |words: &str| messages.iter().any(|message| message.contains(words));
    assert!(has("check_pattern_shown"), "{} messages", messages.len());
    for words in ["open_screen", "screen_opened", r#""grab"#] {
        assert!(!has(words), "{words} is on the tape");
    }
}

#[test]
fn a_changed_graphics_setting_is_named_when_a_corpus_goes_on_and_when_it_is_verified() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = folder.path().join("corpus");
    let other_settings = plugin::with(
        folder.path(),
        &[(
            "installation.py",
            "Output/preferences/X-Plane.prf",
            "none.prf",
        )],
    );
    let generate = |plugin: &Path, only: &str| {
        let simulator = SimulatorProcess::start(DTD, "12", Some("none"), plugin);
        let output = simulator.generate(only, &corpus);
        assert!(output.status.success(), "{}", said(&output));
        said(&output)
    };
    let words = "renopt_MSAA is 0 in 1200-hazy-r1, missing in 1200-stormy-r1";
    assert!(!generate(&plugin::folder(), HAZE).contains("graphics differ"));
    let text = generate(&other_settings, "1200-stormy-r1");
    assert!(
        text.contains(&format!("earlier scenarios: {words}")),
        "{text}"
    );
    let report = DTD.json(&["verify", "--json", corpus.to_str().unwrap()]);
    let changes = report["graphics"].as_array().unwrap();
    assert!(changes.iter().any(|change| change == words), "{changes:?}");
}
