//! `dtd predict`: the answers of a run's estimators for a corpus, without ground truth.

use trainer::{Moment, RunFolder};

use super::Outcome;
use super::open_corpus::{leave_out_unsearched_by_run, open_sound_corpus};
use super::output::{count, print_json};
use super::train::failure_of;
use crate::args::estimator::PredictArgs;
use crate::progress::verb_watch::VerbWatch;

/// Runs the verb.
pub(crate) fn run(args: &PredictArgs) -> Outcome {
    let (corpus, ending) = open_sound_corpus("predict", &args.corpus)?;
    let detections = args.detections.as_deref();
    let (corpus, searched) = leave_out_unsearched_by_run("predict", corpus, &args.run, detections)?;
    let ending = ending.and(searched);
    let predicted = trainer::predict(
        &RunFolder::at(&args.run),
        &corpus,
        detections,
        &args.out,
        if args.online {
            Moment::Live
        } else {
            Moment::Hindsight
        },
        &VerbWatch::new("predict", "steps"),
    )
    .map_err(|error| failure_of(error).without_results())?;
    if args.json {
        print_json(&predicted)?;
        return Ok(ending);
    }
    println!(
        "wrote {}: {} of {}",
        args.out.display(),
        count(predicted.ticks, "tick"),
        count(predicted.scenarios, "scenario")
    );
    for (name, answered) in predicted.answered {
        println!("{name}: {answered} answered");
    }
    Ok(ending)
}
