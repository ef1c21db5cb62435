//! One file per verb: arguments in, work done by the crates, results printed.

mod async_runtime;
mod demo;
mod detect;
mod evaluate;
mod generate;
mod label;
mod mock_xplane;
mod open_corpus;
mod output;
mod plan;
mod train;
mod train_detector;
mod verify;

use crate::args::Verb;
use crate::failure::{Ending, Failure};

/// What every verb returns.
pub(crate) type Outcome = Result<Ending, Failure>;

/// Runs a verb.
pub(crate) fn run(verb: Verb) -> Outcome {
    match verb {
        Verb::Plan(args) => plan::run(&args),
        Verb::Generate(args) => generate::run(&args),
        Verb::Label(args) => label::run(&args),
        Verb::Detect(args) => detect::run(&args),
        Verb::Train(args) => train::run(&args),
        Verb::Evaluate(args) => evaluate::run(&args),
        Verb::Verify(args) => verify::run(&args),
        Verb::TrainDetector(args) => train_detector::run(&args),
        Verb::MockXplane(args) => mock_xplane::run(&args),
        Verb::Demo(args) => demo::run(&args),
    }
}
