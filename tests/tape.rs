//! Sessions recorded by `dtd tape` and replayed: the same corpus results, and other tools can read the tape.

use std::fs;
use std::io::{BufRead, BufReader};
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use serde_json::Value;
use testkit::command::{Dtd, Server, text};
use testkit::sweep::four_weathers;
use testkit::{program_of_venv, repository};
use xplane_bridge::packet::{ToSimulator, WriteDataref};
use xplane_tape::TapeReader;

const SWEEP: &str = "tests/data/tape/session.toml";
const TAPE: &str = "tests/data/tape/session.mcap";
/// Hash and file of each table that the stored tape gives, labels included.
const EXPECTED: &str = "tests/data/tape/expected.b3";
const IDS: [&str; 2] = ["1200-clear-r1", "1200-foggy-r1"];

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

fn must(arguments: &[&str]) {
    let output = DTD.run(arguments);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{arguments:?}: {said}");
}

/// Records a run of some scenarios; the tape is next to the corpus.
fn recorded(folder: &Path, more: &[&str], only: &[&str]) -> (PathBuf, PathBuf) {
    let (corpus, tape) = (folder.join("corpus"), folder.join("session.mcap"));
    let arguments = [&["tape", "--sim", "mock", "--out", text(&tape)], more].concat();
    let recorder = DTD.serve(&arguments);
    let (out, sim) = (text(&corpus), recorder.udp());
    let generate = ["generate", SWEEP, "--out", out, "--sim", sim];
    must(&[&generate[..], only].concat());
    recorder.end();
    (corpus, tape)
}

fn replayed(folder: &Path, tape: &Path, only: &[&str]) -> PathBuf {
    let corpus = folder.join("replayed");
    let simulator = format!("tape:{}", text(tape));
    let out = text(&corpus);
    let generate = ["generate", SWEEP, "--out", out, "--sim", &simulator];
    must(&[&generate[..], only].concat());
    corpus
}

/// The command that generates some scenarios from a tape.
fn from_tape(tape: &str, sweep: &Path, corpus: &Path, only: &str) -> Vec<String> {
    let (sweep, out) = (text(sweep), text(corpus));
    let line = format!("generate {sweep} --out {out} --sim tape:{tape} --only {only}");
    line.split(' ').map(str::to_owned).collect()
}

fn same_scenario(id: &str, one: &Path, other: &Path) {
    for file in [
        "frames.parquet",
        "calibration.json",
        "scenario.json",
        "views/left.mp4",
        "views/right.mp4",
    ] {
        let [a, b] = [one, other]
            .map(|corpus| fs::read(corpus.join("scenarios").join(id).join(file)).unwrap());
        assert!(a == b, "{id}/{file} differs");
    }
}

#[test]
fn a_session_that_was_not_recorded_is_said_once_with_the_first_difference() {
    let folder = tempfile::tempdir().unwrap();
    let sweep = fs::read_to_string(repository().join(SWEEP)).unwrap();
    let other = folder.path().join("other.toml");
    let line = sweep
        .lines()
        .find(|line| line.starts_with("height_px"))
        .unwrap()
        .to_owned();
    let flights = repository().join("tests/data/flights");
    let sweep = sweep
        .replace(&line, "height_px = 96")
        .replace("../flights", text(&flights));
    fs::write(&other, sweep).unwrap();
    let corpus = folder.path().join("corpus");
    let words = &["height_px was", "and is 96 now"];
    let said = DTD.ends_with(&from_tape(TAPE, &other, &corpus, &IDS.join(",")), 3, words);
    for words in ["again in", "retr", "another plugin"] {
        assert!(!said.to_lowercase().contains(words), "{words}: {said}");
    }
    // Each scenario separately.
    for id in IDS {
        assert!(corpus.join("failed").join(format!("{id}.json")).exists());
    }
}

/// Records four weathers with a recorder's client; returns the sweep, the corpus and the tape.
fn four_weathers_recorded(folder: &Path) -> (PathBuf, PathBuf, PathBuf) {
    let [sweep, corpus, tape] =
        ["sweep.toml", "corpus", "session.mcap"].map(|name| folder.join(name));
    fs::write(&sweep, four_weathers()).unwrap();
    let recorder = DTD.serve(&["tape", "--sim", "mock", "--out", text(&tape)]);
    let simulator = ["--sim", recorder.udp()];
    let generate = ["generate", text(&sweep), "--out", text(&corpus)];
    must(&[&generate[..], &simulator].concat());
    recorder.end();
    (sweep, corpus, tape)
}

