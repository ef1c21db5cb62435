//! One file per verb: arguments in, work done by the crates, results printed.

mod address;
mod aircraft;
mod airport;
mod async_runtime;
mod completions;
mod demo;
mod detect;
mod doctor;
mod estimate;
mod evaluate;
mod evaluate_detector;
mod examples;
mod export;
mod export_estimators;
mod fetch;
mod generate;
mod import;
mod install_plugin;
mod label;
mod man;
mod mock_xplane;
mod object_store;
mod open_corpus;
pub(crate) mod output;
mod paper;
mod plan;
mod predict;
mod push;
mod refit;
mod schema;
mod status;
mod stdin_ended;
mod tape;
mod tracks;
mod train;
mod train_detector;
mod verify;
mod view;

use crate::args::Verb;
use crate::failure::{Ending, Failure};
use crate::signals;

/// Return type of every verb.
pub(crate) type Outcome = Result<Ending, Failure>;

/// Runs a verb. A signal ends it cleanly if possible, see [`signals`], or else with "try again".
pub(crate) fn run(verb: Verb) -> Outcome {
    signals::watch()?;
    match verb {
        Verb::Plan(args) => plan::run(&args),
        Verb::Schema { of } => schema::run(of),
        Verb::Examples { folder } => examples::run(&folder),
        Verb::Generate(args) => generate::run(&args),
        Verb::Fetch(args) => fetch::run(&args),
        Verb::Push(args) => push::run(&args),
        Verb::Label(args) => label::run(&args),
        Verb::Detect(args) => detect::run(&args),
        Verb::Train(args) => train::run(&args),
        Verb::Refit(args) => refit::run(&args),
        Verb::Evaluate(args) => evaluate::run(&args),
        Verb::Predict(args) => predict::run(&args),
        Verb::Estimate(args) => estimate::run(&args),
        Verb::ExportEstimators(args) => export_estimators::run(&args),
        Verb::EvaluateDetector(args) => evaluate_detector::run(&args),
        Verb::Export(args) => export::run(&args),
        Verb::Status(args) => status::run(&args),
        Verb::Verify(args) => verify::run(&args),
        Verb::View(args) => view::run(&args),
        Verb::TrainDetector(args) => train_detector::run(&args),
        Verb::Aircraft(args) => aircraft::run(&args),
        Verb::Airport(args) => airport::run(&args),
        Verb::Tracks(args) => tracks::run(&args),
        Verb::Import(args) => import::run(&args),
        Verb::InstallPlugin(args) => install_plugin::run(&args),
        Verb::MockXplane(args) => mock_xplane::run(&args),
        Verb::Doctor(args) => doctor::run(&args),
        Verb::Tape(args) => tape::run(&args),
        Verb::Demo(args) => demo::run(&args),
        Verb::Paper(args) => paper::run(&args),
        Verb::Completions { shell } => completions::run(shell),
        Verb::Man { folder } => man::run(&folder),
    }
}
