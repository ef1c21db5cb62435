//! `dtd verify`: checks that a corpus is complete and synchronised.

use std::env;
use std::fs;

use dataset::Error;
use dataset::corpus::Corpus;
use dataset::corpus::seal::MANIFEST;
use dataset::files::json_file::write_atomically;
use dataset::plan::PlannedScenarios;
use dataset::work::watch::{Stopped, Watch};
use generator::sweep_language::Sweeps;
use store::{
    Connection, CorpusLocation, CorpusStore, Fetched, Listing, MirrorReport, StoreError,
    sweep_fault,
};
use tempfile::TempDir;
use verify::{Finding, Verification, VerifyOptions, VerifyReport, against, verify_with};

use super::Outcome;
use super::object_store::{STORE_TIMEOUT, failure_of, run_transfers};
use super::open_corpus::{open_corpus, open_filled_corpus, refuse_empty, repair};
use super::output::{count, listed, print_json};
use crate::args::corpus::VerifyArgs;
use crate::failure::{Ending, Failure};
use crate::progress::verb_watch::VerbWatch;

/// Views whose empty boxes are listed, and ticks of each.
const MAX_VIEWS_LISTED: usize = 8;
const MAX_TICKS_LISTED: usize = 12;

/// Runs the verb. A corpus with faults is a failure, with every fault named on stdout.
pub(crate) fn run(args: &VerifyArgs) -> Outcome {
    let options = VerifyOptions {
        decode: !args.no_decode,
        complete: args.complete,
    };
    let watch = VerbWatch::new("verify", "scenarios");
    let mut is_damaged = false;
    let (name, report) = match &args.corpus {
        CorpusLocation::Folder(root) => {
            let corpus = open_corpus(root)?;
            let mut report = verify(&corpus, options, &watch)?;
            if report.findings.is_empty() {
                refuse_empty(&corpus)?;
            }
            is_damaged = report.findings.iter().any(|it| it.scenario.is_some());
            if let Some(expected) = &args.against {
                let expected = open_filled_corpus(expected)?;
                report.findings.extend(against(&corpus, &expected)?);
            }
            (root.display().to_string(), report)
        }
        CorpusLocation::Store(_) if args.against.is_some() => {
            return Err(Failure::bad_input_message(
                "--against compares a corpus in a folder: `dtd fetch` it first",
            ));
        }
        CorpusLocation::Store(url) => {
            let store = CorpusStore::open(url, false, STORE_TIMEOUT).map_err(failure_of)?;
            let connection = store.watched(&watch);
            let verifying = verify_in_store(&connection, store.name(), options, &watch);
            let report = run_transfers(&watch, verifying).map_err(Failure::without_results)?;
            (store.name().to_owned(), report)
        }
    };
    drop(watch);
    if args.json {
        print_json(&report)?;
    } else {
        for finding in &report.findings {
            println!("{finding}");
        }
        print_proof(&report);
        print_weather(&report);
        for change in &report.graphics {
            eprint_warning!("the images were drawn with different graphics: {change}");
        }
        println!("{}", summary(&report, args.no_decode));
    }
    if report.findings.is_empty() && report.marked().next().is_some() {
        Ok(Ending::Losses)
    } else if report.findings.is_empty() {
        Ok(Ending::Done)
    } else {
        let remedy = match &args.corpus {
            CorpusLocation::Folder(root) if is_damaged => format!("; {}", repair(root)),
            _ => String::new(),
        };
        Err(Failure::Failed(anyhow::anyhow!(
            "{name} is not sound: {}{remedy}",
            count(report.findings.len(), "fault")
        )))
    }
}

fn summary(report: &VerifyReport, no_decode: bool) -> String {
    let pictures = if no_decode {
        "images not decoded (--no-decode)".to_owned()
    } else {
        count(report.pictures as usize, "image")
    };
    let faults = match report.findings.len() {
        0 => "no faults".to_owned(),
        faults => count(faults, "fault"),
    };
    let marked = match report.marked().count() {
        0 => String::new(),
        marked => format!(", {marked} marked for another weather"),
    };
    format!(
        "{} ({} labelled), {}, {pictures}: {faults}{marked}",
        count(report.scenarios, "scenario"),
        report.labelled,
        count(report.ticks as usize, "tick"),
    )
}

/// The evidence from the images, and what has none.
fn print_proof(report: &VerifyReport) {
    let clear: usize = report.views.iter().map(|view| view.clear_boxes).sum();
    let filled: usize = report.views.iter().map(|view| view.filled_boxes).sum();
    if clear > 0 {
        println!(
            "the aircraft is in {filled} of {clear} ground-truth boxes that are clear enough to show it"
        );
        print_not_filled(report);
        let decided: usize = report.views.iter().map(|view| view.decided_pictures).sum();
        println!(
            "the image of a neighbouring tick would have been noticed in {decided} of {} images; the others are undecidable from pixels",
            report.pictures
        );
    }
    print_without_clear_box(report);
    match report.missing.as_slice() {
        [] => {}
        [id] => println!("1 planned scenario is missing: {id}"),
        ids => println!(
            "{} planned scenarios are missing: {}",
            ids.len(),
            listed(ids)
        ),
    }
    for check in &report.not_checked {
        println!("not checked: {check}");
    }
}

