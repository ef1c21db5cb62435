//! `dtd fetch`: downloads a corpus from an object store into a folder.

use std::collections::BTreeSet;
use std::fmt::Display;
use std::time::{Duration, Instant};

use dataset::corpus::{Corpus, check_place};
use dataset::files::json_file::write_atomically;
use dataset::files::outside_file::{self, FileKind};
use dataset::files::own_path::own_path;
use dataset::plan::{Plan, PlannedScenarios};
use dataset::work::watch::Watch;
use indicatif::{DecimalBytes, HumanDuration};
use serde::Serialize;
use store::{CorpusStore, Fetched, Patience, StoreError, StoreUrl, Transfer};

use super::Outcome;
use super::corpus_files::{CorpusFile, SPLIT_AGAIN, Standing, difference_from_sweep, files_of};
use super::object_store::{failure_of, mend, nothing_committed, run_transfers};
use super::output::{count, print_json};
use crate::args::FetchArgs;
use crate::failure::{Ending, Failure};
use crate::verb_watch::VerbWatch;

/// Characters of a foreign name that a message shows.
const MOST_SHOWN: usize = 64;

/// Result for the scenarios.
#[derive(Default, Serialize)]
struct Mirror {
    /// Downloaded by this call.
    fetched: Vec<String>,
    /// There already.
    unchanged: Vec<String>,
    /// Existing locally with other content, and left alone.
    different: Vec<String>,
    /// Damaged in the store, with the reason.
    failed: Vec<Lost>,
    /// Models' detections that were downloaded, as ID/MODEL.
    detections: Vec<String>,
    /// Of these, those that replaced damaged ones.
    mended_detections: Vec<String>,
    /// Models' detections that were left alone.
    left_detections: Vec<Lost>,
    /// Decisions about the files of the whole corpus, if any.
    corpus_files: Vec<String>,
    /// Bytes that were downloaded.
    bytes: u64,
    /// Scenarios that were left to the next call, because this one was stopped.
    left: Vec<String>,
    /// True if this call was stopped.
    stopped: bool,
}

#[derive(Serialize)]
struct Lost {
    id: String,
    reason: String,
}

/// Runs the verb.
pub(crate) fn run(args: &FetchArgs) -> Outcome {
    let began = Instant::now();
    let url: &StoreUrl = &args.url;
    let store = CorpusStore::open(url, false).map_err(failure_of)?;
    let patience = Patience(Duration::from_secs(args.timeout_s));
    let watch = VerbWatch::new("fetch", "scenarios");
    let transfer = Transfer::new(&watch);
    let mut mirror = Mirror::default();
    let fetching = fetch(&store, args, patience, &watch, &transfer, &mut mirror);
    match run_transfers(&watch, fetching) {
        Err(Failure::Interrupted { .. }) if !mirror.left.is_empty() => mirror.stopped = true,
        result => result?,
    }
    mirror.bytes = transfer.bytes();
    drop(watch);
    if args.json {
        print_json(&mirror)?;
    } else {
        println!(
            "{} fetched, {} there already; {} in {}: {}",
            count(mirror.fetched.len(), "scenario"),
            mirror.unchanged.len(),
            DecimalBytes(mirror.bytes),
            HumanDuration(began.elapsed()),
            args.out.display()
        );
    }
    for said in &mirror.corpus_files {
        eprintln!("{said}");
    }
    for mended in &mirror.mended_detections {
        eprintln!("mended the detections {mended}, which were damaged here");
    }
    for left in &mirror.left_detections {
        eprint_warning!("detections {} were not fetched: {}", left.id, left.reason);
    }
    for id in &mirror.different {
        eprint_warning!(
            "{id} differs from what the store has and was left alone; move {} away to fetch it, or `dtd push` it",
            args.out.join("scenarios").join(id).display()
        );
    }
    for lost in &mirror.failed {
        eprint_warning!("{} was not fetched: {}", lost.id, lost.reason);
    }
    if mirror.stopped {
        eprintln!(
            "interrupted: {} fetched, {} to go; run the same command again to resume",
            count(mirror.fetched.len(), "scenario"),
            mirror.left.len()
        );
        return Ok(Ending::Interrupted);
    }
    let lost = mirror.different.len() + mirror.failed.len() + mirror.left_detections.len();
    Ok(match lost {
        0 => Ending::Done,
        _ => Ending::Losses,
    })
}

