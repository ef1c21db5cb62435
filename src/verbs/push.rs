//! `dtd push`: uploads a corpus from a folder to an object store.

use std::time::{Duration, Instant};

use dataset::corpus::Corpus;
use generator::sweep_language::Sweeps;
use indicatif::{DecimalBytes, HumanDuration};
use serde::Serialize;
use store::{
    BadFile, Before, CorpusStore, FileDecision, Mirror, MovedDetections, Patience, Pushed,
    PushedCorpus, PushedScenario, Replaced, Transfer,
};

use super::Outcome;
use super::object_store::{SPLIT_AGAIN, failure_of, failure_to_mirror, run_transfers};
use super::open_corpus::open_filled_corpus;
use super::output::{count, print_json};
use crate::args::PushArgs;
use crate::failure::{Ending, Failure};
use crate::progress::verb_watch::VerbWatch;

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
    let watch = VerbWatch::new("push", "scenarios");
    let transfer = Transfer::new(&watch);
    let mirror = Mirror {
        store: &store,
        sweeps: &Sweeps,
        patience: Patience(Duration::from_secs(args.timeout_s)),
        transfer: &transfer,
    };
    let mut pushed = PushedCorpus::default();
    let pushing = async {
        let result = mirror.push(&corpus, &mut pushed).await;
        result.map_err(failure_to_mirror)
    };
    let stopped = match run_transfers(&watch, pushing) {
        Err(Failure::Interrupted { .. }) if !pushed.to_go.is_empty() => true,
        result => result.map(|()| false)?,
    };
    let mut sent = Sent::of(pushed, &corpus, &store);
    (sent.stopped, sent.bytes) = (stopped, transfer.bytes());
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

impl Sent {
    /// The result in words.
    fn of(pushed: PushedCorpus, corpus: &Corpus, store: &CorpusStore) -> Self {
        let mut sent = Self::default();
        let files = pushed.files.iter();
        sent.corpus_files = files
            .map(|(name, decision)| said(name, decision, corpus))
            .collect();
        sent.refused.extend(pushed.left.map(|bad| Refused {
            what: bad.name.into(),
            reason: not_replaced(&bad, store),
        }));
        sent.cleared = pushed.cleared;
        sent.left = pushed.to_go.into();
        for scenario in pushed.scenarios {
            sent.add(scenario, corpus, store);
        }
        sent
    }

    fn add(&mut self, scenario: PushedScenario, corpus: &Corpus, store: &CorpusStore) {
        let (id, folder) = (scenario.folder.id(), scenario.folder.root().display());
        let refused = match scenario.pushed {
            Ok(Pushed::Committed { before, .. }) => {
                self.pushed.push(id.clone());
                match before {
                    Before::Nothing => {}
                    Before::Other => self.replaced.push(id.clone()),
                    Before::Damaged(faults) => self.mended.push(Mended {
                        id: id.clone(),
                        faults: faults.to_string(),
                    }),
                }
                None
            }
            Ok(Pushed::Same) => {
                self.unchanged.push(id.clone());
                None
            }
            Ok(Pushed::Newer) => Some(format!(
                "the store has another one, which is newer; move {folder} away to fetch it"
            )),
            Ok(Pushed::OtherRecording) => Some(format!(
                "the store has another recording of it, with other videos or poses; to keep the store's, move {folder} away and fetch it; to replace it, delete {}/scenarios/{id}/DONE.json and push again",
                store.name()
            )),
            Ok(Pushed::Labelled) => Some(format!(
                "the store has it with labels, and here it has none; run `dtd label` on {}, or move the scenario away and fetch it",
                corpus.root().display()
            )),
            Err(error) => Some(error.to_string()),
        };
        let what = id.clone();
        (self.refused).extend(refused.map(|reason| Refused { what, reason }));
        let MovedDetections {
            moved,
            replaced,
            mended,
            left,
        } = scenario.detections;
        let name = |model: String| format!("{id}/{model}");
        self.detections.extend(moved.into_iter().map(name));
        self.replaced_detections
            .extend(replaced.into_iter().map(name));
        self.mended_detections.extend(mended.into_iter().map(name));
        self.refused.extend(left.into_iter().map(|left| Refused {
            what: name(left.model),
            reason: left.reason,
        }));
    }
}

/// A decision about a file of the whole corpus, in words.
fn said(name: &str, decision: &FileDecision, corpus: &Corpus) -> String {
    let ours = corpus.root().join(name);
    let ours = ours.display();
    match decision {
        FileDecision::Replaced(Replaced::Damaged(bad)) => {
            format!("replaced the store's {name}, which was damaged: {bad}")
        }
        FileDecision::Replaced(Replaced::HadLess) => {
            format!("replaced the store's {name}, which had less than ours")
        }
        FileDecision::Replaced(Replaced::WithPlan) => {
            format!("replaced the store's {name} along with the plan")
        }
        FileDecision::Replaced(Replaced::NotOfPlan) => format!(
            "replaced the store's {name}, which is not the sweep that the plan was made from"
        ),
        FileDecision::HasMore => format!("the store's {name} has more than ours and stays"),
        FileDecision::OnlyInStore => {
            format!("{ours} is missing; the store keeps its own, and `dtd fetch` brings it")
        }
        FileDecision::Missing => format!("{ours} is missing, here and in the store"),
        FileDecision::SplitAgain => SPLIT_AGAIN.into(),
    }
}

/// Reason why a file of the store stays that does not belong there.
fn not_replaced(bad: &BadFile, store: &CorpusStore) -> String {
    let reason = if bad.is_of_other_plan {
        format!("does not belong to the plan.json beside it, which is not ours: {bad}")
    } else {
        format!("is damaged: {bad}")
    };
    format!(
        "{}/{} {reason}. `dtd push` from the folder of that plan, or `dtd generate` with its sweep to this URL, replaces it",
        store.name(),
        bad.name
    )
}
