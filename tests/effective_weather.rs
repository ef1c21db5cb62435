//! A simulator whose reported weather at the aircraft differs from the written one, through every verb that must notice: `generate`,
//! `verify`, `plan --against`, `train`.

use std::fs;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::Output;

use dataset::corpus::Corpus;
use dataset::corpus::effective_weather::{EffectiveQuantity, EffectiveWeather};
use dataset::corpus::scenario::ScenarioRecord;
use dataset::corpus::seal::seal_folder;
use serde_json::Value;
use testkit::TINY_TRAINING;
use testkit::command::{Dtd, Server, json, said, text};
use testkit::sweep::four_weathers;
use testkit::synthetic::SyntheticCorpus;
use testkit_simulator::altered;

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));
const VISIBILITY: &str = "sim/graphics/view/visibility_effective_m";
const IDS: [&str; 4] = [
    "1200-clear-r1",
    "1200-cloudy-r1",
    "1200-foggy-r1",
    "1200-stormy-r1",
];

fn sweep(folder: &Path) -> PathBuf {
    let path = folder.join("sweep.toml");
    fs::write(&path, four_weathers()).unwrap();
    path
}

fn stand_in() -> Server {
    DTD.serve(&["mock-xplane", "--quirks=none", "--no-beacon"])
}

/// A relay in front of a stand-in that reports a visibility that no scenario has.
fn reporting_another_visibility(simulator: SocketAddr) -> String {
    let relay = altered(
        simulator,
        |path, value| if path == VISIBILITY { 2_000.0 } else { value },
    );
    relay.to_string()
}

fn generate(sweep: &Path, corpus: &Path, simulator: &str) -> Output {
    let arguments = [text(sweep), "--out", text(corpus), "--sim", simulator];
    DTD.run(&[&["generate"], &arguments[..]].concat())
}

