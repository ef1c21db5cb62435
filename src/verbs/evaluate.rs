//! `dtd evaluate`: the errors of a run on the held-out trajectories.

use std::path::Path;

use dataset::corpus::Corpus;
use trainer::{EvaluationConfig, Metrics, RunFolder};

use super::Outcome;
use super::open_corpus::open_corpus;
use super::output::{print_json, print_table};
use super::train::{Bars, failure_of};
use crate::args::EvaluateArgs;
use crate::failure::{Ending, Failure};

/// Runs the verb.
pub(crate) fn run(args: &EvaluateArgs) -> Outcome {
    let corpus = open_corpus(&args.corpus)?;
    let metrics = evaluate(&args.run, &corpus)?;
    if args.json {
        print_json(&metrics)?;
    } else {
        print_metrics(&metrics);
        println!(
            "report: {}",
            RunFolder::at(&args.run).report_path().display()
        );
    }
    Ok(Ending::Done)
}

/// Evaluates a run.
pub(crate) fn evaluate(run: &Path, corpus: &Corpus) -> Result<Metrics, Failure> {
    trainer::evaluate(
        &RunFolder::at(run),
        corpus,
        &EvaluationConfig::default(),
        &mut Bars::default(),
    )
    .map_err(failure_of)
}

/// Prints the errors of each estimator.
pub(crate) fn print_metrics(metrics: &Metrics) {
    let rows: Vec<Vec<String>> = metrics
        .estimators
        .iter()
        .map(|(name, figures)| {
            let [combination, dual] = [&figures.overall.combination, &figures.overall.dual];
            vec![
                name.clone(),
                percent(combination.mape_pct),
                percent(combination.sd_pct),
                combination.samples.to_string(),
                percent(dual.mape_pct),
                percent(dual.sd_pct),
                dual.samples.to_string(),
            ]
        })
        .collect();
    let heading = [
        "estimator",
        "MAPE %",
        "SD %",
        "samples",
        "both views: MAPE %",
        "SD %",
        "samples",
    ];
    print_table(&heading, &rows);
    let test = &metrics.split.test;
    println!(
        "on {} held-out trajectories, {} samples seen by at least one view",
        test.trajectories, test.samples
    );
    if metrics.disbelieved_boxes > 0 {
        println!(
            "{} boxes there were left out: the training side has none of such a place or size",
            metrics.disbelieved_boxes
        );
    }
}

fn percent(value: Option<f64>) -> String {
    value.map_or_else(|| "-".into(), |value| format!("{value:.3}"))
}
