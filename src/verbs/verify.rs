//! `dtd verify`: checks that a corpus is complete and synchronised.

use dataset::corpus::Corpus;
use dataset::verify::{VerifyOptions, VerifyReport, verify_with};

use super::Outcome;
use super::open_corpus::open_corpus;
use super::output::{count, print_json};
use crate::args::VerifyArgs;
use crate::failure::{Ending, Failure};
use crate::progress::Bar;

/// Runs the verb. A corpus with faults is a failure, with every fault named on stdout.
pub(crate) fn run(args: &VerifyArgs) -> Outcome {
    let options = VerifyOptions {
        decode: !args.quick,
        complete: args.complete,
    };
    let report = verify(&open_corpus(&args.corpus)?, options);
    if args.json {
        print_json(&report)?;
    } else {
        for finding in &report.findings {
            println!("{finding}");
        }
        print_proof(&report);
        println!("{}", summary(&report, args.quick));
    }
    if report.findings.is_empty() {
        Ok(Ending::Done)
    } else {
        Err(Failure::Failed(anyhow::anyhow!(
            "{} is not sound: {}",
            args.corpus.display(),
            count(report.findings.len(), "fault")
        )))
    }
}

fn summary(report: &VerifyReport, quick: bool) -> String {
    let pictures = match quick {
        true => "pictures not decoded (--quick)".to_owned(),
        false => count(report.pictures as usize, "picture"),
    };
    let faults = match report.findings.len() {
        0 => "no faults".to_owned(),
        faults => count(faults, "fault"),
    };
    format!(
        "{} ({} labelled), {}, {pictures}: {faults}",
        count(report.scenarios, "scenario"),
        report.labelled,
        count(report.ticks as usize, "tick"),
    )
}

/// The evidence from the pictures, and what has none.
fn print_proof(report: &VerifyReport) {
    let clear: usize = report.views.iter().map(|view| view.clear_boxes).sum();
    let filled: usize = report.views.iter().map(|view| view.filled_boxes).sum();
    if clear > 0 {
        println!(
            "the aircraft is in {filled} of {clear} true boxes that are clear enough to show it"
        );
    }
    match report.missing.as_slice() {
        [] => {}
        [id] => println!("1 planned scenario is missing: {id}"),
        [id, ..] => println!(
            "{} planned scenarios are missing: {id} ...",
            report.missing.len()
        ),
    }
}

/// Verifies with a progress bar.
fn verify(corpus: &Corpus, options: VerifyOptions) -> VerifyReport {
    let bar = Bar::new("verify", "scenarios", None);
    let mut started = 0;
    verify_with(corpus, options, &mut |id, total| {
        bar.set_total(total as u64);
        bar.set_done(started);
        bar.working_on(id);
        started += 1;
    })
}
