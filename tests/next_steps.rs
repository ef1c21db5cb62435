//! The `next:` that a verb prints is a command that works.

mod tiny;

use std::fs;
use std::process::{Command, Output, Stdio};

use serde_json::{Value, json as value};
use testkit::command::{Dtd, Ending, json, said};
use tiny::{MODEL, Tiny};

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

/// Settings of a model that do what it does without them: under another name, it is a second model.
const SETTINGS: &str = r#"
layout = "rows"
aircraft_class = 0
box_origin = "pixel-center"
"#;

/// A corpus in a folder whose name a shell would take apart, and a run.
struct Bench {
    tiny: Tiny,
}

impl Bench {
    fn new() -> Self {
        let tiny = Tiny::made().copy();
        fs::rename(tiny.path("corpus"), tiny.path("my corpus")).unwrap();
        fs::copy(MODEL, tiny.path("second.onnx")).unwrap();
        fs::write(tiny.path("second.onnx.toml"), SETTINGS).unwrap();
        // The command under its usual name.
        let bin = tiny.path("bin");
        fs::create_dir(&bin).unwrap();
        std::os::unix::fs::symlink(DTD.program(), bin.join("dtd")).unwrap();
        Self { tiny }
    }

    /// Next command that a successful verb prints, if any.
    fn next_of(&self, verb: &[&str]) -> Option<String> {
        next_in(&self.tiny.dtd(verb).output().unwrap(), &verb.join(" "))
    }

    /// Runs a printed command in a shell, with options that keep it short.
    fn execute(&self, next: &str) -> Option<String> {
        let more = match next.split(' ').nth(1).unwrap() {
            "train" => " --config training.toml",
            "view" => " --port 0 --no-open --until-stdin-ends",
            _ => "",
        };
        let line = format!(
            "PATH={}:$PATH; {next}{more}",
            self.tiny.path("bin").display()
        );
        let plain = self.tiny.dtd(&[] as &[&str]);
        let mut shell = Command::new("sh");
        shell.args(["-c", &line]).current_dir(self.tiny.root());
        shell.envs(
            plain
                .get_envs()
                .filter_map(|(name, value)| Some((name, value?))),
        );
        next_in(&shell.stdin(Stdio::null()).output().unwrap(), next)
    }
}

fn next_in(output: &Output, what: &str) -> Option<String> {
    let said = said(output);
    assert!(output.status.success(), "{what}: {said}");
    let mut lines = said.lines().filter_map(|line| line.split_once("next: "));
    let next = lines.next().map(|(_, command)| command.to_owned());
    assert!(lines.next().is_none(), "{what}: {said}");
    next
}

#[test]
fn each_printed_command_leads_to_the_one_after_it_up_to_the_viewer() {
    let bench = Bench::new();
    let mut next = bench.next_of(&["generate", "sweep.toml", "--out", "my corpus"]);
    let mut steps = Vec::new();
    while let Some(command) = next {
        next = bench.execute(&command);
        steps.push(command);
    }
    let expected = [
        "dtd label 'my corpus'",
        "dtd detect 'my corpus'",
        // A run is there.
        "dtd train 'my corpus' --out run2",
        "dtd evaluate run2 --corpus 'my corpus'",
        "dtd view 'my corpus' --run run2",
    ];
    assert_eq!(steps, expected);
}

#[test]
fn after_a_second_detector_the_next_training_names_its_detections() {
    let bench = Bench::new();
    let folders = fs::read_dir(bench.tiny.path("my corpus/scenarios")).unwrap();
    let part = folders.flatten().next().unwrap().file_name();
    let part = part.to_str().unwrap();
    let detect = ["detect", "my corpus", "--model", "second.onnx"];
    let only = [&detect[..], &["--only", part]].concat();
    assert_eq!(bench.next_of(&only), None, "others are to be searched");
    let train = bench.next_of(&detect).unwrap();
    assert!(
        train.starts_with("dtd train 'my corpus' --out run2 --detections "),
        "{train}"
    );
    let evaluate = bench.execute(&train).unwrap();
    assert_eq!(evaluate, "dtd evaluate run2 --corpus 'my corpus'");
    assert!(bench.execute(&evaluate).is_some());
}