async fn fetch(
    store: &CorpusStore,
    args: &FetchArgs,
    patience: Patience,
    watch: &VerbWatch,
    transfer: &Transfer<'_>,
    mirror: &mut Mirror,
) -> Result<(), Failure> {
    store.check().await.map_err(failure_of)?;
    let listing = store.listing().await.map_err(failure_of)?;
    let ids = wanted(listing.committed(), args, store)?;
    check_place(&args.out).map_err(Failure::bad_input)?;
    let corpus = Corpus::create(&args.out).map_err(Failure::bad_input)?;
    mirror.corpus_files = fetch_corpus_files(store, &corpus).await?;
    mirror
        .failed
        .extend(listing.foreign().map(|(id, bad)| Lost {
            id: shortened(id),
            reason: format!("{bad}; it is no scenario, remove it from the store"),
        }));
    if !corpus.plan_path().exists() {
        mirror.failed.push(Lost {
            id: Corpus::PLAN.into(),
            reason: "it is missing, here and in the store; `dtd push` from a folder that has it sends it"
                .into(),
        });
    }
    let planned = PlannedScenarios::read(&corpus).map_err(Failure::of_corpus)?;
    watch.begin("", ids.len() as u64);
    mirror.left.extend(ids.iter().cloned());
    for (done, id) in ids.iter().enumerate() {
        watch.advance(done as u64, id);
        // Those before it are done.
        mirror.left.drain(..mirror.left.len() + done - ids.len());
        transfer.check().map_err(failure_of)?;
        let objects = listing.of(id);
        let fetched = patience
            .with(transfer, async || {
                store
                    .fetch_scenario(id, &corpus, Some(&objects), transfer)
                    .await
            })
            .await;
        match fetched {
            Ok(Fetched::Whole { .. }) => mirror.fetched.push(id.clone()),
            Ok(Fetched::Same) => mirror.unchanged.push(id.clone()),
            Ok(Fetched::Other) => {
                mirror.different.push(id.clone());
                continue;
            }
            // Deleted since we listed it: it is being replaced.
            Ok(Fetched::NotCommitted) => {
                mirror.failed.push(Lost {
                    id: id.clone(),
                    reason: "it is being replaced; run the same command again".into(),
                });
                continue;
            }
            Err(error @ StoreError::Faulty { .. }) => {
                mirror.failed.push(Lost {
                    id: id.clone(),
                    reason: format!("{error}. {}", mend(store, &planned, id)),
                });
                continue;
            }
            Err(error @ StoreError::Damaged { .. }) => {
                mirror.failed.push(Lost {
                    id: id.clone(),
                    reason: error.to_string(),
                });
                continue;
            }
            Err(error) => return Err(failure_of(error)),
        }
        let scenario = corpus.scenario(id);
        let moved = patience
            .with(transfer, async || {
                store.fetch_detections(&scenario, transfer).await
            })
            .await
            .map_err(failure_of)?;
        let name = |model: &String| format!("{id}/{model}");
        mirror.detections.extend(moved.moved.iter().map(name));
        mirror
            .mended_detections
            .extend(moved.mended.iter().map(name));
        mirror
            .left_detections
            .extend(moved.left.into_iter().map(|left| Lost {
                id: name(&left.model),
                reason: left.reason,
            }));
    }
    mirror.left.clear();
    watch.advance(ids.len() as u64, "");
    Ok(())
}

/// A name of any length and content, for a message.
fn shortened(name: &str) -> String {
    let start: String = name.chars().take(MOST_SHOWN).collect();
    start.escape_debug().to_string()
}

/// The requested committed scenarios.
fn wanted(
    committed: BTreeSet<String>,
    args: &FetchArgs,
    store: &CorpusStore,
) -> Result<Vec<String>, Failure> {
    if committed.is_empty() {
        return Err(nothing_committed(store));
    }
    if let Some(id) = args.only.iter().find(|id| !committed.contains(*id)) {
        return Err(Failure::bad_input_message(format!(
            "{}: has no committed scenario {id} ({} committed)",
            store.name(),
            count(committed.len(), "scenario")
        )));
    }
    let is_wanted = |id: &String| args.only.is_empty() || args.only.contains(id);
    Ok(committed.into_iter().filter(is_wanted).collect())
}

