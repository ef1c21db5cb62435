//! Any two verbs at once on one corpus: nothing is lost, no seal breaks, other people's files stay, and the exit codes are correct.
//!
//! Each round copies a corpus with work for every verb, starts two verbs with a random delay, and checks the result. `DTD_RACE_ROUNDS` is
//! the number of rounds for each pair (1), `DTD_RACE_SEED` draws the delays, `DTD_RACE_VERBS=label,push` restricts the pairs.

mod tiny;

use std::collections::BTreeSet;
use std::env;
use std::fs;
use std::path::Path;
use std::process::Output;
use std::sync::LazyLock;
use std::thread;
use std::time::{Duration, Instant};
use testkit::command::{Ending, said};

use dataset::corpus::Corpus;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;
use serde_json::Value;
use tiny::{TOO_LONG, Tiny};

/// The verbs that work on a corpus, with `{store}` for an object store's URL and `{model}` for the detector.
const VERBS: [(&str, &str); 10] = [
    ("plan", "plan sweep.toml --against corpus --json"),
    ("generate", "generate sweep.toml --out corpus --json"),
    ("label", "label corpus --json"),
    ("detect", "detect corpus --model {model} --force --json"),
    ("verify", "verify corpus --no-decode --json"),
    (
        "train",
        "train corpus --out run --config training.toml --seed 1 --json",
    ),
    ("evaluate", "evaluate run --corpus corpus --json"),
    (
        "train-detector",
        "train-detector corpus --out detector/new.onnx --minutes 0.001 --json",
    ),
    ("push", "push corpus {store} --json"),
    ("fetch", "fetch {store} --out corpus --json"),
];

/// Files that only their owner may touch, next to ours and with names like our temporary ones.
const NOTES: [&str; 3] = [
    "corpus/notes.new",
    "corpus/plan.json.mine.tmp",
    "run.notes.tmp",
];

/// A corpus with work for every verb: a scenario is still to be recorded, or to be downloaded from the store, which has it; two have labels
/// that are slightly off, within every check's tolerance.
struct Start {
    tiny: Tiny,
    /// The scenario that is only in the store.
    absent: String,
    /// The result of `verify --no-decode` before the race.
    findings: Value,
}

static START: LazyLock<Start> = LazyLock::new(|| {
    let tiny = Tiny::made().copy();
    let corpus = Corpus::open(&tiny.corpus()).unwrap();
    let splits: Value = serde_json::from_slice(&fs::read(corpus.splits_path()).unwrap()).unwrap();
    let training: Vec<_> = corpus
        .scenarios()
        .unwrap()
        .into_iter()
        .filter(|folder| splits["scenarios"][folder.id()]["side"] == "train")
        .collect();
    let [first, second, .., last] = &training[..] else {
        panic!("{} training scenarios", training.len());
    };
    tiny::label_otherwise([first, second]);
    tiny.leave_to_store(last.root());
    for name in NOTES {
        fs::write(tiny.path(name), name).unwrap();
    }
    let note = first.root().join("notes.new");
    fs::write(note, "a user's").unwrap();
    let findings = findings(&tiny, "corpus");
    Start {
        absent: last.id(),
        findings,
        tiny,
    }
});

fn must(tiny: &Tiny, arguments: &[impl AsRef<std::ffi::OsStr>]) -> Value {
    let output = tiny.dtd(arguments).succeeds();
    serde_json::from_slice(&output.stdout).unwrap_or_default()
}

/// The result of `verify --no-decode`.
fn findings(tiny: &Tiny, corpus: &str) -> Value {
    let output = tiny
        .dtd(&["verify", corpus, "--no-decode", "--json"])
        .output()
        .unwrap();
    let report: Value = serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|error| panic!("{error}: {}", said(&output)));
    report["findings"].clone()
}

/// True if a verb may end so while `other` ran.
fn is_true_ending(verb: &str, other: &str, output: &Output) -> bool {
    let adds_scenarios = ["generate", "fetch"].contains(&other);
    let words = said(output);
    // The other one downloaded or recorded a scenario without labels or detections.
    let met_new_one = ["train", "evaluate", "train-detector"].contains(&verb)
        && adds_scenarios
        && words.contains(&START.absent)
        && (words.contains("dtd label") || words.contains("dtd detect"));
    match output.status.code() {
        Some(0) => true,
        // A second process holds it; the message says so.
        Some(75) => words.contains("error: "),
        // A scenario that the other one changed in the meantime differs from the store's, and its detections are newer.
        Some(3) if verb == "fetch" => {
            ["generate", "label", "detect", "push", "fetch"].contains(&other)
        }
        // Labels and detections that were replaced in the meantime differ from the store's, which stay.
        Some(3) if verb == "push" => ["label", "detect"].contains(&other),
        Some(2 | 3) => met_new_one,
        _ => false,
    }
}

