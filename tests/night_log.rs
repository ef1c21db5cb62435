//! A night's log: every line has its time, or is an object for a program, and peers can neither fill nor forge it.

use std::collections::BTreeSet;
use std::fs;
use std::net::UdpSocket;
use std::process::Stdio;
use std::time::{Duration, Instant};

use serde_json::Value;
use tempfile::tempdir;
use testkit::command::{Dtd, Server, text};

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

/// Records the small sweep; returns the lines of stderr.
fn recorded(arguments: &[&str]) -> Vec<String> {
    let folder = tempdir().unwrap();
    let corpus = folder.path().join("corpus");
    let generate = ["generate", "tests/data/small.toml", "--out", text(&corpus)];
    let output = DTD.succeeds(&[&generate, arguments].concat());
    let lines = String::from_utf8(output.stderr).unwrap();
    lines.lines().map(str::to_owned).collect()
}

/// True if a text begins like `2026-11-26T00:00:05Z`.
fn begins_with_a_time(line: &str) -> bool {
    let form = b"0000-00-00T00:00:00Z";
    line.len() >= form.len()
        && line.bytes().zip(form).all(|(found, form)| match form {
            b'0' => found.is_ascii_digit(),
            other => found == *other,
        })
}

#[test]
fn every_line_of_a_log_has_its_date_and_time_and_the_last_progress_says_all_that_is_known() {
    let lines = recorded(&[]);
    for line in &lines {
        assert!(begins_with_a_time(line), "{line}");
    }
    let progress = lines
        .iter()
        .rfind(|line| line.contains(" ticks in ") && line.contains('/'));
    let progress = progress.unwrap_or_else(|| panic!("no progress in {lines:?}"));
    let committed = lines
        .iter()
        .rposition(|line| line.contains("ticks in") && !line.contains('/'));
    assert!(
        committed < lines.iter().position(|line| line == progress),
        "{lines:?}"
    );
    for words in ["scenario 6 of 6", " written, ", " free"] {
        assert!(progress.contains(words), "{progress}");
    }
    assert!(
        !progress.contains("failed") && !progress.contains("0 B written"),
        "{progress}"
    );
}

#[test]
fn with_progress_json_every_line_of_stderr_is_an_object_of_the_schema() {
    let printed = DTD.json(&["schema", "progress"]);
    let file = testkit::repository().join("schema/progress.schema.json");
    let schema: Value = serde_json::from_str(&fs::read_to_string(file).unwrap()).unwrap();
    assert_eq!(printed, schema);
    let keys_of = |kind: &str| -> BTreeSet<String> {
        let forms = schema["oneOf"].as_array().unwrap().iter();
        let mut forms = forms.filter(|form| form["properties"]["kind"]["const"] == kind);
        let required = forms.next().unwrap()["required"].as_array().unwrap();
        let keys = required.iter().map(|key| key.as_str().unwrap().to_owned());
        keys.collect()
    };
    let mut last = None;
    for line in recorded(&["--progress", "json"]) {
        let object: Value = serde_json::from_str(&line).unwrap_or_else(|_| panic!("{line}"));
        let kind = object["kind"].as_str().unwrap();
        let keys: BTreeSet<String> = object.as_object().unwrap().keys().cloned().collect();
        assert_eq!(keys, keys_of(kind), "{line}");
        assert!(
            begins_with_a_time(object["time"].as_str().unwrap()),
            "{line}"
        );
        if kind == "progress" {
            last = Some(object);
        }
    }
    let last = last.expect("some progress");
    assert_eq!(last["done"], last["total"]);
    assert_eq!(last["scenarios"]["number"], 6);
    assert_eq!(last["scenarios"]["failed"], 0);
    assert!(last["bytes_written"].as_u64().unwrap() > 10_000, "{last}");
    assert!(last["bytes_free"].as_u64().unwrap() > 0, "{last}");
    // An error is an object as well.
    let failed = DTD.run(&["--progress", "json", "plan", "no-such.toml"]);
    let line = String::from_utf8(failed.stderr).unwrap();
    let object: Value = serde_json::from_str(&line).unwrap_or_else(|_| panic!("{line}"));
    assert_eq!(object["level"], "error");
}

