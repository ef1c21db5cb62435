//! `dtd demo`: the whole pipeline at small scale.

use std::path::{Path, PathBuf};
use std::slice;
use std::time::{Duration, Instant};

use dataset::corpus::Corpus;
use dataset::corpus::workshop::lock;
use generator::generate::SimulatorTarget;
use generator::sweep::Sweep;
use labeller::DetectOutcome;
use serde::Serialize;
use trainer::{EvaluationConfig, Metrics, RunFolder, TrainConfig};

use super::Outcome;
use super::detect::{self, detect, in_sight, refuse_other_models};
use super::evaluate::{evaluate, print_metrics};
use super::generate::{ending_of, generate, options};
use super::label::{self, label};
use super::output::{Next, count, finish, print_json};
use super::train::train;
use crate::args::experiment::DemoArgs;
use crate::failure::{Ending, Failure};
use crate::shipped::Shipped;

/// Videos whose paths are printed for a first look.
const VIDEOS_TO_SHOW: usize = 2;

/// Runs the verb.
pub(crate) fn run(args: &DemoArgs) -> Outcome {
    let began = Instant::now();
    let shipped = Shipped::unpack()?;
    let sweep = args.sweep.clone().unwrap_or_else(|| shipped.demo_sweep());
    let model = args.model.clone().unwrap_or_else(|| shipped.detector());
    let sweep = Sweep::read(&sweep).map_err(Failure::bad_input)?;
    refuse_other_models(&model)?;
    let claim = lock(&args.out, &args.out, Duration::ZERO).map_err(Failure::of_corpus)?;
    let _claim = claim.in_existing_folder();
    let [corpus, run] = ["corpus", "run"].map(|name| args.out.join(name));
    eprintln!(
        "demo: records {} into {}, searches them and trains on them; Ctrl-C stops it, and the same command resumes",
        count(sweep.combinations.len(), "scenario"),
        corpus.display()
    );
    let options = options(SimulatorTarget::StandIn.into())?;
    let generated = generate(&sweep, &corpus, &options)?;
    match ending_of(&generated)? {
        Ending::Done => {}
        other => {
            for failed in &generated.failed {
                eprint_warning!("demo: {}: {}", failed.id, failed.reason);
            }
            return Ok(other);
        }
    }
    let corpus = Corpus::open(&corpus)?;
    let labelled = label::ending_of(&label(&corpus)?);
    if labelled == Ending::Interrupted {
        return Ok(labelled);
    }
    let detected = detect(&corpus, &model, args.runtime.options())?;
    let ending = detect::ending_of(&detected).and(labelled);
    if ending != Ending::Done {
        return Ok(ending);
    }
    // An earlier demo may have left detections of a different model.
    let config = TrainConfig {
        model_hash: Some(detected.model_hash.clone()),
        ..TrainConfig::demo()
    };
    train(slice::from_ref(&corpus), &run, &config, false)?;
    let metrics = evaluate(&run, &corpus, &EvaluationConfig::default())?;
    let run_folder = RunFolder::at(&run);
    let result = DemoResult {
        scenarios: corpus.scenarios()?.len(),
        corpus: corpus.root(),
        run: &run,
        report: run_folder.report_path(),
        metrics_file: run_folder.metrics_path(),
        videos: videos(&corpus)?,
        detections: &detected,
        metrics: &metrics,
    };
    if args.json {
        print_json(&result)?;
    } else {
        result.print();
    }
    let next = Next::verb("view", corpus.root()).and("--run");
    finish("demo", began, &next.and(run.display()));
    Ok(Ending::Done)
}

/// Results of the demo; with `--json` the document that it prints.
#[derive(Serialize)]
struct DemoResult<'a> {
    corpus: &'a Path,
    run: &'a Path,
    report: PathBuf,
    metrics_file: PathBuf,
    videos: Vec<PathBuf>,
    scenarios: usize,
    detections: &'a DetectOutcome,
    metrics: &'a Metrics,
}

impl DemoResult<'_> {
    fn print(&self) {
        let detected = self.detections;
        println!("scenarios       {}", self.scenarios);
        println!("frames          {} in all views", detected.counts.pictures);
        if let Some(truth) = &detected.counts.against_truth {
            println!("aircraft        {}", in_sight(truth));
            if let Some(error_px) = truth.mean_center_error_px() {
                println!(
                    "centre error    {error_px:.2} px on average, {} false detections",
                    truth.false_detections
                );
            }
        }
        println!();
        print_metrics(self.metrics);
        println!();
        println!("report          {}", self.report.display());
        println!("metrics         {}", self.metrics_file.display());
        for video in self.videos.iter().take(VIDEOS_TO_SHOW) {
            println!("video           {}", video.display());
        }
    }
}

/// The videos of all scenarios.
fn videos(corpus: &Corpus) -> Result<Vec<PathBuf>, Failure> {
    let mut videos = Vec::new();
    for scenario in corpus.scenarios()? {
        let record = scenario.open()?.record()?;
        videos.extend(record.views.iter().map(|view| scenario.video_path(view)));
    }
    Ok(videos)
}
