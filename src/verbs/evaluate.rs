//! `dtd evaluate`: the errors of a run on the held-out trajectories.

use std::path::Path;

use dataset::corpus::Corpus;
use trainer::{EvaluationConfig, Metrics, RunFolder};

use super::Outcome;
use super::open_corpus::open_corpus;
use super::output::{count, print_json, print_table};
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
        &mut Bars::of("evaluate"),
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
    let trajectories = match test.trajectories {
        1 => "1 held-out trajectory".to_owned(),
        many => format!("{many} held-out trajectories"),
    };
    let samples = count(test.samples, "sample");
    println!("on {trajectories}, {samples} seen by at least one view");
    match metrics.disbelieved_boxes {
        0 => {}
        1 => println!("1 box was ignored: no training box has such a position or size"),
        many => println!("{many} boxes were ignored: no training box has such a position or size"),
    }
}

fn percent(value: Option<f64>) -> String {
    value.map_or_else(|| "-".into(), |value| format!("{value:.3}"))
}
