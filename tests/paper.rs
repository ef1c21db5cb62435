//! `dtd paper --scale small`: it makes the page, and killed in its stages and started again it arrives at the same figures. Images and
//! steps are few: figures are compared, not judged.

mod tiny;

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, ChildStderr, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use serde_json::Value;
use testkit::command::{Dtd, Ending, said};

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

/// Stages that are killed, and the delay after their start.
const KILLED_IN: [(&str, Duration); 4] = [
    ("corpus", Duration::from_millis(1_500)),
    (
        "detections of the weaker detector",
        Duration::from_millis(200),
    ),
    ("training, scenarios drawn", Duration::from_millis(100)),
    ("ranges", Duration::from_millis(200)),
];

/// The experiment beside the folder that it makes.
fn command(line: &str, out: &Path) -> Command {
    let words: Vec<&str> = line.split(' ').collect();
    let mut command = DTD.command(&words);
    command.current_dir(out.parent().unwrap());
    command
}

fn start(out: &Path) -> (Child, BufReader<ChildStderr>) {
    let mut process = command(tiny::PAPER, out)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let stderr = process.stderr.take().unwrap();
    (process, BufReader::new(stderr))
}

/// Runs the command and kills it `later` after a stage's start.
fn kill_in(out: &Path, stage: &str, later: Duration) {
    let (mut process, stderr) = start(out);
    let mut lines = stderr.lines().map_while(Result::ok);
    let words = format!("paper: {stage}");
    assert!(
        lines.any(|line| line.ends_with(&words)),
        "no line {words:?}"
    );
    sleep(later);
    process.kill().unwrap();
    process.wait().unwrap();
    let notes = fs::read_to_string(out.join("PAPER.json")).unwrap();
    let notes: Value = serde_json::from_str(&notes).unwrap();
    let stages = notes["stages"].as_array().unwrap();
    let is_done = |of: &Value| of["name"] == stage && of["is_done"] == true;
    assert!(!stages.iter().any(is_done), "{stage}: killed too late");
}

/// The numbers in the row of the page's table 3 with this name; dashes are left out.
fn numbers(page: &str, name: &str) -> Vec<f64> {
    let row = page
        .lines()
        .find(|line| line.starts_with(&format!("| {name} | 0.")));
    let cells = row.unwrap_or_else(|| panic!("no row {name} in {page}"));
    let cells = cells.trim_start_matches(&format!("| {name} |"));
    let words = cells.split([' ', '|', '/', '(', ')']);
    let words = words.filter(|word| !word.is_empty() && *word != "–");
    words
        .map(|word| {
            word.parse()
                .unwrap_or_else(|_| panic!("{word:?} in {cells}"))
        })
        .collect()
}

/// The figures, without times.
fn figures(out: &Path) -> Value {
    let text = fs::read_to_string(out.join("results/paper.json")).unwrap();
    let mut results: Value = serde_json::from_str(&text).unwrap();
    results.as_object_mut().unwrap().remove("stages");
    for split in ["by_trajectory", "by_scenario"] {
        let training = results[split]["training"].as_object_mut().unwrap();
        training.remove("training_s");
    }
    for range in results["ranges"].as_array_mut().unwrap() {
        range.as_object_mut().unwrap().remove("cpu_ms_per_picture");
    }
    results
}

#[test]
fn the_papers_experiment_makes_its_page_and_killed_four_times_the_same_figures() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, killed) = (tiny::paper().join("paper"), folder.path().join("paper"));
    let training = "training.toml";
    fs::copy(tiny::paper().join(training), folder.path().join(training)).unwrap();
    let page = fs::read_to_string(whole.join("paper.md")).unwrap();
    for part in ["9.95", "not done, because", "100 recorded landings"] {
        assert!(page.contains(part), "no {part:?} in {page}");
    }
    for condition in ["clear", "06:00"] {
        // MAPE and SD of two views and of at least one in five columns, without SD in a sixth; one estimator needs two views.
        assert!(numbers(&page, condition).len() >= 20, "{page}");
    }
    for figure in page
        .split("](")
        .skip(1)
        .filter_map(|rest| rest.split(')').next())
    {
        assert!(whole.join(figure).is_file(), "{figure}");
    }
    for (words, later) in KILLED_IN {
        kill_in(&killed, words, later);
    }
    let output = command(tiny::PAPER, &killed).succeeds();
    assert!(
        said(&output).contains("paper: labels: done already"),
        "{}",
        said(&output)
    );
    assert_eq!(figures(&killed), figures(&whole));
    let otherwise = tiny::PAPER.replace("1/12", "1");
    command(&otherwise, &killed).ends_with(2, &["another sweep or frame rate"]);
}
