//! `dtd push`: uploads a corpus from a folder to an object store.

use std::collections::BTreeSet;
use std::fmt::Display;
use std::time::{Duration, Instant};

use dataset::corpus::{Corpus, ScenarioFolder};
use dataset::files::outside_file::{self, FileKind};
use dataset::files::own_path::own_path;
use dataset::plan::PlannedScenarios;
use dataset::work::watch::Watch;
use indicatif::{DecimalBytes, HumanDuration};
use serde::Serialize;
use store::{Before, CorpusStore, Keep, Patience, Pushed, StoreError, Transfer};

use super::Outcome;
use super::corpus_files::{CorpusFiles, SPLIT_AGAIN, Standing, files_of};
use super::object_store::{failure_of, run_transfers};
use super::open_corpus::open_filled_corpus;
use super::output::{count, print_json};
use crate::args::PushArgs;
use crate::failure::{Ending, Failure};
use crate::verb_watch::VerbWatch;

/// Result for the corpus.
#[derive(Default, Serialize)]
struct Sent {
    /// Scenarios that this call uploaded.
    pushed: Vec<String>,
    /// Of these, those that replaced older content in the store.
    replaced: Vec<String>,
    /// Of these, those that the store had damaged, with the faults.
    mended: Vec<Mended>,
    /// Committed already, with this content.
    unchanged: Vec<String>,
    /// Scenarios, and detections as ID/MODEL, that were not uploaded.
    refused: Vec<Refused>,
    /// Models' detections that were uploaded, as ID/MODEL.
    detections: Vec<String>,
    /// Of these, those that replaced older ones.
    replaced_detections: Vec<String>,
    /// Of these, those that the store had damaged.
    mended_detections: Vec<String>,
    /// Decisions about the files of the whole corpus, if any.
    corpus_files: Vec<String>,
    /// Incomplete uploads of earlier calls that were cleared.
    cleared: usize,
    /// Bytes that were uploaded.
    bytes: u64,
    /// Scenarios that were left to the next call, because this one was stopped.
    left: Vec<String>,
    /// True if this call was stopped.
    stopped: bool,
}

/// A scenario that the store has whole again.
#[derive(Serialize)]
struct Mended {
    id: String,
    faults: String,
}

/// Something that was not uploaded.
#[derive(Serialize)]
struct Refused {
    what: String,
    reason: String,
}

/// Runs the verb.
pub(crate) fn run(args: &PushArgs) -> Outcome {
    let corpus = open_filled_corpus(&args.corpus)?;
    let began = Instant::now();
    let store = CorpusStore::open(&args.url, true).map_err(failure_of)?;
    let patience = Patience(Duration::from_secs(args.timeout_s));
    let watch = VerbWatch::new("push", "scenarios");
    let transfer = Transfer::new(&watch);
    let mut sent = Sent::default();
    let sending = send(&corpus, &store, patience, &watch, &transfer, &mut sent);
    match run_transfers(&watch, sending) {
        Err(Failure::Interrupted { .. }) if !sent.left.is_empty() => sent.stopped = true,
        result => result?,
    }
    sent.bytes = transfer.bytes();
    drop(watch);
    if args.json {
        print_json(&sent)?;
    } else {
        println!(
            "{} pushed ({} replaced, {} mended), {} there already; {} of detections pushed ({} replaced, {} mended); {} in {}: {}",
            count(sent.pushed.len(), "scenario"),
            sent.replaced.len(),
            sent.mended.len(),
            sent.unchanged.len(),
            count(sent.detections.len(), "set"),
            sent.replaced_detections.len(),
            sent.mended_detections.len(),
            DecimalBytes(sent.bytes),
            HumanDuration(began.elapsed()),
            store.name()
        );
        for replaced in &sent.replaced {
            println!("replaced the store's {replaced}: ours is labelled, or was sealed later");
        }
        for replaced in &sent.replaced_detections {
            println!("replaced older detections {replaced}");
        }
        for mended in &sent.mended_detections {
            println!("mended the detections {mended}, which the store had damaged");
        }
        for Mended { id, faults } in &sent.mended {
            println!("mended {id}, which the store had damaged: {faults}");
        }
    }
    for said in &sent.corpus_files {
        eprintln!("{said}");
    }
    for Refused { what, reason } in &sent.refused {
        eprint_warning!("{what} was not pushed: {reason}");
    }
    if sent.stopped {
        eprintln!(
            "interrupted: {} pushed, {} to go; run the same command again to resume",
            count(sent.pushed.len(), "scenario"),
            sent.left.len()
        );
        return Ok(Ending::Interrupted);
    }
    Ok(match sent.refused.len() {
        0 => Ending::Done,
        _ => Ending::Losses,
    })
}