/// The clear boxes without any contrast, by view.
fn print_not_filled(report: &VerifyReport) {
    let views = report.views.iter();
    let views = views.filter(|view| !view.not_filled.is_empty());
    let lines = views.map(|view| {
        let ticks: Vec<String> = (view.not_filled.iter().take(MAX_TICKS_LISTED))
            .map(u32::to_string)
            .collect();
        let more = if view.not_filled.len() > ticks.len() {
            ", ..."
        } else {
            ""
        };
        format!(
            "not seen in {} view {}: ticks {}{more}",
            view.scenario,
            view.view,
            ticks.join(", ")
        )
    });
    print_first(lines, "some of ");
}

/// The views that no box proves: their images were only compared with each other.
fn print_without_clear_box(report: &VerifyReport) {
    let views = report.views.iter();
    let views = views.filter(|view| view.clear_boxes == 0 && view.pictures > 0);
    let lines = views.map(|view| {
        let rough = match view.rough_boxes {
            0 => "",
            _ => ", as no background is smooth",
        };
        format!(
            "no ground-truth box is clear enough in {} view {}{rough}: its images were only compared with each other",
            view.scenario, view.view
        )
    });
    print_first(lines, "");
}

/// Prints lines about views, and how many are left.
fn print_first(mut lines: impl Iterator<Item = String>, part: &str) {
    for line in lines.by_ref().take(MAX_VIEWS_LISTED) {
        println!("  {line}");
    }
    match lines.count() {
        0 => {}
        more => println!("  nor in {part}{more} more views (--json lists all)"),
    }
}

/// The weather at the aircraft, and the scenarios where it is not as planned.
fn print_weather(report: &VerifyReport) {
    let reported = (report.weather.iter()).filter(|(_, weather)| weather.is_reported());
    for (name, weather) in reported {
        println!("weather at the aircraft, {name}: {weather}");
    }
    for (id, differences) in report.marked() {
        println!(
            "{id}/scenario.json: marked, the weather at the aircraft is not the planned one: {}",
            differences.join("; ")
        );
    }
}

/// Adds what is wrong with the sweep, which no scenario's files record.
fn add_sweep_fault(corpus: &Corpus, report: &mut VerifyReport) {
    let fault = sweep_fault(corpus, &Sweeps).map(|fault| Finding {
        scenario: None,
        file: Corpus::SWEEP.into(),
        row: None,
        view: None,
        message: format!("{fault}; `dtd generate` with the sweep of the corpus writes it again"),
    });
    report.findings.extend(fault);
}

/// Verifies with a progress bar.
fn verify(
    corpus: &Corpus,
    options: VerifyOptions,
    watch: &VerbWatch,
) -> Result<VerifyReport, Failure> {
    let report = verify_with(corpus, options, watch);
    let mut report = report.map_err(|Stopped| Failure::Interrupted { resumes: false })?;
    add_sweep_fault(corpus, &mut report);
    Ok(report)
}

/// Verifies a corpus in an object store: one scenario at a time is here.
async fn verify_in_store(
    store: &Connection<'_>,
    url: &str,
    options: VerifyOptions,
    watch: &VerbWatch,
) -> Result<VerifyReport, Failure> {
    let temporary = env::temp_dir();
    let folder = TempDir::with_prefix("dtd-").map_err(Error::io("create", &temporary))?;
    let corpus = Corpus::create(folder.path())?;
    store.check().await.map_err(failure_of)?;
    let listing = store.listing().await.map_err(failure_of)?;
    if listing.committed().is_empty() {
        return Err(failure_of(store.nothing_committed()));
    }
    let report = verify_listed(store, url, &listing, &corpus, options, watch).await;
    report.map_err(failure_of)
}

async fn verify_listed(
    store: &Connection<'_>,
    url: &str,
    listing: &Listing,
    corpus: &Corpus,
    options: VerifyOptions,
    watch: &VerbWatch,
) -> Result<VerifyReport, StoreError> {
    for name in Corpus::FILES {
        if let Some(bytes) = store.read(name).await? {
            write_atomically(&corpus.root().join(name), &bytes)?;
        }
    }
    // An unreadable plan is reported as a separate fault.
    let planned = PlannedScenarios::read(corpus).unwrap_or_default();
    let committed = listing.committed();
    watch.begin("", committed.len() as u64);
    let mut verification = Verification::new(options, watch);
    for (done, id) in committed.iter().enumerate() {
        watch.advance(done as u64, id);
        match store.fetch_scenario(id, corpus).await {
            Ok(Fetched::NotCommitted) => {}
            Ok(_) => {
                let scenario = corpus.scenario(id);
                let mut moved = MirrorReport::default();
                store.fetch_detections(&scenario, &mut moved).await?;
                for (name, reason) in moved.left_detections {
                    let model = name.rsplit('/').next().unwrap_or(&name);
                    verification.add_fault(id, &format!("detections/{model}"), reason);
                }
                verification.add(scenario.clone())?;
                let videos = scenario.root().join("views");
                fs::remove_dir_all(&videos).map_err(Error::io("remove", &videos))?;
            }
            Err(StoreError::Faulty { faults, .. }) => {
                let advice = store.advice(&planned, id);
                let faults = faults.0.iter();
                let faults = faults.map(|it| (it.file.as_str(), format!("{it}; {advice}")));
                verification.add_unreadable(id, faults);
            }
            Err(StoreError::Damaged { place, message }) => {
                let scenario = format!("{url}/scenarios/{id}/");
                let file = place.strip_prefix(&scenario).unwrap_or(MANIFEST);
                verification.add_unreadable(id, [(file, message)]);
            }
            Err(error) => return Err(error),
        }
    }
    let mut report = verification.finish(corpus);
    watch.advance(committed.len() as u64, "");
    add_sweep_fault(corpus, &mut report);
    Ok(report)
}