#[test]
fn what_goes_wrong_is_a_warning_for_programs_as_well() {
    let folder = tempdir().unwrap();
    let corpus = folder.path().join("corpus");
    let generate = ["generate", "tests/data/small.toml", "--out", text(&corpus)];
    let only = ["--only", "1200-clear-r1"];
    assert!(DTD.run(&[&generate[..], &only].concat()).status.success());
    fs::write(corpus.join("scenarios/1200-clear-r1/DONE.json"), "").unwrap();
    let labelled = DTD.run(&["--progress", "json", "label", text(&corpus)]);
    let lines = String::from_utf8(labelled.stderr).unwrap();
    let is_about_it = |line: &&str| line.contains("message") && line.contains("1200-clear-r1");
    let line = lines.lines().find(is_about_it);
    let line = line.unwrap_or_else(|| panic!("{lines}"));
    let object: Value = serde_json::from_str(line).unwrap();
    assert_eq!(object["level"], "warning", "{line}");
}

#[test]
fn a_name_with_a_line_feed_begins_no_line_of_the_log_or_of_a_verdict() {
    let folder = tempdir().unwrap();
    let corpus = folder
        .path()
        .join("cn\n2026-11-26T00:00:00Z done: 99 of 99");
    let forged = "12 scenarios (12 labelled): no faults";
    let scenario = corpus.join("scenarios").join(format!("evil\n{forged}"));
    fs::create_dir_all(&scenario).unwrap();
    fs::write(scenario.join("DONE.json"), "{}").unwrap();
    let verified = DTD.run(&["verify", text(&corpus)]);
    let verdict = String::from_utf8(verified.stdout).unwrap();
    assert!(verdict.contains(forged), "{verdict}");
    assert!(
        !verdict.lines().any(|line| line.starts_with(forged)),
        "{verdict}"
    );
    let missing = DTD.run(&["verify", text(&corpus.join("missing"))]);
    let log = String::from_utf8(missing.stderr).unwrap();
    assert!(log.contains("99 of 99"), "{log}");
    let is_forged = |line: &str| line.starts_with("2026-11-26T00:00:00Z done");
    assert!(!log.lines().any(is_forged), "{log}");
}

#[test]
fn a_flood_of_bad_datagrams_is_a_few_lines_and_none_of_its_bytes_reaches_the_terminal() {
    let mut stand_in = Server::start(
        DTD.command(&["mock-xplane", "--no-beacon", "--quirks=none"])
            .args(["--port", "0", "--until-stdin-ends"])
            .stderr(Stdio::piped()),
    );
    let client = UdpSocket::bind("127.0.0.1:0").unwrap();
    let simulator = stand_in.address("udp");
    // A write to a dataref that does not exist, with a name that clears the screen and begins a separate line.
    let name = b"\x1b[2J\n2026-11-26T00:00:05Z ERROR all is lost";
    for number in 0..5_000_u32 {
        let mut write = b"DREF\0\0\0\x80\x3f".to_vec();
        write.extend(name);
        write.extend(number.to_string().bytes());
        write.resize(509, 0);
        client.send_to(&write, simulator).unwrap();
        client.send_to(&number.to_le_bytes(), simulator).unwrap();
    }
    // An answered reading comes after everything.
    let mut request = b"RREF\0\x0a\0\0\0\0\0\0\0sim/time/total_running_time_sec".to_vec();
    request.resize(413, 0);
    client
        .set_read_timeout(Some(Duration::from_millis(200)))
        .unwrap();
    let began = Instant::now();
    loop {
        client.send_to(&request, simulator).unwrap();
        if client.recv(&mut [0; 64]).is_ok() {
            break;
        }
        assert!(began.elapsed() < Duration::from_secs(60), "no answer");
    }
    let stderr = stand_in.process().stderr.take().unwrap();
    stand_in.end();
    let log = std::io::read_to_string(stderr).unwrap();
    assert!(
        log.contains("datagram ignored") && log.contains("write ignored"),
        "{log}"
    );
    // One of each a minute, and at the end how many more there were.
    assert!(log.lines().count() <= 8, "{log}");
    for what in ["datagram ignored", "write ignored"] {
        let counted = |line: &str| line.contains(what) && line.contains(" more of these");
        assert!(log.lines().any(counted), "{log}");
    }
    assert!(!log.contains('\u{1b}'), "{log}");
    assert!(log.lines().all(begins_with_a_time), "{log}");
    assert!(
        !log.lines()
            .any(|line| line.contains("Z ERROR") && !line.contains("WARN")),
        "{log}"
    );
}
