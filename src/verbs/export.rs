//! `dtd export`: a corpus in the formats of other tools.

use std::time::Instant;

use exporter::{Error, ExportOutcome, Watch};
use generator::generate::Cancel;

use super::Outcome;
use super::open_corpus::open_filled_corpus;
use super::output::{count, finish, print_json};
use crate::export_args::ExportArgs;
use crate::failure::{Ending, Failure};
use crate::progress::Bar;
use crate::signals;

/// Runs the verb.
pub(crate) fn run(args: &ExportArgs) -> Outcome {
    let began = Instant::now();
    let corpus = open_filled_corpus(&args.corpus)?;
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
    let exported = exporter::export(&corpus, &args.request(), &args.out, watch);
    drop(stoppable);
    let outcome = match exported {
        Ok(outcome) => outcome,
        Err(Error::Stopped) => {
            eprintln!("interrupted: run the same command again to resume");
            return Ok(Ending::Interrupted);
        }
        Err(Error::Dataset(error)) => return Err(Failure::of_corpus(error)),
        Err(error @ Error::Held { .. }) => return Err(Failure::TryAgain(error.into())),
        Err(error) if error.is_bad_request() => return Err(Failure::bad_input(error)),
        Err(error) => return Err(error.into()),
    };
    bar.finish();
    if args.json {
        return print_json(&outcome).map(|()| Ending::Done);
    }
    print_summary(&outcome);
    finish("export", began, &format!("ls {}", args.out.display()));
    Ok(Ending::Done)
}

fn print_summary(outcome: &ExportOutcome) {
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
    if outcome.left_out > 0 {
        println!(
            "left out: {} whose aircraft may be hidden by a cloud or is mostly outside, which the format cannot say",
            count(outcome.left_out as usize, "picture"),
        );
    }
}
