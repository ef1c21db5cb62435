//! `dtd label`: distance-to-touchdown labels and true boxes.

use std::time::Instant;

use dataset::corpus::Corpus;
use labeller::{LabelOutcome, label_corpus};

use super::Outcome;
use super::open_corpus::open_filled_corpus;
use super::output::{Next, count, finish, print_json};
use crate::args::LabelArgs;
use crate::failure::{Ending, Failure};
use crate::progress::Bar;

/// Runs the verb.
pub(crate) fn run(args: &LabelArgs) -> Outcome {
    let began = Instant::now();
    let outcome = label(&open_filled_corpus(&args.corpus)?)?;
    if args.json {
        print_json(&outcome)?;
    } else {
        println!(
            "{} labelled, {} unchanged",
            count(outcome.labelled.len(), "scenario"),
            outcome.unchanged.len()
        );
    }
    if outcome.failed.is_empty() {
        finish("label", began, &Next::verb("detect", &args.corpus));
    }
    Ok(if outcome.failed.is_empty() {
        Ending::Done
    } else {
        Ending::Losses
    })
}

/// Labels a corpus with a progress bar.
pub(crate) fn label(corpus: &Corpus) -> Result<LabelOutcome, Failure> {
    let bar = Bar::new("label", "scenarios", None);
    let outcome = label_corpus(corpus, &|progress| {
        bar.set_total(progress.total);
        bar.set_done(progress.done);
    })?;
    for failure in &outcome.failed {
        bar.warn(&format!(
            "scenario {} was not labelled: {}",
            failure.id, failure.reason
        ));
    }
    Ok(outcome)
}
