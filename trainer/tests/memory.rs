//! Memory by number of flights, extrapolated to the full corpus, 770,000 ticks of two registered views. The target is one gibibyte:
//! training and predicting took 0.5, evaluating 0.5 to 0.7.

use std::path::Path;
use std::process::Command;
use std::{env, fs};

use dataset::corpus::Corpus;
use dataset::numbers::frame_rate::FrameRate;
use dataset::work::watch::Silent;
use testkit::synthetic::SyntheticCorpus;
use trainer::{EvaluationConfig, JudgedSide, Moment, RunFolder, evaluate, predict, train};

mod hardly_trained;
use hardly_trained::hardly_trained;

const GIB: f64 = (1_u64 << 30) as f64;
const FULL_TICKS: f64 = 770_000.0;
const MAX_GIB: f64 = 1.0;

/// Flights with registered views, seven for each of `times`.
fn corpus(folder: &Path, times: usize, seed: u64) -> Corpus {
    let tiny = SyntheticCorpus::tiny();
    let corpus = SyntheticCorpus {
        train: tiny.train * times,
        validation: tiny.validation * times,
        test: tiny.test * times,
        frame_rate: FrameRate {
            numerator: 2,
            denominator: 1,
        },
        shift_noise_px: Some(0.05),
        seed,
        ..tiny
    };
    corpus.write(folder).unwrap()
}

/// Names what a process of this test runs, which folder it works in, and the size of its corpora.
const PROCESS: &str = "DTD_TEST_MEMORY_OF";
const TEST: &str = "the_full_corpus_is_trained_evaluated_and_predicted_in_a_gibibyte";

/// Peak memory of a separate process that runs a verb, bytes: a process that had run another verb would still hold memory from it.
fn peak_bytes(verb: &str, folder: &Path, times: usize) -> f64 {
    let output = Command::new(env::current_exe().unwrap())
        .args(["--exact", TEST, "--nocapture"])
        .env(PROCESS, format!("{verb} {times} {}", folder.display()))
        .output()
        .unwrap();
    let printed = String::from_utf8_lossy(&output.stdout).into_owned();
    let line = printed.lines().find(|line| line.starts_with("VmHWM:"));
    let line = line.unwrap_or_else(|| panic!("{verb}: {printed}"));
    let kib = line.split_whitespace().nth(1).unwrap();
    kib.parse::<f64>().unwrap() * 1_024.0
}

/// Body of such a process.
fn run_verb(verb: &str, folder: &Path, times: &str) {
    let path = |name: &str| folder.join(name);
    let open = |name: &str| Corpus::open(&path(&format!("{name}-{times}"))).unwrap();
    let run = RunFolder::at(&path("run-1"));
    match verb {
        "train" => {
            let out = path(&format!("run-{times}"));
            train(&open("seen"), &out, &hardly_trained(), &Silent).unwrap();
        }
        "evaluate" => {
            let config = EvaluationConfig {
                side: JudgedSide::All,
                out: Some(path(&format!("judged-{times}"))),
                ..EvaluationConfig::default()
            };
            evaluate(&run, &open("new"), &config, &Silent).unwrap();
        }
        _ => {
            let out = path(&format!("predicted-{times}.parquet"));
            predict(&run, &open("new"), None, &out, Moment::Hindsight, &Silent).unwrap();
        }
    }
    let status = fs::read_to_string("/proc/self/status").unwrap();
    println!();
    for line in status.lines().filter(|line| line.starts_with("VmHWM:")) {
        println!("{line}");
    }
}

#[test]
fn the_full_corpus_is_trained_evaluated_and_predicted_in_a_gibibyte() {
    if let Ok(process) = env::var(PROCESS) {
        let mut words = process.splitn(3, ' ');
        let mut word = || words.next().unwrap();
        let (verb, times, folder) = (word(), word(), word());
        return run_verb(verb, Path::new(folder), times);
    }
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let sizes = [1, 4];
    let ticks = sizes.map(|times| {
        let seen = corpus(&path(&format!("seen-{times}")), times, 0);
        corpus(&path(&format!("new-{times}")), times, 1);
        let rows = |scenario: &dataset::corpus::ScenarioFolder| {
            scenario.open().unwrap().frames().unwrap().rows.len()
        };
        seen.scenarios().unwrap().iter().map(rows).sum::<usize>() as f64
    });
    let mut wrong = Vec::new();
    for verb in ["train", "evaluate", "predict"] {
        let [few, many] = sizes.map(|times| peak_bytes(verb, folder.path(), times));
        let per_tick = (many - few) / (ticks[1] - ticks[0]);
        let full_gib = (few + per_tick * (FULL_TICKS - ticks[0])) / GIB;
        println!("{verb}: {per_tick:.0} bytes a tick, {full_gib:.2} GiB for the full corpus");
        if full_gib >= MAX_GIB {
            wrong.push(format!("{verb} takes {full_gib:.2} GiB"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join(", "));
}
