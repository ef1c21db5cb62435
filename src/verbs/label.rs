//! `dtd label`: distance-to-touchdown labels and ground-truth boxes.

use std::time::Instant;

use dataset::corpus::Corpus;
use dataset::work::watch::Watch;
use labeller::{LabelOutcome, label_corpus};

use super::Outcome;
use super::detect::search_failure;
use super::open_corpus::{open_filled_corpus, repair};
use super::output::{Next, count, failed, finish, interrupted, print_json};
use crate::args::corpus::LabelArgs;
use crate::failure::{Ending, Failure};
use crate::progress::verb_watch::VerbWatch;

/// Runs the verb.
pub(crate) fn run(args: &LabelArgs) -> Outcome {
    let began = Instant::now();
    let outcome = label(&open_filled_corpus(&args.corpus)?)?;
    if args.json {
        print_json(&outcome)?;
    } else {
        println!(
            "{} labelled, {} unchanged{}",
            count(outcome.labelled.len(), "scenario"),
            outcome.unchanged.len(),
            failed(outcome.failed.len())
        );
    }
    let ending = ending_of(&outcome);
    if ending == Ending::Done {
        finish("label", began, &Next::verb("detect", &args.corpus));
    }
    Ok(ending)
}

/// The ending of a run; prints how much is left if it was stopped.
pub(crate) fn ending_of(outcome: &LabelOutcome) -> Ending {
    if outcome.left.is_empty() {
        Ending::with_losses(&outcome.failed)
    } else {
        interrupted(outcome.labelled.len(), "labelled", outcome.left.len())
    }
}

/// Labels a corpus with a progress bar. Ctrl-C or SIGTERM ends it after the current scenarios, which stay.
pub(crate) fn label(corpus: &Corpus) -> Result<LabelOutcome, Failure> {
    let watch = VerbWatch::new("label", "scenarios");
    let outcome = label_corpus(corpus, &watch).map_err(search_failure)?;
    for failure in &outcome.failed {
        watch.warn(&format!(
            "scenario {} was not labelled: {}",
            failure.id, failure.reason
        ));
    }
    if !outcome.failed.is_empty() {
        watch.warn(&repair(corpus.root()));
    }
    for place in &outcome.without_boxes {
        watch.warn(&format!(
            "scenario {place}: the aircraft is never in sight; are flight and cameras as intended?"
        ));
    }
    Ok(outcome)
}
