//! `dtd export`: a corpus in the formats of other tools.

use std::time::Instant;

use dataset::corpus::Corpus;
use exporter::{Error, ExportOutcome, Format, Watch};
use generator::generate::Cancel;
use serde::Serialize;

use super::Outcome;
use super::open_corpus::open_filled_corpus;
use super::output::{count, finish, print_json};
use crate::export_args::{Asked, ExportArgs};
use crate::failure::{Ending, Failure};
use crate::progress::Bar;
use crate::signals;

/// Runs the verb.
pub(crate) fn run(args: &ExportArgs) -> Outcome {
    let began = Instant::now();
    let asked = args.asked().map_err(Failure::bad_input_message)?;
    let corpus = open_filled_corpus(&args.corpus)?;
    let (request, out) = match asked {
        Asked::Export(request, out) => (request, out),
        Asked::Description { license } => return describe(&corpus, license, args.json),
    };
    let bar = Bar::new("export", "pictures", None);
    let cancel = Cancel::default();
    let stoppable = signals::in_good_order(&cancel);
    let watch = Watch {
        progress: &|done, total| {
            bar.set_total(total);
            bar.set_done(done);
        },
        is_stopped: &|| cancel.is_cancelled(),
    };
    let exported = exporter::export(&corpus, &request, out, watch);
    drop(stoppable);
    let outcome = match exported {
        Ok(outcome) => outcome,
        Err(Error::Stopped) => {
            eprintln!("interrupted: run the same command again to resume");
            return Ok(Ending::Interrupted);
        }
        Err(error) => return Err(failure(error)),
    };
    bar.finish();
    if args.json {
        return print_json(&outcome).map(|()| Ending::Done);
    }
    print_summary(&outcome, request.format);
    finish("export", began, &format!("ls {}", out.display()));
    Ok(Ending::Done)
}

/// Writes `croissant.json` into the corpus.
fn describe(corpus: &Corpus, license: Option<String>, json: bool) -> Outcome {
    let (path, described) = exporter::describe_corpus(corpus, license).map_err(failure)?;
    let path = path.display().to_string();
    if json {
        let printed = Described {
            croissant: &path,
            described,
        };
        return print_json(&printed).map(|()| Ending::Done);
    }
    println!("{path}");
    Ok(Ending::Done)
}

/// What `--json` prints of a description.
#[derive(Serialize)]
struct Described<'a> {
    croissant: &'a str,
    #[serde(flatten)]
    described: ExportOutcome,
}

fn failure(error: Error) -> Failure {
    match error {
        Error::Dataset(error) => Failure::of_corpus(error),
        Error::Held { .. } => Failure::TryAgain(error.into()),
        error if error.is_bad_request() => Failure::bad_input(error),
        error => error.into(),
    }
}

fn print_summary(outcome: &ExportOutcome, format: Format) {
    let boxes = match outcome.boxes {
        1 => "1 box".to_owned(),
        boxes => format!("{boxes} boxes"),
    };
    println!(
        "{} with {boxes} of {}{}",
        count(outcome.pictures as usize, "picture"),
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
            count(outcome.left_out as usize, "picture"),
            format.left_out(),
        );
    }
}
