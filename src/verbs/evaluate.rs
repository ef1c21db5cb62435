//! `dtd evaluate`: the errors of a run on the held-out trajectories.

use std::path::Path;
use std::time::Instant;

use dataset::corpus::Corpus;
use trainer::{EvaluationConfig, JudgedSide, Metrics, RunFolder};

use super::Outcome;
use super::open_corpus::open_sound_corpus;
use super::output::{Next, count, finish, print_json, print_table};
use super::train::failure_of;
use crate::estimator_args::{EvaluateArgs, SideArg};
use crate::failure::Failure;
use crate::verb_watch::VerbWatch;

/// Runs the verb.
pub(crate) fn run(args: &EvaluateArgs) -> Outcome {
    let (corpus, ending) = open_sound_corpus("evaluate", &args.corpus)?;
    let config = EvaluationConfig {
        side: match args.side {
            SideArg::Test => JudgedSide::Test,
            SideArg::All => JudgedSide::All,
        },
        detections: args.detections.clone(),
        out: args.out.clone(),
    };
    let began = Instant::now();
    let metrics = evaluate(&args.run, &corpus, &config).map_err(Failure::without_results)?;
    let results = args.out.as_ref().unwrap_or(&args.run);
    if args.json {
        print_json(&metrics)?;
    } else {
        print_metrics(&metrics);
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

/// Prints the errors of each estimator.
pub(crate) fn print_metrics(metrics: &Metrics) {
    let rows: Vec<Vec<String>> = metrics
        .estimators
        .iter()
        .map(|(name, figures)| {
            let [all, dual] = [&figures.overall.all, &figures.overall.dual];
            vec![
                match name.as_str() {
                    "triangulation" => format!("{name} (oracle: true cameras)"),
                    _ => name.clone(),
                },
                percent(all.mape_pct),
                percent(all.median_pct),
                percent(all.p95_pct),
                percent(all.coverage.map(|coverage| 100.0 * coverage)),
                percent(dual.mape_pct),
                dual.samples.to_string(),
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
    let test = &metrics.split.test;
    let trajectories = match test.trajectories {
        1 => "1 held-out trajectory".to_owned(),
        many => format!("{many} held-out trajectories"),
    };
    let ticks = &metrics.ticks;
    println!(
        "on {trajectories}: {} with the aircraft there, {} seen by at least one view, {} hidden by fog",
        count(ticks.there, "tick"),
        ticks.seen,
        ticks.hidden_by_fog
    );
    match metrics.disbelieved_boxes {
        0 => {}
        1 => println!("1 box was ignored: unlike all training boxes, or not of the followed aircraft"),
        many => println!("{many} boxes were ignored: unlike all training boxes, or not of the followed aircraft"),
    }
    match metrics.cut_off_boxes {
        0 => {}
        1 => println!("1 picture has only boxes that its edge cuts off: ignored"),
        many => println!("{many} pictures have only boxes that their edges cut off: ignored"),
    }
    for (name, figures) in &metrics.estimators {
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
