//! `dtd train-detector`: trains the detector for `dtd detect` on a labelled corpus.

use std::path::Path;

use dataset::files::outside_file::{self, FileKind};
use dataset::files::toml_file::TomlFile;
use detector_training::{DetectorConfig, Effort, Error, MAX_MINUTES, train_detector};

use super::Outcome;
use super::open_corpus::open_sound_corpus;
use super::output::print_json;
use crate::args::detector::TrainDetectorArgs;
use crate::failure::Failure;
use crate::progress::verb_watch::VerbWatch;

/// Runs the verb.
pub(crate) fn run(args: &TrainDetectorArgs) -> Outcome {
    let (corpus, ending) = open_sound_corpus("train-detector", &args.corpus)?;
    let config = config(args)?;
    let watch = VerbWatch::new("train-detector", "steps");
    let report = train_detector(&corpus, &args.out, &config, &watch).map_err(failure_of)?;
    drop(watch);
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
        if report.left_out_with_several_aircraft > 0 {
            println!(
                "left out: {} images or parts of images with several aircraft",
                report.left_out_with_several_aircraft
            );
        }
        println!("report: {}", args.out.with_extension("json").display());
    }
    Ok(ending)
}

fn config(args: &TrainDetectorArgs) -> Result<DetectorConfig, Failure> {
    let mut config = match &args.config {
        None => DetectorConfig::default(),
        Some(path) => settings_in(path)?,
    };
    if let Some(minutes) = args.minutes {
        if !(minutes > 0.0 && minutes <= MAX_MINUTES) {
            return Err(Failure::bad_input_message(format!(
                "--minutes is {minutes:?}, expected a number above 0, at most {MAX_MINUTES}, a year"
            )));
        }
        config.training.effort = Effort::Minutes(minutes);
    }
    if args.start_from.is_some() {
        config.training.start_from.clone_from(&args.start_from);
    }
    Ok(config)
}

/// The settings in a file. One that is out of range is shown in its line.
fn settings_in(path: &Path) -> Result<DetectorConfig, Failure> {
    let text = outside_file::read_text(path, FileKind::SETTINGS).map_err(Failure::bad_input)?;
    let file = TomlFile::new(path, &text);
    let config: DetectorConfig = file.parse().map_err(Failure::bad_input)?;
    match config.training.check() {
        Ok(()) => Ok(config),
        Err(ref error @ Error::Setting { ref setting, .. }) => {
            let shown = file.rejected(setting, &error.to_string());
            Err(Failure::bad_input(shown))
        }
        Err(error) => Err(failure_of(error)),
    }
}

/// An error that the caller must fix, or one of the machine.
fn failure_of(error: Error) -> Failure {
    match error {
        Error::Input(_) | Error::Setting { .. } => Failure::bad_input(error),
        Error::Stopped(_) => Failure::Interrupted { resumes: true },
        Error::Dataset(cause) => Failure::of_corpus(cause),
        Error::Diverged { .. } => error.into(),
    }
}
