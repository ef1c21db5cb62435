//! `dtd evaluate-detector`: how far, how surely and how exactly a detector finds the aircraft of a labelled corpus.

use std::time::Instant;

use dataset::corpus::Corpus;
use dataset::work::watch::Watch;
use detector_evaluation::{
    Ended, Error, Evaluation, EvaluationOptions, ModeFigures, evaluate_detector, mode,
};
use labeller::{DetectOptions, Mode};

use super::Outcome;
use super::detect::{self, refuse_other_models};
use super::open_corpus::open_filled_corpus;
use super::output::{Next, finish, interrupted, print_json, print_table};
use crate::args::detector::EvaluateDetectorArgs;
use crate::failure::{Ending, Failure};
use crate::progress::verb_watch::VerbWatch;
use crate::shipped::Detector;

/// Runs the verb.
pub(crate) fn run(args: &EvaluateDetectorArgs) -> Outcome {
    let began = Instant::now();
    let corpus = open_filled_corpus(&args.corpus)?;
    let model = Detector::chosen(args.model.as_deref())?;
    refuse_other_models(model.path())?;
    let options = EvaluationOptions {
        model: model.path().to_owned(),
        detect: DetectOptions {
            settings: args.search.settings(&corpus)?,
            mode: Mode::Full,
            only: args.search.scenarios(&corpus)?,
            ..args.runtime.options()
        },
        modes: args.mode.clone(),
        out: args.out.clone(),
    };
    let Some(evaluation) = evaluate(&corpus, &options)? else {
        return Ok(Ending::Interrupted);
    };
    if evaluation.scenarios.is_empty() {
        eprint_warning!(
            "evaluate-detector: no scenario could be searched, so there are no figures"
        );
        return Ok(Ending::Losses);
    }
    if args.json {
        print_json(&evaluation)?;
    } else {
        print_summary(&evaluation);
        let report = args.out.join(detector_evaluation::REPORT);
        println!("report: {}", report.display());
    }
    finish("evaluate-detector", began, &Next::default());
    Ok(Ending::with_losses(&evaluation.failed))
}

/// Evaluates a detector with a progress bar; `None` if interrupted.
pub(crate) fn evaluate(
    corpus: &Corpus,
    options: &EvaluationOptions,
) -> Result<Option<Box<Evaluation>>, Failure> {
    let watch = VerbWatch::new("evaluate", "images");
    let evaluation = match evaluate_detector(corpus, options, &watch).map_err(failure_of)? {
        Ended::Done(evaluation) => evaluation,
        Ended::Stopped { searched, left } => {
            interrupted(searched, "searched", left);
            return Ok(None);
        }
    };
    for failure in &evaluation.failed {
        watch.warn(&format!(
            "scenario {} was not searched: {}",
            failure.id, failure.reason
        ));
    }
    Ok(Some(evaluation))
}

/// An error that the caller must fix, or one of the machine.
fn failure_of(error: Error) -> Failure {
    match error {
        Error::Dataset(cause) => Failure::of_corpus(cause),
        Error::NoMode | Error::Unlabelled(_) | Error::Projection { .. } => {
            Failure::bad_input(error)
        }
        Error::Search(cause) => detect::search_failure(cause),
        error => error.into(),
    }
}

fn print_summary(evaluation: &Evaluation) {
    let heading = [
        "search",
        "max NM",
        "effective NM",
        "recall %",
        "confirmed %",
        "false boxes/h",
        "false tracks/h",
        "centre SD px",
        "disparity SD px",
        "AP",
        "CPU ms",
    ];
    let modes = Mode::ALL
        .into_iter()
        .filter_map(|mode| Some((mode, evaluation.modes.get(mode::key(mode))?)));
    let rows: Vec<_> = modes.map(|(mode, figures)| row(mode, figures)).collect();
    print_table(&heading, &rows);
    if let Some(weather) = &evaluation.range_weather {
        println!("ranges in weather {weather}");
    }
    println!(
        "recall from 1 to 10 NM in {}",
        evaluation.recall_weathers.join(", ")
    );
    let Some(figures) = evaluation.modes.values().next() else {
        return;
    };
    let expected = &figures.pictures.expected;
    println!(
        "{} images: {} show the aircraft in sight, {} beyond the visibility, {} in or above clouds",
        figures.pictures.total,
        expected.in_sight.expected,
        expected.hidden_by_haze.expected,
        expected.maybe_hidden_by_cloud.expected
    );
    if expected.in_sight.expected == 0 {
        println!("no image shows the aircraft in sight, so nothing could be found or missed");
    }
}

fn row(mode: Mode, figures: &ModeFigures) -> Vec<String> {
    let number = |value: Option<f64>, decimals: usize| {
        value.map_or_else(|| "-".into(), |value| format!("{value:.decimals$}"))
    };
    let percent = |share: Option<f64>| number(share.map(|share| 100.0 * share), 2);
    let deviation =
        |spread: Option<dataset::numbers::spread::Spread>| number(spread.map(|s| s.deviation), 3);
    vec![
        mode::title(mode).to_lowercase(),
        number(figures.range.max_range_nm, 2),
        number(figures.range.effective_range_nm, 2),
        percent(figures.recall.recall),
        percent(figures.recall.confirmed_recall),
        number(figures.false_alarms.boxes_per_hour, 0),
        number(figures.false_alarms_per_hour, 1),
        deviation(figures.boxes.errors.cx_px),
        deviation(figures.disparity.registered_px),
        number(figures.average_precision.ap, 3),
        number(figures.cpu_ms_per_picture, 1),
    ]
}
