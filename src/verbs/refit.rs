//! `dtd refit`: fits a run's camera again.

use std::time::Instant;

use trainer::{RefitConfig, RunFolder};

use super::Outcome;
use super::open_corpus::{leave_out_unsearched_by_run, open_sound_corpus};
use super::output::{count, finish, print_json};
use super::train::{failure_of, judged_next};
use crate::args::estimator::RefitArgs;
use crate::progress::verb_watch::VerbWatch;

/// Runs the verb.
pub(crate) fn run(args: &RefitArgs) -> Outcome {
    let began = Instant::now();
    let (corpus, ending) = open_sound_corpus("refit", &args.corpus)?;
    let (corpus, searched) = leave_out_unsearched_by_run("refit", corpus, &args.run, None)?;
    let ending = ending.and(searched);
    let config = RefitConfig {
        view: args.view.clone(),
        approaches: args.scenarios,
    };
    let run = RunFolder::at(&args.run);
    let watch = VerbWatch::new("refit", "steps");
    let refit = trainer::refit(&run, &corpus, &args.out, &config, &watch)
        .map_err(|error| failure_of(error).without_results())?;
    drop(watch);
    if args.json {
        print_json(&refit)?;
    } else {
        println!(
            "refitted view {} of {} from {}: {}; everything else is as before ({})",
            refit.view,
            args.run.display(),
            count(refit.scenarios.len(), "scenario"),
            args.out.display(),
            &refit.frozen_after_blake3[..12]
        );
    }
    finish("refit", began, &judged_next(&args.out, &corpus));
    Ok(ending)
}