async fn send(
    corpus: &Corpus,
    store: &CorpusStore,
    patience: Patience,
    watch: &VerbWatch,
    transfer: &Transfer<'_>,
    sent: &mut Sent,
) -> Result<(), Failure> {
    let files = files_to_send(corpus, store, sent).await?;
    let scenarios = corpus.scenarios().map_err(Failure::of_corpus)?;
    let ids: BTreeSet<String> = scenarios.iter().map(|folder| folder.id()).collect();
    match store.clear_unfinished(&ids).await {
        Ok(cleared) => sent.cleared = cleared,
        // They use space and do no harm; write permission does not imply permission to list.
        Err(error) => watch.warn(&format!("unfinished uploads are left there: {error}")),
    }
    send_corpus_files(&files, store, sent).await?;
    let planned = PlannedScenarios::read(corpus).map_err(Failure::of_corpus)?;
    let listing = patience
        .with(transfer, async || store.listing().await)
        .await
        .map_err(failure_of)?;
    watch.begin("", scenarios.len() as u64);
    sent.left.extend(scenarios.iter().map(ScenarioFolder::id));
    for (done, folder) in scenarios.iter().enumerate() {
        let id = folder.id();
        watch.advance(done as u64, &id);
        // Those before it are done.
        sent.left.drain(..sent.left.len() + done - scenarios.len());
        transfer.check().map_err(failure_of)?;
        let is_planned = match folder.seal() {
            Ok(Some(seal)) => planned.check(&id, &seal.config_hash),
            // The upload reports what is wrong with it.
            _ => Ok(()),
        };
        if let Err(error) = is_planned {
            let reason = error.to_string();
            sent.refused.push(Refused { what: id, reason });
            continue;
        }
        let mut seen = Some(listing.of(&id));
        let pushed = patience
            .with(transfer, async || {
                // A repeated attempt finds more there.
                let seen = seen.take();
                store.push_scenario(folder, seen.as_ref(), transfer).await
            })
            .await;
        let refused = match pushed {
            Ok(Pushed::Committed { before, .. }) => {
                sent.pushed.push(id.clone());
                match before {
                    Before::Nothing => {}
                    Before::Other => sent.replaced.push(id.clone()),
                    Before::Damaged(faults) => sent.mended.push(Mended {
                        id: id.clone(),
                        faults: faults.to_string(),
                    }),
                }
                None
            }
            Ok(Pushed::Same) => {
                sent.unchanged.push(id.clone());
                None
            }
            Ok(Pushed::Newer) => Some(format!(
                "the store has another one, which is newer; move {} away to fetch it",
                folder.root().display()
            )),
            Ok(Pushed::OtherRecording) => Some(format!(
                "the store has another recording of it, with other videos or poses; to keep the store's, move {} away and fetch it; to replace \
                 it, delete {}/scenarios/{id}/DONE.json and push again",
                folder.root().display(),
                store.name()
            )),
            Ok(Pushed::Labelled) => Some(format!(
                "the store has it with labels, and here it has none; run `dtd label` on {}, or move the scenario away and fetch it",
                corpus.root().display()
            )),
            Err(error @ StoreError::Damaged { .. }) => Some(error.to_string()),
            Err(error) => return Err(failure_of(error)),
        };
        if let Some(reason) = refused {
            sent.refused.push(Refused { what: id, reason });
            continue;
        }
        let moved = patience
            .with(transfer, async || {
                store.push_detections(folder, transfer).await
            })
            .await
            .map_err(failure_of)?;
        let name = |model: &String| format!("{id}/{model}");
        sent.detections.extend(moved.moved.iter().map(name));
        sent.replaced_detections
            .extend(moved.replaced.iter().map(name));
        sent.mended_detections.extend(moved.mended.iter().map(name));
        sent.refused.extend(moved.left.iter().map(|left| Refused {
            what: name(&left.model),
            reason: left.reason.clone(),
        }));
    }
    sent.left.clear();
    watch.advance(scenarios.len() as u64, "");
    Ok(())
}

