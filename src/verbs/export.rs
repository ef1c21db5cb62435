//! `dtd export`: a corpus in the formats of other tools.

use std::time::Instant;

use exporter::{Error, ExportOutcome, Format};

use super::Outcome;
use super::open_corpus::{open_sound_corpus, refuse_empty};
use super::output::{Next, count, finish, print_json};
use crate::args::export::ExportArgs;
use crate::failure::{Ending, Failure};
use crate::progress::verb_watch::VerbWatch;

/// Runs the verb.
pub(crate) fn run(args: &ExportArgs) -> Outcome {
    let began = Instant::now();
    let (corpus, ending) = open_sound_corpus("export", &args.corpus)?;
    refuse_empty(&corpus)?;
    let request = args.request();
    let watch = VerbWatch::new("export", "images");
    let outcome = exporter::export(&corpus, &request, &args.out, &watch).map_err(failure)?;
    drop(watch);
    let ending = ending.and(Ending::with_losses(&outcome.lost));
    if args.json {
        return print_json(&outcome).map(|()| ending);
    }
    print_summary(&outcome, request.format);
    println!("{}", args.out.display());
    finish("export", began, &Next::default());
    Ok(ending)
}

fn failure(error: Error) -> Failure {
    match error {
        Error::Dataset(error) => Failure::of_corpus(error),
        Error::Stopped(_) => Failure::Interrupted { resumes: true },
        Error::Request(_) => Failure::bad_input(error),
        error => error.into(),
    }
}

fn print_summary(outcome: &ExportOutcome, format: Format) {
    let boxes = match outcome.boxes {
        1 => " with 1 box".to_owned(),
        boxes => format!(" with {boxes} boxes"),
    };
    println!(
        "{}{boxes} of {}{}",
        count(outcome.pictures as usize, "image"),
        count(outcome.scenarios as usize, "scenario"),
        if outcome.unchanged {
            ", already complete"
        } else {
            ""
        },
    );
    if let Some(remark) = outcome.remark {
        println!("note: {remark}");
    }
    if outcome.left_out > 0 {
        println!(
            "left out: {} {}",
            count(outcome.left_out as usize, "image"),
            format.left_out(),
        );
    }
}
