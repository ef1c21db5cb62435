//! How much memory more ticks take: the full corpus, 770,000 ticks of two registered views, is to be trained and evaluated in a gibibyte.

use std::fs;
use std::path::Path;

use dataset::corpus::Corpus;
use dataset::frame_rate::FrameRate;
use dataset::progress::Silent;
use testkit::synthetic::SyntheticCorpus;
use trainer::config::Optimisation;
use trainer::{EvaluationConfig, JudgedSide, RunFolder, TrainConfig, evaluate, predict, train};

const GIB: f64 = (1_u64 << 30) as f64;
const FULL_TICKS: f64 = 770_000.0;

/// Seven flights with registered views, at so many pictures a second.
fn corpus(folder: &Path, rate: u32, seed: u64) -> Corpus {
    let corpus = SyntheticCorpus {
        frame_rate: FrameRate {
            numerator: rate,
            denominator: 1,
        },
        shift_noise_px: Some(0.05),
        seed,
        ..SyntheticCorpus::tiny()
    };
    corpus.write(folder).unwrap()
}

fn hardly_trained() -> TrainConfig {
    let steps = Optimisation {
        steps: 20,
        batch_size: 16,
        learning_rate: 1e-3,
    };
    let mut config = TrainConfig::default();
    config.calibration.hidden = vec![8];
    config.calibration.features = 8;
    config.calibration.head_hidden = vec![8];
    config.calibration.optimisation = steps.clone();
    config.estimator.lstm = vec![8];
    config.estimator.head_hidden = vec![8];
    config.estimator.optimisation = steps.clone();
    config.mono.hidden = vec![8];
    config.mono.optimisation = steps;
    config
}

/// The most memory that this process had while something ran, bytes.
fn peak_bytes(run: impl FnOnce()) -> f64 {
    // Forgets the peak so far.
    fs::write("/proc/self/clear_refs", "5").unwrap();
    run();
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmHWM:"));
    let kib = line.unwrap().split_whitespace().nth(1).unwrap();
    kib.parse::<f64>().unwrap() * 1_024.0
}

/// The only test of this file: memory is that of the process.
#[test]
fn the_full_corpus_is_trained_evaluated_and_predicted_in_a_gibibyte() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let rates = [1, 6];
    let ticks = rates.map(|rate| {
        let seen = corpus(&path(&format!("seen-{rate}")), rate, 0);
        corpus(&path(&format!("new-{rate}")), rate, 1);
        let rows = |scenario: &dataset::corpus::ScenarioFolder| {
            scenario.open().unwrap().frames().unwrap().rows.len()
        };
        seen.scenarios().unwrap().iter().map(rows).sum::<usize>() as f64
    });
    let open = |name: &str| Corpus::open(&path(name)).unwrap();
    let run = |rate: u32| path(&format!("run-{rate}"));
    let verbs: [(&str, &dyn Fn(u32)); 3] = [
        ("train", &|rate| {
            let corpus = open(&format!("seen-{rate}"));
            train(&corpus, &run(rate), &hardly_trained(), &mut Silent).unwrap();
        }),
        ("evaluate", &|rate| {
            let config = EvaluationConfig {
                side: JudgedSide::All,
                out: Some(path(&format!("judged-{rate}"))),
                ..EvaluationConfig::default()
            };
            let corpus = open(&format!("new-{rate}"));
            evaluate(&RunFolder::at(&run(1)), &corpus, &config, &mut Silent).unwrap();
        }),
        ("predict", &|rate| {
            let corpus = open(&format!("new-{rate}"));
            let out = path(&format!("predicted-{rate}.parquet"));
            predict(&RunFolder::at(&run(1)), &corpus, None, &out, &mut Silent).unwrap();
        }),
    ];
    let mut wrong = Vec::new();
    for (name, verb) in verbs {
        let [few, many] = rates.map(|rate| peak_bytes(|| verb(rate)));
        let per_tick = (many - few) / (ticks[1] - ticks[0]);
        let full_gib = (few + per_tick * (FULL_TICKS - ticks[0])) / GIB;
        println!("{name}: {per_tick:.0} bytes a tick, {full_gib:.2} GiB for the full corpus");
        if full_gib >= 1.0 {
            wrong.push(format!("{name} takes {full_gib:.2} GiB"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join(", "));
}