#[test]
fn an_unchanged_tape_of_four_weathers_is_replayed_in_any_order_without_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let (sweep, corpus, tape) = four_weathers_recorded(folder.path());
    let all = ["clear", "cloudy", "foggy", "stormy"];
    for (name, weathers) in [("all", &all[..]), ("storm", &all[3..]), ("fog", &all[2..3])] {
        let again = folder.path().join(name);
        let ids: Vec<String> = weathers
            .iter()
            .map(|weather| format!("1200-{weather}-r1"))
            .collect();
        let said = DTD.ends_with(
            &from_tape(text(&tape), &sweep, &again, &ids.join(",")),
            0,
            &[],
        );
        for word in ["WARN", "marked", "differ", "once more"] {
            assert!(!said.contains(word), "{name}: {said}");
        }
        for id in &ids {
            same_scenario(id, &corpus, &again);
        }
    }
}

#[test]
fn a_changed_weather_is_named_by_what_was_written_then() {
    let folder = tempfile::tempdir().unwrap();
    let (sweep, _, tape) = four_weathers_recorded(folder.path());
    let changed = fs::read_to_string(&sweep).unwrap();
    let changed = changed.replace("visibility_m = 80000", "visibility_m = 40233.6");
    fs::write(&sweep, changed).unwrap();
    // 80 km and 40.2336 km in statute miles.
    let words = &["visibility_reported_sm was 49.7", "then, and is 25 now"];
    let again = folder.path().join("again");
    DTD.ends_with(&from_tape(text(&tape), &sweep, &again, IDS[0]), 3, words);
}

#[test]
fn a_recorded_session_gives_the_same_corpus_again_and_mcaps_own_reader_reads_it() {
    let folder = tempfile::tempdir().unwrap();
    let (corpus, tape) = recorded(folder.path(), &[], &[]);
    let again = replayed(folder.path(), &tape, &[]);
    for id in IDS {
        same_scenario(id, &corpus, &again);
    }

    let output = Command::new(program_of_venv("python"))
        .arg(repository().join("tests/judges/tape.py"))
        .arg(&tape)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{said}");
    let verdict: Value = serde_json::from_slice(&output.stdout).unwrap();
    let count = |key: &str| verdict["messages"][key].as_u64().unwrap();
    assert!(
        count("udp/to_simulator") > 100 && count("udp/from_simulator") > 10,
        "{verdict}"
    );
    assert_eq!(count("link/to_simulator"), count("link/from_simulator"));
    assert!(verdict["pictures"].as_u64().unwrap() > 80, "{verdict}");
}

/// The tables of the stored tape, with labels, as `hash  scenario/file` lines.
fn tables(corpus: &Path) -> String {
    let mut lines = String::new();
    for id in IDS {
        for file in ["frames.parquet", "boxes_truth.parquet", "calibration.json"] {
            let bytes = fs::read(corpus.join("scenarios").join(id).join(file)).unwrap();
            lines += &format!("{}  {id}/{file}\n", blake3::hash(&bytes));
        }
    }
    lines
}

#[test]
fn the_stored_tape_gives_the_stored_tables_and_labels() {
    let bytes = fs::metadata(repository().join(TAPE)).unwrap().len();
    assert!(bytes < 5_000_000, "{bytes} bytes");
    let folder = tempfile::tempdir().unwrap();
    let corpus = replayed(folder.path(), &repository().join(TAPE), &[]);
    must(&["label", text(&corpus)]);
    let found = tables(&corpus);
    let path = repository().join(EXPECTED);
    if std::env::var_os("DTD_WRITE_EXPECTED").is_some() {
        fs::write(&path, &found).unwrap();
    }
    let expected = fs::read_to_string(path).unwrap();
    // Sines from a different processor's library may differ in their last bit, and with them a table's hash.
    if cfg!(all(target_arch = "x86_64", target_os = "linux")) {
        assert_eq!(
            found, expected,
            "if a table changed on purpose, run scripts/make_tape.sh"
        );
    }
}

#[test]
fn what_the_tape_does_not_have_fails_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let sweep = fs::read_to_string(repository().join(SWEEP)).unwrap();
    let flights = repository().join("tests/data/flights");
    let sweep = sweep
        .replace("../flights", text(&flights))
        .replace("right_m = 300", "right_m = 301");
    let other = folder.path().join("other.toml");
    fs::write(&other, sweep).unwrap();
    let corpus = folder.path().join("corpus");
    let words = &["the tape has no capture of tick 0, view 1 like this: camera.latitude_deg"];
    DTD.ends_with(&from_tape(TAPE, &other, &corpus, IDS[1]), 3, words);
}