/// Downloads plan, split and sweep if they are missing or damaged locally, or if the store's versions only add to them. Local ones
/// that contain more stay; if they contradict the store's, this is another corpus. Returns the decisions.
async fn fetch_corpus_files(store: &CorpusStore, corpus: &Corpus) -> Result<Vec<String>, Failure> {
    let damaged = |name: &str, reason: &dyn Display| {
        Failure::Failed(anyhow::anyhow!(
            "{}/{name}: {reason}. Nothing was fetched; `dtd push` from an intact copy of the corpus, or `dtd generate` with its sweep, replaces it",
            store.name()
        ))
    };
    let theirs = files_of(store).await.map_err(failure_of)?;
    let theirs = theirs
        .and_then(|theirs| theirs.check_together().map(|()| theirs))
        .map_err(|(name, reason)| damaged(name, &reason))?;
    // Other processes must not change them in the meantime.
    let _claim = corpus.claim().map_err(Failure::of_corpus)?;
    let has_plan = corpus.plan_path().exists();
    let mut said = Vec::new();
    let mut to_write = Vec::new();
    let mut plan_is_theirs = true;
    for name in Corpus::FILES {
        let Some((bytes, file)) = theirs.get(name) else {
            continue;
        };
        let path = own_path(corpus.root(), name).map_err(Failure::bad_input)?;
        let ours = match path.exists() {
            true => {
                outside_file::read(&path, FileKind::PLAN.unlinked()).map_err(Failure::bad_input)?
            }
            false => {
                to_write.push((path, bytes));
                continue;
            }
        };
        if ours == *bytes {
            plan_is_theirs &= name != Corpus::PLAN;
            continue;
        }
        let shown = path.display().to_string();
        // Without a plan, it may be anybody's work.
        if name == Corpus::SWEEP && !has_plan && !ours.is_empty() {
            return Err(Failure::bad_input_message(format!(
                "{shown} differs from {}/{name}, and there was no plan.json that was made from it. Nothing was fetched; move it away, or name \
                 another folder",
                store.name()
            )));
        }
        let is_theirs = match CorpusFile::parse(name, &ours).map(|ours| ours.standing(file)) {
            Err(damage) => {
                said.push(format!("replaced {shown}, which was damaged: {damage}"));
                true
            }
            Ok(Standing::TheirsHasMore) => {
                said.push(format!("replaced {shown}, which had less than the store's"));
                true
            }
            Ok(Standing::OursHasMore) => {
                said.push(format!(
                    "{shown} has more than the store's and stays; `dtd push` sends it"
                ));
                false
            }
            Ok(Standing::Same) => false,
            Ok(Standing::AsThePlan) if plan_is_theirs => true,
            // The plans are the same, but ours is not the text that they were made from.
            Ok(Standing::AsThePlan) if is_of_other_plan(corpus, &ours) => {
                said.push(format!(
                    "replaced {shown}, which had been changed since it was frozen"
                ));
                !is_of_other_plan(corpus, bytes)
            }
            Ok(Standing::AsThePlan) => false,
            Ok(Standing::Conflict(difference)) => {
                return Err(Failure::bad_input_message(format!(
                    "{shown} is of another corpus than {}: {difference}. Nothing was fetched; name another folder",
                    store.name()
                )));
            }
        };
        if name == Corpus::PLAN {
            plan_is_theirs = is_theirs;
        }
        if is_theirs {
            to_write.push((path, bytes));
        }
    }
    for (path, bytes) in to_write {
        write_atomically(&path, bytes)?;
    }
    let splits = corpus.splits_path();
    if !splits.exists() {
        match theirs.split_again() {
            Some(split) => {
                split
                    .map_err(|reason| damaged(Corpus::PLAN, &reason))?
                    .write(&splits)?;
                said.push(SPLIT_AGAIN.into());
            }
            None => said.push(
                "splits.json is missing, here and in the store, and cannot be regenerated without plan.json and corpus.toml".into(),
            ),
        }
    }
    Ok(said)
}

/// True if this is not the sweep of the corpus' plan; false if that plan is unreadable.
fn is_of_other_plan(corpus: &Corpus, sweep: &[u8]) -> bool {
    let plan = Plan::of_corpus(corpus).ok().flatten();
    plan.is_some_and(|plan| difference_from_sweep(&plan, sweep).is_some())
}
