//! `dtd train`: trains distance estimators on a corpus.

mod search;

use std::path::Path;
use std::time::Instant;

use dataset::corpus::Corpus;
use dataset::corpus::splits::Side;
use dataset::files::json_file::read_json;
use dataset::files::outside_file::{self, FileKind};
use dataset::files::toml_file::TomlFile;
use serde::Serialize;
use trainer::{Choice, TrainConfig, TrainOutcome};

use super::Outcome;
use super::open_corpus::{leave_out_unsearched, open_sound_corpus};
use super::output::{Next, finish, print_json};
use crate::args::estimator::TrainArgs;
use crate::failure::{Ending, Failure};
use crate::progress::verb_watch::VerbWatch;

/// The result as JSON.
#[derive(Serialize)]
struct Trained<'a> {
    run: &'a Path,
    validation_mape_pct: f64,
    choice: &'a Choice,
}

/// Runs the verb.
pub(crate) fn run(args: &TrainArgs) -> Outcome {
    let began = Instant::now();
    let config = config(args)?;
    let mut corpora = Vec::new();
    let mut ending = Ending::Done;
    for path in &args.corpora {
        let (sound, damaged) = open_sound_corpus("train", path)?;
        let asked = config.model_hash.as_deref();
        let (corpus, unsearched) = leave_out_unsearched("train", sound, asked)?;
        corpora.push(corpus);
        ending = ending.and(damaged).and(unsearched);
    }
    if let Some(path) = &args.search {
        return Ok(search::run(args, path, &corpora)?.and(ending));
    }
    let outcome = train(&corpora, &args.out, &config, false)?;
    let run = outcome.run.root();
    if args.json {
        print_json(&Trained {
            run,
            validation_mape_pct: outcome.validation_mape_pct,
            choice: &outcome.choice,
        })?;
    } else {
        println!(
            "trained {}: {:.3} % on the validation side",
            run.display(),
            outcome.validation_mape_pct
        );
        let Choice {
            estimator, reason, ..
        } = &outcome.choice;
        println!("recommended: {estimator}: {reason}");
    }
    finish("train", began, &judged_next(&args.out, &corpora[0]));
    Ok(ending)
}

/// The command that evaluates the run, if the corpus has test flights.
pub(crate) fn judged_next(run: &Path, corpus: &Corpus) -> Next {
    if has_scenario_on(corpus, Side::Test) {
        Next::verb("evaluate", run)
            .and("--corpus")
            .and(corpus.root().display())
    } else {
        Next::verb("view", corpus.root())
    }
}

/// True if the corpus has scenarios on this side of the split.
pub(crate) fn has_scenario_on(corpus: &Corpus, side: Side) -> bool {
    let (Ok(splits), Ok(scenarios)) = (corpus.splits(), corpus.scenarios()) else {
        return false;
    };
    let mut sides = (scenarios.iter()).filter_map(|scenario| splits.scenarios.get(&scenario.id()));
    sides.any(|assignment| assignment.side == side)
}

/// Trains with a progress bar per stage. `reuses_finished`: unless there is a finished run with equal settings, samples and version.
pub(crate) fn train(
    corpora: &[Corpus],
    out: &Path,
    config: &TrainConfig,
    reuses_finished: bool,
) -> Result<TrainOutcome, Failure> {
    let watch = VerbWatch::new("train", "steps");
    trainer::train_on_all(corpora, out, config, reuses_finished, &watch).map_err(failure_of)
}

/// An error of the trainer that the caller must fix, or one of the machine.
pub(crate) fn failure_of(error: trainer::Error) -> Failure {
    match error {
        trainer::Error::Setting { .. }
        | trainer::Error::Corpus { .. }
        | trainer::Error::Run { .. }
        | trainer::Error::Predictions { .. }
        | trainer::Error::Exists { .. }
        | trainer::Error::Leak { .. } => Failure::bad_input(error),
        trainer::Error::Stopped(_) => Failure::Interrupted { resumes: true },
        trainer::Error::Dataset(cause) => Failure::of_corpus(cause),
        _ => error.into(),
    }
}

fn config(args: &TrainArgs) -> Result<TrainConfig, Failure> {
    let config = match &args.config {
        None if args.quick => TrainConfig::demo(),
        None => TrainConfig::default(),
        Some(path) => settings_in(path)?,
    };
    Ok(overridden(config, args))
}

/// The settings, overridden by the command line.
fn overridden(mut config: TrainConfig, args: &TrainArgs) -> TrainConfig {
    if let Some(seed) = args.seed {
        config.seed = seed;
    }
    if args.detections.is_some() {
        config.model_hash.clone_from(&args.detections);
    }
    if args.start_from.is_some() {
        config.start_from.clone_from(&args.start_from);
    }
    config.accept_weather |= args.accept_weather;
    if args.leave_out.is_some() {
        config.leave_out.clone_from(&args.leave_out);
    }
    if let Some(test_share) = args.split_by_scenario {
        let split = config.scenario_split.get_or_insert_default();
        split.test_share = test_share;
    }
    config
}

/// Settings from a TOML file or a run's `config.json`. Mistakes in TOML are shown in their line.
pub(crate) fn settings_in(path: &Path) -> Result<TrainConfig, Failure> {
    if path
        .extension()
        .is_some_and(|extension| extension == "json")
    {
        let config: TrainConfig =
            read_json(path, "training configuration").map_err(Failure::bad_input)?;
        let named = |error| Failure::bad_input_message(format!("{}: {error}", path.display()));
        return config.check().map_err(named).map(|()| config);
    }
    let text = outside_file::read_text(path, FileKind::SETTINGS).map_err(Failure::bad_input)?;
    let file = TomlFile::new(path, &text);
    let config: TrainConfig = file.parse().map_err(Failure::bad_input)?;
    checked(config, file, "")
}

/// Settings that are in range; `prefix` is where the file has them.
fn checked(config: TrainConfig, file: TomlFile<'_>, prefix: &str) -> Result<TrainConfig, Failure> {
    match config.check() {
        Ok(()) => Ok(config),
        Err(ref error @ trainer::Error::Setting { ref setting, .. }) => {
            let shown = file.rejected(&format!("{prefix}{setting}"), &error.to_string());
            Err(Failure::bad_input(shown))
        }
        Err(error) => Err(failure_of(error)),
    }
}
