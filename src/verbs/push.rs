//! `dtd push`: a corpus from a folder into an object store.

use std::path::Path;
use std::time::Duration;

use dataset::corpus::Corpus;
use dataset::outside_file::{self, FileKind};
use dataset::own_path::own_path;
use generator::plan::Plan;
use serde::Serialize;
use store::{CORPUS_FILES, CorpusStore, Keep, OnOther, Patience, Pushed, Settled};

use super::Outcome;
use super::async_runtime::async_runtime;
use super::object_store::{OnBar, failure_of};
use super::open_corpus::open_filled_corpus;
use super::output::{count, print_json};
use crate::args::PushArgs;
use crate::failure::{Ending, Failure};
use crate::progress::Bar;

/// What happened to the scenarios.
#[derive(Default, Serialize)]
struct Sent {
    /// Sent by this call.
    pushed: Vec<String>,
    /// Of these, those of which the store had another content.
    replaced: Vec<String>,
    /// Committed already, with this content.
    unchanged: Vec<String>,
    /// Files of detections that were sent.
    detections: usize,
}

/// Runs the verb.
pub(crate) fn run(args: &PushArgs) -> Outcome {
    let corpus = open_filled_corpus(&args.corpus)?;
    let store = CorpusStore::open(&args.url, true).map_err(failure_of)?;
    let patience = Patience(Duration::from_secs(args.patience));
    let sent = async_runtime()?.block_on(send(&corpus, &store, patience))?;
    if args.json {
        print_json(&sent)?;
    } else {
        println!(
            "{} pushed ({} replaced), {} there already: {}",
            count(sent.pushed.len(), "scenario"),
            sent.replaced.len(),
            sent.unchanged.len(),
            store.name()
        );
    }
    Ok(Ending::Done)
}

async fn send(corpus: &Corpus, store: &CorpusStore, patience: Patience) -> Result<Sent, Failure> {
    let bar = Bar::new("push", "scenarios", None);
    let watch = OnBar(&bar);
    store.check().await.map_err(failure_of)?;
    send_corpus_files(corpus, store).await?;
    let scenarios = corpus.scenarios().map_err(Failure::of_corpus)?;
    bar.set_total(scenarios.len() as u64);
    let mut sent = Sent::default();
    for (done, folder) in scenarios.iter().enumerate() {
        let id = folder.id();
        bar.working_on(&id);
        bar.set_done(done as u64);
        let pushed = patience
            .with(&watch, async |watch| {
                store.push_scenario(folder, OnOther::Replace, watch).await
            })
            .await
            .map_err(failure_of)?;
        match pushed {
            Pushed::Committed { replaced, .. } => {
                if replaced {
                    sent.replaced.push(id.clone());
                }
                sent.pushed.push(id);
            }
            Pushed::Same | Pushed::Other => sent.unchanged.push(id),
        }
        sent.detections += patience
            .with(&watch, async |watch| {
                store.push_detections(folder, watch).await
            })
            .await
            .map_err(failure_of)?;
    }
    bar.set_done(scenarios.len() as u64);
    Ok(sent)
}

/// Sends plan, split and sweep. A store that was begun with another plan is refused; one whose plan has more scenarios keeps its own.
async fn send_corpus_files(corpus: &Corpus, store: &CorpusStore) -> Result<(), Failure> {
    let mut keep = Keep::Ours;
    for name in CORPUS_FILES {
        let path = own_path(corpus.root(), name).map_err(Failure::bad_input)?;
        if !path.exists() {
            continue;
        }
        let ours = outside_file::read(&path, FileKind::PLAN)?;
        let is_plan = path == corpus.plan_path();
        let settled = store
            .settle(name, &ours, |theirs| match is_plan {
                true => longer_plan(&ours, &path, theirs, store),
                false => Ok(keep),
            })
            .await
            .map_err(Refused::into_failure)?;
        if is_plan && settled == Settled::Theirs {
            keep = Keep::Theirs;
        }
    }
    Ok(())
}

/// Why a plan is not sent.
enum Refused {
    Store(store::StoreError),
    Plan(dataset::Error),
    Other(String),
}

impl From<store::StoreError> for Refused {
    fn from(error: store::StoreError) -> Self {
        Self::Store(error)
    }
}

impl Refused {
    fn into_failure(self) -> Failure {
        match self {
            Self::Store(error) => failure_of(error),
            Self::Plan(error) => Failure::bad_input(error),
            Self::Other(message) => Failure::bad_input_message(message),
        }
    }
}

fn longer_plan(
    ours: &[u8],
    path: &Path,
    theirs: &[u8],
    store: &CorpusStore,
) -> Result<Keep, Refused> {
    let their_path = format!("{}/plan.json", store.name());
    let ours = Plan::parse(ours, path).map_err(Refused::Plan)?;
    let theirs = Plan::parse(theirs, Path::new(&their_path)).map_err(Refused::Plan)?;
    if theirs.conflict_with(&ours).is_none() {
        return Ok(Keep::Theirs);
    }
    match ours.conflict_with(&theirs) {
        None => Ok(Keep::Ours),
        Some(difference) => Err(Refused::Other(format!(
            "{}: the corpus was begun with another plan: {difference}. A corpus can only be added to: push to another prefix",
            store.name()
        ))),
    }
}
