//! `dtd train-detector`: trains the detector for `dtd detect` on a labelled corpus.

use detector_training::{DetectorConfig, Effort, Error, train_detector};

use super::Outcome;
use super::open_corpus::open_corpus;
use super::output::print_json;
use super::train::Bars;
use crate::args::TrainDetectorArgs;
use crate::failure::{Ending, Failure};

const MOST_MINUTES: f64 = 525_600.0;

/// Runs the verb.
pub(crate) fn run(args: &TrainDetectorArgs) -> Outcome {
    let corpus = open_corpus(&args.corpus)?;
    if !(args.minutes > 0.0 && args.minutes <= MOST_MINUTES) {
        return Err(Failure::bad_input_message(format!(
            "--minutes is {:?}, expected a number above 0, at most {MOST_MINUTES}, a year",
            args.minutes
        )));
    }
    let mut config = DetectorConfig::default();
    config.training.effort = Effort::Minutes(args.minutes);
    let report =
        train_detector(&corpus, &args.out, &config, &mut Bars::default()).map_err(failure_of)?;
    if args.json {
        print_json(&report)?;
    } else {
        println!(
            "{}: {} bytes, {} parameters, {} steps, {} crops",
            args.out.display(),
            report.model_bytes,
            report.parameters,
            report.steps,
            report.crops
        );
        println!(
            "figures on held-out trajectories: {}",
            args.out.with_extension("json").display()
        );
    }
    Ok(Ending::Done)
}

/// An error that the caller must fix, or one of the machine.
fn failure_of(error: Error) -> Failure {
    match error {
        Error::Corpus { .. } | Error::Output { .. } => Failure::bad_input(error),
        Error::Held { .. } => Failure::TryAgain(error.into()),
        Error::Dataset(cause) => Failure::of_corpus(cause),
        Error::Diverged { .. } => error.into(),
    }
}
