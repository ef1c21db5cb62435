//! `dtd fetch`: downloads a corpus from an object store into a folder.

use std::time::{Duration, Instant};

use dataset::corpus::Corpus;
use generator::sweep_language::Sweeps;
use indicatif::{DecimalBytes, HumanDuration};
use serde::Serialize;
use store::{
    CorpusStore, Fetched, FetchedCorpus, FileDecision, Mirror, Patience, Replaced, StoreError,
    Transfer,
};

use super::Outcome;
use super::object_store::{SPLIT_AGAIN, failure_of, failure_to_mirror, mend, run_transfers};
use super::output::{count, print_json};
use crate::args::FetchArgs;
use crate::failure::{Ending, Failure};
use crate::progress::verb_watch::VerbWatch;

/// Characters of a foreign name that a message shows.
const MAX_SHOWN: usize = 64;

/// Result for the scenarios.
#[derive(Default, Serialize)]
struct Brought {
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

/// Something that was not downloaded.
#[derive(Serialize)]
struct Lost {
    id: String,
    reason: String,
}

/// Runs the verb.
pub(crate) fn run(args: &FetchArgs) -> Outcome {
    let began = Instant::now();
    let store = CorpusStore::open(&args.url, false).map_err(failure_of)?;
    let watch = VerbWatch::new("fetch", "scenarios");
    let transfer = Transfer::new(&watch);
    let mirror = Mirror {
        store: &store,
        sweeps: &Sweeps,
        patience: Patience(Duration::from_secs(args.timeout_s)),
        transfer: &transfer,
    };
    let mut fetched = FetchedCorpus::default();
    let fetching = async {
        let result = mirror.fetch(&args.out, &args.only, &mut fetched).await;
        result.map_err(failure_to_mirror)
    };
    let stopped = match run_transfers(&watch, fetching) {
        Err(Failure::Interrupted { .. }) if !fetched.to_go.is_empty() => true,
        result => result.map(|()| false)?,
    };
    let mut brought = Brought::of(fetched, args, &store);
    (brought.stopped, brought.bytes) = (stopped, transfer.bytes());
    drop(watch);
    if args.json {
        print_json(&brought)?;
    } else {
        println!(
            "{} fetched, {} there already; {} in {}: {}",
            count(brought.fetched.len(), "scenario"),
            brought.unchanged.len(),
            DecimalBytes(brought.bytes),
            HumanDuration(began.elapsed()),
            args.out.display()
        );
    }
    for said in &brought.corpus_files {
        eprintln!("{said}");
    }
    for mended in &brought.mended_detections {
        eprintln!("mended the detections {mended}, which were damaged here");
    }
    for left in &brought.left_detections {
        eprint_warning!("detections {} were not fetched: {}", left.id, left.reason);
    }
    for id in &brought.different {
        eprint_warning!(
            "{id} differs from what the store has and was left alone; move {} away to fetch it, or `dtd push` it",
            args.out.join("scenarios").join(id).display()
        );
    }
    for lost in &brought.failed {
        eprint_warning!("{} was not fetched: {}", lost.id, lost.reason);
    }
    if brought.stopped {
        eprintln!(
            "interrupted: {} fetched, {} to go; run the same command again to resume",
            count(brought.fetched.len(), "scenario"),
            brought.left.len()
        );
        return Ok(Ending::Interrupted);
    }
    let lost = brought.different.len() + brought.failed.len() + brought.left_detections.len();
    Ok(match lost {
        0 => Ending::Done,
        _ => Ending::Losses,
    })
}

impl Brought {
    /// The result in words.
    fn of(fetched: FetchedCorpus, args: &FetchArgs, store: &CorpusStore) -> Self {
        let mut brought = Self::default();
        let files = fetched.files.iter();
        brought.corpus_files = files
            .filter_map(|(name, decision)| said(name, decision, args))
            .collect();
        let foreign = fetched.foreign.into_iter();
        brought.failed.extend(foreign.map(|(name, bad)| Lost {
            id: shortened(&name),
            reason: format!("{bad}; it is no scenario, remove it from the store"),
        }));
        if !fetched.has_plan {
            brought.failed.push(Lost {
                id: Corpus::PLAN.into(),
                reason: "it is missing, here and in the store; `dtd push` from a folder that has it sends it"
                    .into(),
            });
        }
        brought.left = fetched.to_go.into();
        for scenario in fetched.scenarios {
            let id = scenario.id;
            let lost = match scenario.fetched {
                Ok(Fetched::Whole { .. }) => {
                    brought.fetched.push(id.clone());
                    None
                }
                Ok(Fetched::Same) => {
                    brought.unchanged.push(id.clone());
                    None
                }
                Ok(Fetched::Other) => {
                    brought.different.push(id.clone());
                    None
                }
                // Deleted since it was listed: it is being replaced.
                Ok(Fetched::NotCommitted) => {
                    Some("it is being replaced; run the same command again".into())
                }
                Err(error @ StoreError::Faulty { .. }) => {
                    Some(format!("{error}. {}", mend(store, &fetched.planned, &id)))
                }
                Err(error) => Some(error.to_string()),
            };
            let name = |model: String| format!("{id}/{model}");
            let detections = scenario.detections;
            (brought.detections).extend(detections.moved.into_iter().map(name));
            (brought.mended_detections).extend(detections.mended.into_iter().map(name));
            let left = detections.left.into_iter();
            brought.left_detections.extend(left.map(|left| Lost {
                id: name(left.model),
                reason: left.reason,
            }));
            brought
                .failed
                .extend(lost.map(|reason| Lost { id, reason }));
        }
        brought
    }
}

/// A name of any length and content, for a message.
fn shortened(name: &str) -> String {
    let start: String = name.chars().take(MAX_SHOWN).collect();
    start.escape_debug().to_string()
}

/// A decision about a file of the whole corpus, in words; `None` for one that follows from another.
fn said(name: &str, decision: &FileDecision, args: &FetchArgs) -> Option<String> {
    let shown = args.out.join(name);
    let shown = shown.display();
    Some(match decision {
        FileDecision::Replaced(Replaced::Damaged(bad)) => {
            format!("replaced {shown}, which was damaged: {bad}")
        }
        FileDecision::Replaced(Replaced::HadLess) => {
            format!("replaced {shown}, which had less than the store's")
        }
        FileDecision::Replaced(Replaced::WithPlan) => return None,
        FileDecision::Replaced(Replaced::NotOfPlan) => {
            format!("replaced {shown}, which had been changed since it was frozen")
        }
        FileDecision::HasMore => {
            format!("{shown} has more than the store's and stays; `dtd push` sends it")
        }
        FileDecision::OnlyInStore => return None,
        FileDecision::Missing => format!(
            "{name} is missing, here and in the store, and cannot be regenerated without plan.json and corpus.toml"
        ),
        FileDecision::SplitAgain => SPLIT_AGAIN.into(),
    })
}