#[tokio::test(flavor = "multi_thread")]
async fn without_a_profile_scenarios_are_marked_and_every_verb_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let (sweep, corpus) = (sweep(folder.path()), folder.path().join("corpus"));
    let simulator = stand_in();
    let relay = reporting_another_visibility(simulator.address("udp"));
    let output = generate(&sweep, &corpus, &relay);
    let words = said(&output);
    assert_eq!(output.status.code(), Some(3), "{words}");
    assert_eq!(
        words.matches("does not follow the visibility").count(),
        1,
        "{words}"
    );
    for id in IDS {
        assert!(
            words.contains(&format!("marked: {id}: visibility is 2000 m")),
            "{words}"
        );
        let record = Corpus::open(&corpus).unwrap().scenario(id);
        let record = record.open().unwrap().record().unwrap();
        assert_eq!(
            record.schema_version, 3,
            "readers of version 2 would overlook the mark"
        );
        let shown = record.effective_weather.unwrap();
        assert_eq!(shown.visibility_m, Some(2_000.0));
        assert_eq!(shown.differing, [EffectiveQuantity::Visibility].into());
    }

    let words = DTD.ends_with(
        &["verify", text(&corpus)],
        3,
        &["no faults, 4 marked for another weather"],
    );
    let line = "1200-foggy-r1/scenario.json: marked, the weather at the aircraft is not the planned one: visibility is 2000 m, planned was \
                9260 m";
    assert!(words.contains(line), "{words}");

    let output = DTD.run(&["plan", text(&sweep), "--against", text(&corpus)]);
    let words = said(&output);
    assert!(
        words.contains("marked      1200-stormy-r1: visibility is 2000 m"),
        "{words}"
    );
    let document = DTD.json(&["plan", text(&sweep), "--against", text(&corpus), "--json"]);
    let marked = &document["against"]["weather"]["clear"]["marked"];
    assert!(marked["1200-clear-r1"][0].is_string(), "{marked}");

    let store = format!("file://{}", folder.path().join("store").display());
    DTD.succeeds(&["push", text(&corpus), &store]);
    let of_store = DTD.json(&["plan", text(&sweep), "--against", &store, "--json"]);
    assert_eq!(
        of_store["against"]["weather"],
        document["against"]["weather"]
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn with_a_profile_attempts_fail_until_three_scenarios_failed_alike_and_then_the_night_goes_on()
 {
    let folder = tempfile::tempdir().unwrap();
    let (sweep, corpus) = (sweep(folder.path()), folder.path().join("corpus"));
    let simulator = DTD.serve(&[
        "mock-xplane",
        "--quirks=none",
        "--no-beacon",
        "--clock-rate=20",
    ]);
    // In a folder without a sweep, and without a screen.
    let examined = DTD
        .command(&[
            "doctor",
            "--json",
            "--web-api=127.0.0.1:9",
            "--sim",
            simulator.udp(),
        ])
        .current_dir(folder.path())
        .env_remove("DISPLAY")
        .output()
        .unwrap();
    let checks = json(&examined);
    let follows =
        |check: &Value| check["name"] == "weather at the aircraft" && check["verdict"] == "ok";
    assert!(checks.as_array().unwrap().iter().any(follows), "{checks:#}");

    let relay = reporting_another_visibility(simulator.address("udp"));
    let output = generate(&sweep, &corpus, &relay);
    let words = said(&output);
    assert_eq!(output.status.code(), Some(3), "{words}");
    let refused = "failed and will be tried again: the weather at the aircraft is not what was set: visibility is 2000 m";
    assert_eq!(words.matches(refused).count(), 3, "{words}");
    assert_eq!(
        words.matches("does not follow the visibility").count(),
        1,
        "{words}"
    );
    assert!(
        words.contains("4 scenarios made, 0 complete already, 0 failed"),
        "{words}"
    );
    assert_eq!(words.matches("\nmarked: ").count(), 4, "{words}");
}

#[test]
fn a_right_simulator_marks_nothing_and_its_weather_is_in_the_record() {
    let folder = tempfile::tempdir().unwrap();
    let (sweep, corpus) = (sweep(folder.path()), folder.path().join("corpus"));
    let simulator = stand_in();
    let output = generate(&sweep, &corpus, simulator.udp());
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    let scenario = Corpus::open(&corpus).unwrap().scenario(IDS[3]);
    let record = scenario.open().unwrap().record().unwrap();
    assert_eq!(record.schema_version, 1);
    let shown = record.effective_weather.unwrap();
    assert!(
        !shown.is_marked() && shown.rain_ratio.is_some(),
        "{shown:?}"
    );
    DTD.ends_with(
        &["verify", text(&corpus)],
        0,
        &[
            "weather at the aircraft, stormy: visibility 350",
            ": no faults\n",
        ],
    );
}

/// Marks a scenario, as if its simulator had shown fog, and seals it again.
fn mark(corpus: &Corpus, id: &str) {
    let folder = corpus.scenario(id);
    let record = folder.open().unwrap().record().unwrap();
    let record = ScenarioRecord {
        effective_weather: Some(EffectiveWeather {
            visibility_m: Some(500.0),
            differing: [EffectiveQuantity::Visibility].into(),
            ..EffectiveWeather::default()
        }),
        ..record
    };
    let record = ScenarioRecord {
        schema_version: record.required_version(record.schema_version),
        ..record
    };
    record.write(&folder.record_path()).unwrap();
    seal_folder(folder.root(), &record.config_hash).unwrap();
}

#[test]
fn a_training_leaves_marked_scenarios_out_unless_they_are_accepted() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = SyntheticCorpus::tiny()
        .write(&folder.path().join("corpus"))
        .unwrap();
    mark(&corpus, "0001");
    let settings = folder.path().join("train.toml");
    fs::write(&settings, TINY_TRAINING).unwrap();
    let trained_on = |name: &str, more: &[&str]| {
        let run = folder.path().join(name);
        let arguments = [
            "train",
            text(corpus.root()),
            "--config",
            text(&settings),
            "--out",
            text(&run),
        ];
        let output = DTD.succeeds(&[&arguments[..], more].concat());
        let summary: Value =
            serde_json::from_slice(&fs::read(run.join("run.json")).unwrap()).unwrap();
        (summary["training_scenarios"].as_u64(), said(&output))
    };
    let (scenarios, words) = trained_on("careful", &[]);
    assert_eq!(scenarios, Some(3), "{words}");
    assert!(
        words.contains("left out, since the weather at the aircraft was not the planned one: 0001"),
        "{words}"
    );
    let (scenarios, words) = trained_on("accepting", &["--accept-weather"]);
    assert_eq!(scenarios, Some(4), "{words}");
    assert!(!words.contains("left out"), "{words}");
}