/// Plan, split and sweep, each valid and of one corpus. Does not upload. A lost split is regenerated.
async fn files_to_send(
    corpus: &Corpus,
    store: &CorpusStore,
    sent: &mut Sent,
) -> Result<CorpusFiles, Failure> {
    let refuse = |name: &str, reason: &dyn Display| {
        Failure::bad_input_message(format!(
            "{}: {reason}. Nothing was pushed; `dtd fetch {} --out FOLDER` brings the store's own",
            corpus.root().join(name).display(),
            store.name()
        ))
    };
    let mut files = CorpusFiles::default();
    for name in Corpus::FILES {
        let path = own_path(corpus.root(), name).map_err(Failure::bad_input)?;
        if path.exists() {
            let bytes =
                outside_file::read(&path, FileKind::PLAN.unlinked()).map_err(Failure::bad_input)?;
            files
                .add(name, bytes)
                .map_err(|reason| refuse(name, &reason))?;
        }
    }
    files
        .check_together()
        .map_err(|(name, reason)| refuse(name, &reason))?;
    store.check_place().await.map_err(failure_of)?;
    for name in files.missing().collect::<Vec<_>>() {
        if store.read(name).await.map_err(failure_of)?.is_some() {
            sent.corpus_files.push(format!(
                "{} is missing; the store keeps its own, and `dtd fetch` brings it",
                corpus.root().join(name).display()
            ));
        } else if name == Corpus::SPLITS
            && let Some(split) = files.split_again()
        {
            let split = split.map_err(|reason| refuse(name, &reason))?;
            let path = corpus.splits_path();
            let _claim = corpus.claim().map_err(Failure::of_corpus)?;
            split.write(&path)?;
            let bytes =
                outside_file::read(&path, FileKind::PLAN.unlinked()).map_err(Failure::bad_input)?;
            files
                .add(name, bytes)
                .map_err(|reason| refuse(name, &reason))?;
            sent.corpus_files.push(SPLIT_AGAIN.into());
        } else {
            sent.corpus_files.push(format!(
                "{} is missing, here and in the store",
                corpus.root().join(name).display()
            ));
        }
    }
    Ok(files)
}

/// Uploads plan, split and sweep if the store has none, a damaged one or one that ours only adds to. One that contradicts ours is
/// an error; one that contains more stays.
async fn send_corpus_files(
    files: &CorpusFiles,
    store: &CorpusStore,
    sent: &mut Sent,
) -> Result<(), Failure> {
    let mut said: Vec<(&str, String)> = Vec::new();
    // Plans of the same bytes are not judged.
    let mut same_sweep = true;
    let judge = |name, theirs: &[u8], plan| {
        // It comes first.
        if name == Corpus::PLAN {
            same_sweep = files.has_sweep_of(theirs);
        }
        let (keep, words) = match files.standing(name, theirs) {
            Err(damage) => (
                Keep::Ours,
                format!("replaced the store's {name}, which was damaged: {damage}"),
            ),
            Ok(Standing::OursHasMore) => (
                Keep::Ours,
                format!("replaced the store's {name}, which had less than ours"),
            ),
            Ok(Standing::TheirsHasMore) => (
                Keep::Theirs,
                format!("the store's {name} has more than ours and stays"),
            ),
            Ok(Standing::AsThePlan) if plan == Keep::Ours => (
                Keep::Ours,
                format!("replaced the store's {name} along with the plan"),
            ),
            Ok(Standing::AsThePlan)
                if same_sweep && files.difference_from_sweep(theirs).is_some() =>
            {
                (
                    Keep::Ours,
                    format!(
                        "replaced the store's {name}, which is not the sweep that the plan was made from"
                    ),
                )
            }
            Ok(Standing::Same | Standing::AsThePlan) => return Ok(Keep::Theirs),
            Ok(Standing::Conflict(difference)) => {
                return Err(NotSent::Conflict { name, difference });
            }
        };
        // Judged again if another process wrote it in the meantime.
        said.retain(|(of, _)| *of != name);
        said.push((name, words));
        Ok(keep)
    };
    let settled = store.settle_files(files.contents(), judge).await;
    settled.map_err(|error| error.into_failure(store))?;
    sent.corpus_files
        .extend(said.into_iter().map(|(_, words)| words));
    check_together(store, sent).await
}

/// Names a file of the store that does not belong to its plan, such as the sweep of an upload that was interrupted after the plan. Ours
/// cannot replace it where the store's plan is not ours.
async fn check_together(store: &CorpusStore, sent: &mut Sent) -> Result<(), Failure> {
    let there = files_of(store).await.map_err(failure_of)?;
    let (name, reason) = match there.map(|files| files.check_together()) {
        Ok(Ok(())) => return Ok(()),
        Ok(Err((name, fault))) => (
            name,
            format!("does not belong to the plan.json beside it, which is not ours: {fault}"),
        ),
        Err((name, fault)) => (name, format!("is damaged: {fault}")),
    };
    sent.refused.push(Refused {
        what: name.into(),
        reason: format!(
            "{}/{name} {reason}. `dtd push` from the folder of that plan, or `dtd generate` with its sweep to this URL, replaces it",
            store.name()
        ),
    });
    Ok(())
}

/// Reasons why a file of the whole corpus was not uploaded.
enum NotSent {
    Store(StoreError),
    Conflict {
        name: &'static str,
        difference: String,
    },
}

impl From<StoreError> for NotSent {
    fn from(error: StoreError) -> Self {
        Self::Store(error)
    }
}

impl NotSent {
    fn into_failure(self, store: &CorpusStore) -> Failure {
        match self {
            Self::Store(error) => failure_of(error),
            Self::Conflict { name, difference } => Failure::bad_input_message(format!(
                "{}: the corpus was started from a different sweep or split, {name} differs: {difference}. A corpus can only be added to: push to \
                 another prefix",
                store.name()
            )),
        }
    }
}
