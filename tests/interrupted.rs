//! Ctrl-C in the verbs that take long: they end with 75 and say what to do, and the same command then arrives at the bytes of undisturbed
//! runs. So does a training with saved settings.

mod tiny;

use std::ffi::OsString;
use std::fs;
use std::process::{Child, Output, Stdio};
use std::thread::sleep;
use std::time::Duration;

use dataset::corpus::{Corpus, ScenarioFolder};
use rustix::process::{Pid, Signal, kill_process};
use testkit::TINY_TRAINING;
use testkit::command::{json, said};
use testkit::files::{assert_same_contents, contents};
use tiny::{SCENARIOS, Tiny, label_otherwise};

/// Time of the first signal after a command's start, and the delay to the next one.
const LATER: Duration = Duration::from_millis(4);
/// Attempts to hit a verb while it is at work.
const MAX_ATTEMPTS: u32 = 300;
/// Message at the first signal, for a working verb.
const IS_STOPPING: &str = "stopping cleanly";

const DETECTOR: &str = "
[training]
effort = { steps = 4 }
";

fn start(tiny: &Tiny, line: &str) -> Child {
    tiny.dtd(&tiny.arguments(line))
        // Scenario after scenario.
        .env("RAYON_NUM_THREADS", "1")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

fn send(process: &Child, signal: Signal) {
    kill_process(Pid::from_child(process), signal).unwrap();
}

/// Runs a command to its end.
fn run(tiny: &Tiny, line: &str) -> Output {
    let output = start(tiny, line).wait_with_output().unwrap();
    assert!(output.status.success(), "{line}: {}", said(&output));
    output
}

/// Files and output of a command: undisturbed, and interrupted and run again.
struct Ran {
    undisturbed: (Tiny, Output),
    interrupted: Output,
    /// Names beside the corpus after the interruption.
    left: Vec<OsString>,
    again: (Tiny, Output),
}

/// Runs a command in a prepared copy of the tiny corpus, once undisturbed, and once interrupted while it was at work and then again.
fn interrupted(line: &str, prepare: impl Fn(&Tiny)) -> Ran {
    let prepared = || {
        let tiny = Tiny::made().copy();
        prepare(&tiny);
        tiny
    };
    let undisturbed = prepared();
    let output = run(&undisturbed, line);
    let undisturbed = (undisturbed, output);
    let mut delay = Duration::ZERO;
    let mut tiny = prepared();
    for _ in 0..MAX_ATTEMPTS {
        let process = start(&tiny, line);
        sleep(delay);
        // Handled as Ctrl-C is, but not ignored before that by a process that a shell started in the background.
        send(&process, Signal::TERM);
        let output = process.wait_with_output().unwrap();
        match output.status.code() {
            Some(75) if said(&output).contains(IS_STOPPING) => {
                let beside = fs::read_dir(tiny.path("")).unwrap();
                let left = beside.map(|entry| entry.unwrap().file_name()).collect();
                let again = run(&tiny, line);
                return Ran {
                    undisturbed,
                    interrupted: output,
                    left,
                    again: (tiny, again),
                };
            }
            // Too early: it was not at work yet.
            None | Some(75) => delay += LATER,
            // Too late.
            Some(0) => {
                delay = delay * 2 / 3;
                tiny = prepared();
            }
            Some(_) => panic!("{line}: {}", said(&output)),
        }
    }
    panic!("{line}: never hit at work");
}

impl Ran {
    /// The command said how to go on; with `--json` also the remaining work.
    fn resumes(&self) -> &Self {
        let said = said(&self.interrupted);
        assert!(said.contains("interrupted: "), "{said}");
        assert!(
            said.contains("run the same command again to resume"),
            "{said}"
        );
        self
    }

    fn says_what_is_left(&self) -> &Self {
        // If a transfer had to be dropped, or was stopped before it began, there is no result.
        if !self.interrupted.stdout.is_empty() {
            let outcome = json(&self.interrupted);
            assert_eq!(outcome["stopped"], true, "{outcome}");
            let left = outcome["left"].as_array().unwrap().len();
            assert!((1..=SCENARIOS).contains(&left), "{outcome}");
        }
        self
    }

    fn left_no(&self, names: &[&str]) -> &Self {
        let left = |name: &&str| self.left.iter().any(|found| found == name);
        assert!(!names.iter().any(left), "{:?}", self.left);
        self
    }

    fn starts_over(&self) -> &Self {
        let said = said(&self.interrupted);
        let words = "interrupted: there are no results; run the same command again";
        assert!(said.contains(words), "{said}");
        assert!(self.interrupted.stdout.is_empty(), "{said}");
        self
    }

    /// A file or folder is the same as without the interruption.
    fn made_the_same(&self, name: &str) -> &Self {
        let [again, undisturbed] =
            [&self.again, &self.undisturbed].map(|(tiny, _)| tiny.path(name));
        if undisturbed.is_dir() {
            assert_same_contents(&again, &undisturbed);
        } else {
            assert!(
                fs::read(again).unwrap() == fs::read(undisturbed).unwrap(),
                "{name} differs"
            );
        }
        self
    }
}

fn folders(tiny: &Tiny) -> Vec<ScenarioFolder> {
    Corpus::open(&tiny.corpus()).unwrap().scenarios().unwrap()
}

#[test]
fn labels_and_transfers_resume_with_the_scenarios_that_were_left() {
    interrupted("label corpus --json", |tiny| {
        label_otherwise(&folders(tiny));
    })
    .resumes()
    .says_what_is_left()
    .made_the_same("corpus");

    let pushed = interrupted("push corpus {store} --json", |_| {});
    pushed.resumes().says_what_is_left();
    let (tiny, _) = &pushed.again;
    let objects = |tiny: &Tiny| {
        let mut objects = contents(&tiny.path("store"));
        // The seals record when their objects were written.
        objects.retain(|(name, _)| !name.ends_with("DONE.json"));
        objects
    };
    assert!(objects(tiny) == objects(&pushed.undisturbed.0));
    run(tiny, "fetch {store} --out fetched");
    assert_same_contents(&tiny.path("fetched"), &tiny.corpus());

    interrupted("fetch {store} --out fetched --json", |tiny| {
        run(tiny, "push corpus {store}");
    })
    .resumes()
    .says_what_is_left()
    .made_the_same("fetched");
}

#[test]
fn trainings_resume_to_the_same_weights() {
    let trained = interrupted("train corpus --out new --config long.toml", |tiny| {
        fs::write(tiny.path("long.toml"), TINY_TRAINING).unwrap();
    });
    trained.resumes();
    for name in [
        "config.json",
        "weights.safetensors",
        "normalisation.json",
        "baselines.json",
        "convergence.json",
    ] {
        trained.made_the_same(&format!("new/{name}"));
    }
    interrupted(
        "train-detector corpus --out new.onnx --config detector.toml",
        |tiny| fs::write(tiny.path("detector.toml"), DETECTOR).unwrap(),
    )
    .resumes()
    .made_the_same("new.onnx");
}

#[test]
fn the_settings_that_a_run_saved_make_the_same_run_again() {
    let tiny = Tiny::made().copy();
    run(&tiny, "train corpus --out again --config run/config.json");
    for name in ["config.json", "weights.safetensors"] {
        let [again, first] =
            ["again", "run"].map(|run| fs::read(tiny.path(run).join(name)).unwrap());
        assert!(again == first, "{name} differs");
    }
}

#[test]
fn judgements_leave_nothing_and_start_over() {
    let verified = interrupted("verify corpus --json", |_| {});
    verified.starts_over();
    let [again, undisturbed] = [&verified.again, &verified.undisturbed].map(|(_, output)| output);
    assert!(again.stdout == undisturbed.stdout, "another report");
    interrupted("evaluate run --corpus corpus --out judged", |_| {})
        .starts_over()
        .left_no(&["judged", "judged.partial"])
        .made_the_same("judged");
    interrupted("predict run --corpus corpus --out answers.parquet", |_| {})
        .starts_over()
        .left_no(&["answers.parquet"])
        .made_the_same("answers.parquet");
}

#[test]
fn a_second_signal_ends_a_verb_at_once() {
    let tiny = Tiny::made().copy();
    run(&tiny, "push corpus {store}");
    let fetched = Corpus::create(&tiny.path("fetched")).unwrap();
    let id = folders(&tiny)[0].id();
    // The fetch waits for it.
    let claim = fetched.scenario(&id).claim().unwrap();
    let ended = "interrupted: run the same command again";
    let is_ended_twice = |attempt: u32| {
        let process = start(&tiny, "fetch {store} --out fetched");
        sleep(LATER * attempt);
        send(&process, Signal::TERM);
        sleep(LATER * 10);
        send(&process, Signal::INT);
        let output = process.wait_with_output().unwrap();
        let said = said(&output);
        // Before it waits, the first signal ends it.
        let is_at_second = said.contains(IS_STOPPING) && said.contains(ended);
        assert!(!is_at_second || output.status.code() == Some(75), "{said}");
        is_at_second
    };
    assert!((0..MAX_ATTEMPTS).any(is_ended_twice), "never");
    drop(claim);
    run(&tiny, "fetch {store} --out fetched");
}
