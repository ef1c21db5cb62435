//! `dtd evaluate`: errors of a run, or a table of predictions, on the held-out trajectories.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use dataset::corpus::Corpus;
use trainer::{
    EstimatorMetrics, EvaluationConfig, Metrics, RunFolder, TableEvaluationConfig, TableMetrics,
    TickCounts, evaluate_table,
};

use super::Outcome;
use super::open_corpus::{leave_out_unsearched_by_run, open_sound_corpus};
use super::output::{Next, count, finish, print_json, print_table};
use super::train::failure_of;
use crate::args::estimator::EvaluateArgs;
use crate::failure::Failure;
use crate::progress::verb_watch::VerbWatch;

/// Runs the verb.
pub(crate) fn run(args: &EvaluateArgs) -> Outcome {
    let (mut corpus, mut ending) = open_sound_corpus("evaluate", &args.corpus)?;
    let began = Instant::now();
    let results = match (&args.run, &args.predictions) {
        (Some(run), _) => {
            let detections = args.detections.as_deref();
            let searched = leave_out_unsearched_by_run("evaluate", corpus, run, detections)?;
            corpus = searched.0;
            ending = ending.and(searched.1);
            let config = EvaluationConfig {
                side: args.side,
                detections: args.detections.clone(),
                out: args.out.clone(),
            };
            let metrics = evaluate(run, &corpus, &config).map_err(Failure::without_results)?;
            if args.json {
                print_json(&metrics)?;
            } else {
                print_metrics(&metrics);
            }
            args.out.as_ref().or(Some(run))
        }
        (None, Some(table)) => {
            let config = TableEvaluationConfig {
                side: args.side,
                out: args.out.clone(),
            };
            let watch = VerbWatch::new("evaluate", "steps");
            let metrics = evaluate_table(table, &corpus, &config, &watch)
                .map_err(|error| failure_of(error).without_results())?;
            if args.json {
                print_json(&metrics)?;
            } else {
                print_table_metrics(&metrics);
            }
            args.out.as_ref()
        }
        (None, None) => {
            let message = "nothing to evaluate; name a run, or a table with --predictions";
            return Err(Failure::bad_input_message(message.to_owned()));
        }
    };
    let Some(results) = results else {
        finish("evaluate", began, &Next::default());
        return Ok(ending);
    };
    if !args.json {
        let report = RunFolder::at(results).report_path();
        println!("report: {}", report.display());
    }
    let next = Next::verb("view", &args.corpus).and("--run");
    finish("evaluate", began, &next.and(results.display()));
    Ok(ending)
}

/// Evaluates a run.
pub(crate) fn evaluate(
    run: &Path,
    corpus: &Corpus,
    config: &EvaluationConfig,
) -> Result<Metrics, Failure> {
    let watch = VerbWatch::new("evaluate", "steps");
    trainer::evaluate(&RunFolder::at(run), corpus, config, &watch).map_err(failure_of)
}

/// Prints the errors of a table's estimators.
fn print_table_metrics(metrics: &TableMetrics) {
    print_estimators(&metrics.estimators, false);
    let flights = &metrics.split.test;
    let trajectories = match flights.trajectories {
        1 => "1 trajectory".to_owned(),
        many => format!("{many} trajectories"),
    };
    let scenarios = count(flights.scenarios, "scenario");
    print_ticks(&format!("{scenarios} of {trajectories}"), &metrics.ticks);
    print_stated_intervals(&metrics.estimators);
}

/// Prints the errors of a run's estimators.
pub(crate) fn print_metrics(metrics: &Metrics) {
    print_estimators(&metrics.estimators, true);
    print_judged(metrics);
    print_stated_intervals(&metrics.estimators);
}

/// Prints the errors of each estimator. The names of a run's estimators are explained; a table may use the same names for others.
fn print_estimators(estimators: &BTreeMap<String, EstimatorMetrics>, is_run: bool) {
    let rows: Vec<Vec<String>> = estimators
        .iter()
        .map(|(name, figures)| {
            let (all, dual) = (&figures.overall.all, figures.overall.dual.as_ref());
            vec![
                match name.as_str() {
                    "triangulation" if is_run => format!("{name} (oracle: true cameras)"),
                    _ if name.starts_with("no_vision_") => format!("{name} (yardstick)"),
                    _ => name.clone(),
                },
                percent(all.mape_pct),
                percent(all.median_pct),
                percent(all.p95_pct),
                percent(all.coverage.map(|coverage| 100.0 * coverage)),
                percent(dual.and_then(|dual| dual.mape_pct)),
                dual.map_or_else(|| "-".into(), |dual| dual.samples.to_string()),
            ]
        })
        .collect();
    let heading = [
        "estimator",
        "MAPE %",
        "median %",
        "95 % below",
        "coverage %",
        "two views: MAPE %",
        "ticks",
    ];
    print_table(&heading, &rows);
}

/// Prints the flights and ticks of the evaluation.
fn print_judged(metrics: &Metrics) {
    let test = &metrics.split.test;
    let trajectories = match (test.trajectories, metrics.split.by.as_str()) {
        (_, "scenario") => format!(
            "{} ({} of them fly a flight that was learned from)",
            count(test.scenarios, "scenario"),
            metrics.split.test_scenarios_sharing_flights
        ),
        (1, _) => "1 held-out trajectory".to_owned(),
        (many, _) => format!("{many} held-out trajectories"),
    };
    print_ticks(&trajectories, &metrics.ticks);
    match metrics.disbelieved_boxes {
        0 => {}
        1 => println!(
            "1 box was ignored: unlike all training boxes, or not of the followed aircraft"
        ),
        many => println!(
            "{many} boxes were ignored: unlike all training boxes, or not of the followed aircraft"
        ),
    }
    match metrics.cut_off_boxes {
        0 => {}
        1 => println!("1 image has only boxes that its edge cuts off: ignored"),
        many => println!("{many} images have only boxes that their edges cut off: ignored"),
    }
}

/// Prints the numbers of evaluated ticks of these flights.
fn print_ticks(flights: &str, ticks: &TickCounts) {
    let seen = ticks.seen.map_or(String::new(), |seen| {
        format!(", {seen} seen by at least one view")
    });
    println!(
        "on {flights}: {} with the aircraft there{seen}, {} hidden by fog",
        count(ticks.there, "tick"),
        ticks.hidden_by_fog
    );
}

/// Prints how many of the stated intervals hold the truth.
fn print_stated_intervals(estimators: &BTreeMap<String, EstimatorMetrics>) {
    for (name, figures) in estimators {
        if let Some(stated) = figures.stated_intervals {
            let [held, least, most] = [
                stated.held,
                stated.held_by_flight[0],
                stated.held_by_flight[1],
            ]
            .map(|share| 100.0 * share);
            println!(
                "{name}: its 90 % intervals hold {held:.1} % of the truth ({least:.1} to {most:.1} % by flight)"
            );
        }
    }
}

fn percent(value: Option<f64>) -> String {
    value.map_or_else(|| "-".into(), |value| format!("{value:.3}"))
}