#[test]
fn copied_sweeps_are_planned_next_and_results_elsewhere_are_looked_at() {
    let bench = Bench::new();
    let next = bench.next_of(&["examples", "sweeps"]).unwrap();
    assert_eq!(next, "dtd plan sweeps/scenarios.toml");
    assert_eq!(bench.execute(&next), None);
    let judged = [
        "evaluate",
        "run",
        "--corpus",
        "my corpus",
        "--out",
        "judged",
    ];
    let next = bench.next_of(&judged).unwrap();
    assert_eq!(next, "dtd view 'my corpus' --run judged");
    assert_eq!(bench.execute(&next), None);
}

/// On demand: it trains for 20 seconds.
#[test]
#[ignore = "20 seconds; --ignored runs it"]
fn the_demo_prints_its_result_as_json_and_leads_to_the_viewer() {
    let bench = Bench::new();
    let demo = ["demo", "--sweep", "sweep.toml", "--out", "demo", "--json"];
    let output = bench.tiny.dtd(&demo).output().unwrap();
    let next = next_in(&output, "demo").unwrap();
    assert_eq!(next, "dtd view demo/corpus --run demo/run");
    assert_eq!(bench.execute(&next), None);
    let result = json(&output);
    assert_eq!(
        (&result["scenarios"], &result["corpus"]),
        (&5.into(), &"demo/corpus".into())
    );
    let metrics = fs::read(bench.tiny.path(result["metrics_file"].as_str().unwrap())).unwrap();
    let metrics: Value = serde_json::from_slice(&metrics).unwrap();
    assert_eq!(result["metrics"], metrics);
    for video in result["videos"].as_array().unwrap() {
        assert!(
            bench.tiny.path(video.as_str().unwrap()).is_file(),
            "{video}"
        );
    }
}

#[test]
fn the_status_of_a_corpus_counts_stages_and_names_what_is_in_work_and_failed() {
    let tiny = Tiny::made().copy();
    let status = |of: &str| json(&tiny.line(&format!("status {of} --json")).succeeds());
    tiny.line("push corpus {store}").succeeds();
    let ids: Vec<_> = tiny
        .scenarios()
        .iter()
        .map(|path| path.file_name().unwrap().to_owned())
        .collect();
    let scenario = |index: usize| tiny.corpus().join("scenarios").join(&ids[index]);

    // The first is being recorded again, the second has failed, the third has not been searched.
    let mut partial = scenario(0).into_os_string();
    partial.push(".partial");
    fs::rename(scenario(0), &partial).unwrap();
    fs::remove_dir_all(scenario(1)).unwrap();
    let id = ids[1].to_str().unwrap();
    let failed = value!({ "id": id, "config_hash": "", "reasons": ["no weather", "no image"] });
    fs::create_dir(tiny.corpus().join("failed")).unwrap();
    fs::write(
        tiny.corpus().join(format!("failed/{id}.json")),
        failed.to_string(),
    )
    .unwrap();
    fs::remove_dir_all(scenario(2).join("detections")).unwrap();

    let found = status("corpus");
    let counts =
        ["planned", "recorded", "labelled", "searched"].map(|stage| found[stage].as_u64().unwrap());
    assert_eq!(counts, [5, 3, 3, 2], "{found}");
    assert_eq!(
        found["in_work"][0]["id"],
        ids[0].to_str().unwrap(),
        "{found}"
    );
    assert_eq!(
        found["failed"][id],
        value!(["no weather", "no image"]),
        "{found}"
    );
    // One of the two has begun.
    let [left_s, pace_s] = [&found["left_s"], &found["pace"]["s_per_scenario"]];
    let left = left_s.as_f64().unwrap() / pace_s.as_f64().unwrap();
    assert!((1.0..=2.0).contains(&left), "{found}");
    let shown = said(&tiny.line("status corpus").succeeds());
    assert!(
        shown.contains("3 of 5 recorded, 3 labelled, 2 searched"),
        "{shown}"
    );
    assert!(shown.contains("2 attempts; the last: no image"), "{shown}");

    let found = status("{store}");
    let counts =
        ["planned", "recorded", "labelled", "searched"].map(|stage| found[stage].as_u64().unwrap());
    assert_eq!(counts, [5; 4], "{found}");
    assert_eq!(found["left_s"], 0.0, "{found}");
}
