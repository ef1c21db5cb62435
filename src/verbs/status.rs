//! `dtd status`: a corpus's scenarios by stage, and the time left.

use std::io::{self, IsTerminal};
use std::thread::sleep;
use std::time::Duration;

use dataset::work::watch::Watch;
use generator::progress::Status;
use indicatif::HumanDuration;
use store::{CorpusLocation, CorpusStore};

use super::Outcome;
use super::async_runtime::async_runtime;
use super::object_store::{STORE_TIMEOUT, failure_of};
use super::open_corpus::open_corpus;
use super::output::{count, print_after, print_json};
use crate::args::corpus::StatusArgs;
use crate::failure::{Ending, Failure};
use crate::progress::verb_watch::VerbWatch;

/// Time between two looks of `--watch`.
const LOOK_INTERVAL: Duration = Duration::from_secs(5);
/// Clears a terminal and puts the cursor into its upper left corner.
const CLEAR: &str = "\x1b[2J\x1b[H";

/// Runs the verb.
pub(crate) fn run(args: &StatusArgs) -> Outcome {
    let watch = VerbWatch::new("status", "");
    // A first look that fails is a wrong name; later ones may succeed again.
    let mut is_shown = false;
    loop {
        let status = match status(&args.corpus) {
            Err(Failure::BadInput(error) | Failure::Failed(error) | Failure::TryAgain(error))
                if is_shown =>
            {
                eprint_warning!("status: {error:#}");
                wait(&watch)?;
                continue;
            }
            found => found?,
        };
        is_shown = true;
        if args.json {
            print_json(&status)?;
        } else {
            if args.watch && io::stdout().is_terminal() {
                print!("{CLEAR}");
            }
            show(&status);
        }
        if !args.watch || is_over(&status) {
            return Ok(Ending::Done);
        }
        wait(&watch)?;
    }
}

/// True if nothing is left that the present runs will record.
fn is_over(status: &Status) -> bool {
    let ended = status.recorded + status.damaged.len() + status.failed.len();
    status.in_work.is_empty() && ended >= status.planned
}

fn wait(watch: &VerbWatch) -> Result<(), Failure> {
    for _ in 0..LOOK_INTERVAL.as_secs() {
        sleep(Duration::from_secs(1));
        watch.check()?;
    }
    Ok(())
}

fn status(corpus: &CorpusLocation) -> Result<Status, Failure> {
    match corpus {
        CorpusLocation::Folder(root) => {
            Status::of_folder(&open_corpus(root)?).map_err(Failure::of_corpus)
        }
        CorpusLocation::Store(url) => {
            let store = CorpusStore::open(url, false, STORE_TIMEOUT).map_err(failure_of)?;
            let found = async_runtime()?.block_on(Status::of_store(&store));
            found.map_err(failure_of)
        }
    }
}

fn show(status: &Status) {
    let line = |name: &str, text: &str| print_after(&format!("{name:<12}"), text);
    let Status {
        planned,
        recorded,
        labelled,
        searched,
        ..
    } = status;
    line("corpus", &status.corpus);
    line(
        "scenarios",
        &format!("{recorded} of {planned} recorded, {labelled} labelled, {searched} searched"),
    );
    for of in &status.in_work {
        let by = of.by.as_deref().unwrap_or("no process");
        line(
            "in work",
            &format!(
                "{}, by {by}; last written {} ago",
                of.id,
                duration(of.written_s_ago)
            ),
        );
    }
    for (id, reasons) in &status.failed {
        let last = reasons.last().map_or("no reason", String::as_str);
        let attempts = count(reasons.len(), "attempt");
        line("failed", &format!("{id}, {attempts}; the last: {last}"));
    }
    for (id, fault) in &status.damaged {
        line("damaged", &format!("{id}: {fault}"));
    }
    if let (Some(pace), Some(left_s)) = (status.pace, status.left_s) {
        let scenarios = count(pace.of + 1, "scenario");
        line(
            "pace",
            &format!(
                "{} per scenario, over {scenarios}",
                duration(pace.s_per_scenario)
            ),
        );
        if left_s > 0.0 {
            line("left", &format!("about {}", duration(left_s)));
        }
    }
}

fn duration(seconds: f64) -> HumanDuration {
    HumanDuration(Duration::from_secs_f64(seconds))
}
