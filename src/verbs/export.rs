//! `dtd export`: a corpus in the formats of other tools.

use std::time::Instant;

use dataset::corpus::Corpus;
use exporter::{Error, ExportOutcome, Format};
use serde::Serialize;

use super::Outcome;
use super::open_corpus::{open_sound_corpus, refuse_empty};
use super::output::{Next, count, finish, print_json};
use crate::args::export::{Asked, ExportArgs};
use crate::failure::{Ending, Failure};
use crate::progress::verb_watch::VerbWatch;

/// Runs the verb.
pub(crate) fn run(args: &ExportArgs) -> Outcome {
    let began = Instant::now();
    let asked = args.asked().map_err(Failure::bad_input_message)?;
    let (corpus, ending) = open_sound_corpus("export", &args.corpus)?;
    refuse_empty(&corpus)?;
    let (request, out) = match asked {
        Asked::Export(request, out) => (request, out),
        Asked::Description { license } => {
            return describe(&corpus, license, args.json).map(|()| ending);
        }
    };
    let watch = VerbWatch::new("export", "images");
    let outcome = exporter::export(&corpus, &request, out, &watch).map_err(failure)?;
    drop(watch);
    let ending = ending.and(if outcome.lost.is_empty() {
        Ending::Done
    } else {
        Ending::Losses
    });
    if args.json {
        return print_json(&outcome).map(|()| ending);
    }
    print_summary(&outcome, request.format);
    println!("{}", out.display());
    finish("export", began, &Next::default());
    Ok(ending)
}

/// Writes `croissant.json` into the corpus.
fn describe(corpus: &Corpus, license: Option<String>, json: bool) -> Result<(), Failure> {
    let (path, described) = exporter::describe_corpus(corpus, license).map_err(failure)?;
    let path = path.display().to_string();
    if json {
        let printed = Described {
            croissant: &path,
            described,
        };
        return print_json(&printed);
    }
    println!("{path}");
    Ok(())
}

/// Output of `--json` for a description.
#[derive(Serialize)]
struct Described<'a> {
    croissant: &'a str,
    #[serde(flatten)]
    described: ExportOutcome,
}

fn failure(error: Error) -> Failure {
    match error {
        Error::Dataset(error) => Failure::of_corpus(error),
        Error::Stopped(_) => Failure::Interrupted { resumes: true },
        error if error.is_bad_request() => Failure::bad_input(error),
        error => error.into(),
    }
}

fn print_summary(outcome: &ExportOutcome, format: Format) {
    let boxes = match outcome.boxes {
        _ if !format.has_boxes() => String::new(),
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