/// Races two verbs once; returns everything that is wrong afterwards.
fn race(first: usize, second: usize, apart: Duration) -> Vec<String> {
    let tiny = START.tiny.copy();
    let before = tiny.files();
    let [one, other] = [(first, Duration::ZERO), (second, apart)]
        .map(|(verb, pause)| {
            let mut command = tiny.dtd(&tiny.arguments(VERBS[verb].1));
            thread::spawn(move || {
                // Not waiting for anything: the delay is the variable.
                thread::sleep(pause);
                tiny::run(&mut command, TOO_LONG)
            })
        })
        .map(|thread| thread.join().unwrap());
    let mut wrong = Vec::new();
    let names = [VERBS[first].0, VERBS[second].0];
    for (verb, partner, ended) in [(names[0], names[1], &one), (names[1], names[0], &other)] {
        match ended {
            None => wrong.push(format!("{verb} hung")),
            Some(output) => {
                let words = said(output);
                // A message names the missing file and the reason, not an error number.
                let is_raw = words.contains("panicked") || words.contains("os error");
                if !is_true_ending(verb, partner, output) || is_raw {
                    wrong.push(format!("{verb} ended with {}: {words}", output.status));
                }
            }
        }
    }
    for name in NOTES {
        if fs::read(tiny.path(name)).ok().as_deref() != Some(name.as_bytes()) {
            wrong.push(format!("the user's {name} is gone or changed"));
        }
    }
    let after: BTreeSet<String> = tiny.files().into_iter().collect();
    let lost = before.iter().filter(|name| !after.contains(*name));
    // A new training removes the results of the old one.
    let replaced = |name: &str| names.contains(&"train") && name.starts_with("run/");
    for name in lost.filter(|name| !replaced(name)) {
        wrong.push(format!("{name} is lost"));
    }
    for name in after
        .iter()
        .filter(|name| !before.contains(name) && is_leftover(name))
    {
        wrong.push(format!("{name} is left over"));
    }
    let found = findings(&tiny, "corpus");
    if found != START.findings {
        wrong.push(format!("verify finds {found}"));
    }
    let plan = must(
        &tiny,
        &["plan", "sweep.toml", "--against", "corpus", "--json"],
    );
    let to_make = plan["against"]["to_make"].as_array().unwrap();
    if to_make.iter().any(|id| *id != START.absent.as_str())
        || plan["against"]["whole"].as_array().unwrap().len() + to_make.len() != tiny::SCENARIOS
    {
        wrong.push(format!(
            "scenarios would be recorded again: {}",
            plan["against"]
        ));
    }
    if names.contains(&"push") {
        must(&tiny, &["fetch", &tiny.store(), "--out", "fetched"]);
        let found = findings(&tiny, "fetched");
        if found != serde_json::json!([]) {
            wrong.push(format!("in the store verify finds {found}"));
        }
    }
    if names == ["train", "evaluate"]
        || names == ["evaluate", "train"]
        || names == ["train", "train"]
    {
        wrong.extend(mixed_run(&tiny));
    }
    wrong
}

/// True if a file should have been renamed by the end.
fn is_leftover(name: &str) -> bool {
    Path::new(name).components().any(|part| {
        let part = part.as_os_str().to_string_lossy();
        part == "claims"
            || [".partial", ".tmp", ".new"]
                .iter()
                .any(|end| part.ends_with(end))
    })
}

/// A run's results must come from its weights: metrics from a different run are worse than none.
fn mixed_run(tiny: &Tiny) -> Option<String> {
    let metrics = tiny.path("run/metrics.json");
    let stored = fs::read(&metrics).ok()?;
    let stored: Value = serde_json::from_slice(&stored).unwrap();
    let again = must(tiny, &["evaluate", "run", "--corpus", "corpus", "--json"]);
    (stored["estimators"] != again["estimators"])
        .then(|| "metrics.json is of other weights than those beside it".into())
}

fn number(variable: &str, default: u64) -> u64 {
    match env::var(variable) {
        Ok(text) => text
            .parse()
            .unwrap_or_else(|_| panic!("{variable} is {text:?}, expected a number")),
        Err(_) => default,
    }
}

#[test]
fn two_verbs_at_once_lose_nothing_and_end_truly() {
    let rounds = number("DTD_RACE_ROUNDS", 1);
    let seed = number("DTD_RACE_SEED", 1);
    let only = env::var("DTD_RACE_VERBS").ok();
    let is_asked = |verb: usize| {
        only.as_ref()
            .is_none_or(|only| only.split(',').any(|name| name == VERBS[verb].0))
    };
    // The duration of each alone, so that the second begins anywhere within the first.
    let alone = VERBS.each_ref().map(|_| Duration::ZERO);
    let mut alone = alone;
    for (verb, took) in alone.iter_mut().enumerate() {
        let tiny = START.tiny.copy();
        let began = Instant::now();
        must(&tiny, &tiny.arguments(VERBS[verb].1));
        *took = began.elapsed();
    }
    let mut random = ChaCha12Rng::seed_from_u64(seed);
    let (mut raced, mut wrong) = (0, Vec::new());
    for round in 0..rounds {
        for first in 0..VERBS.len() {
            for second in first..VERBS.len() {
                let part = random.random_range(0.0..1.0);
                let swap = random.random_bool(0.5);
                if !(is_asked(first) && is_asked(second)) {
                    continue;
                }
                let (first, second) = if swap {
                    (second, first)
                } else {
                    (first, second)
                };
                let apart = alone[first].mul_f64(part);
                let names = format!(
                    "{} and, {apart:?} later, {}",
                    VERBS[first].0, VERBS[second].0
                );
                raced += 1;
                for fault in race(first, second, apart) {
                    eprintln!("round {round} of seed {seed}: {names}: {fault}");
                    wrong.push(format!("{names}: {fault}"));
                }
            }
        }
    }
    println!("{raced} races, {} faults", wrong.len());
    assert!(
        wrong.is_empty(),
        "{} faults in {raced} races, see above",
        wrong.len()
    );
}