#[test]
fn a_killed_recorder_leaves_a_tape_that_reads() {
    const WRITES: usize = 200;
    let folder = tempfile::tempdir().unwrap();
    let tape = folder.path().join("killed.mcap");
    let simulator = UdpSocket::bind("127.0.0.1:0").unwrap();
    simulator
        .set_read_timeout(Some(Duration::from_secs(20)))
        .unwrap();
    let address = simulator.local_addr().unwrap().to_string();
    let mut recorder = DTD.serve(&["tape", "--sim", &address, "--out", text(&tape)]);
    let client = UdpSocket::bind("127.0.0.1:0").unwrap();
    for value in 0..WRITES {
        let write = WriteDataref {
            path: "sim/time/zulu_time_sec".into(),
            value: value as f32,
        };
        let datagram = ToSimulator::WriteDataref(write).encode().unwrap();
        client.send_to(&datagram, recorder.udp()).unwrap();
        let mut buffer = [0; 1_024];
        let mut length = simulator.recv(&mut buffer).unwrap();
        // The recorder's own probe, which is on no tape.
        while buffer.starts_with(b"RREF") || buffer.starts_with(b"RPOS") {
            length = simulator.recv(&mut buffer).unwrap();
        }
        assert_eq!(buffer[..length], datagram, "not as it was sent");
    }
    // The tape's content reaches the file within a second or so; the machine may be busy.
    let begin = Instant::now();
    let read = || {
        let mut tape = TapeReader::open(&tape).unwrap();
        let mut count = 0;
        while tape.next_entry().unwrap().is_some() {
            count += 1;
        }
        (count, tape.is_whole())
    };
    while read().0 < WRITES && begin.elapsed() < Duration::from_secs(30) {
        sleep(Duration::from_millis(50));
    }
    recorder.process().kill().unwrap();
    recorder.process().wait().unwrap();
    assert_eq!(read(), (WRITES, false));
}

/// The next line with these words.
fn line_with(lines: &mut impl BufRead, words: &str) -> String {
    let mut before = Vec::new();
    for line in lines.lines().map_while(Result::ok) {
        if line.contains(words) {
            return line;
        }
        before.push(line);
    }
    panic!("no {words:?} in {before:?}")
}

#[test]
fn a_recorder_in_front_of_nobody_says_so_at_the_start_and_at_the_end() {
    let folder = tempfile::tempdir().unwrap();
    // A simulator that is there and never answers.
    let mute = UdpSocket::bind("127.0.0.1:0").unwrap();
    mute.set_read_timeout(Some(Duration::from_secs(20)))
        .unwrap();
    let address = mute.local_addr().unwrap().to_string();
    for (client_speaks, at_the_end) in [
        (false, "the tape is empty: no client spoke to the recorder"),
        (true, "nothing came back from"),
    ] {
        let tape = folder.path().join(format!("{client_speaks}.mcap"));
        let mut recorder = Server::start(
            DTD.command(&["tape", "--sim", &address, "--out", text(&tape)])
                .args(["--port", "0", "--until-stdin-ends"])
                .stderr(Stdio::piped()),
        );
        let mut warnings = BufReader::new(recorder.process().stderr.take().unwrap());
        // Still recording: it is ready, and the warning comes later.
        let early = line_with(&mut warnings, "nobody answers at");
        assert!(early.contains(&address), "{early}");
        if client_speaks {
            let client = UdpSocket::bind("127.0.0.1:0").unwrap();
            let write = WriteDataref {
                path: "sim/time/zulu_time_sec".into(),
                value: 1.0,
            };
            let datagram = ToSimulator::WriteDataref(write).encode().unwrap();
            client.send_to(&datagram, recorder.udp()).unwrap();
            // It has passed the recorder once it is here, behind the recorder's own questions.
            let mut buffer = [0; 1_024];
            while !buffer.starts_with(b"DREF") {
                let _ = mute.recv(&mut buffer).unwrap();
            }
        }
        drop(recorder.process().stdin.take());
        line_with(&mut warnings, at_the_end);
        assert!(recorder.process().wait().unwrap().success());
        assert!(tape.is_file());
    }
}
