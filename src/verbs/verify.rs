//! `dtd verify`: proof that a corpus is whole and synchronised.

use dataset::corpus::Corpus;
use dataset::verify::{VerifyReport, verify_with_progress};

use super::Outcome;
use super::open_corpus::open_corpus;
use super::output::print_json;
use crate::args::VerifyArgs;
use crate::failure::{Ending, Failure};
use crate::progress::Bar;

/// Runs the verb. A corpus with faults is a failure, with every fault named on stdout.
pub(crate) fn run(args: &VerifyArgs) -> Outcome {
    let report = verify(&open_corpus(&args.corpus)?);
    if args.json {
        print_json(&report)?;
    } else {
        for finding in &report.findings {
            println!("{finding}");
        }
        println!(
            "{} scenarios ({} labelled), {} ticks, {} pictures: {} faults",
            report.scenarios,
            report.labelled,
            report.ticks,
            report.pictures,
            report.findings.len()
        );
    }
    if report.findings.is_empty() {
        Ok(Ending::Done)
    } else {
        Err(Failure::Failed(anyhow::anyhow!(
            "{} is not sound: {} faults",
            args.corpus.display(),
            report.findings.len()
        )))
    }
}

/// Verifies with a progress bar.
fn verify(corpus: &Corpus) -> VerifyReport {
    let bar = Bar::new("verify", "scenarios", None);
    let mut started = 0;
    verify_with_progress(corpus, &mut |id, total| {
        bar.set_total(total as u64);
        bar.set_done(started);
        bar.working_on(id);
        started += 1;
    })
}
