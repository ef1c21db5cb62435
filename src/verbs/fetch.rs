//! `dtd fetch`: a corpus from an object store into a folder.

use std::collections::BTreeSet;
use std::time::Duration;

use dataset::corpus::Corpus;
use dataset::json_file::write_atomically;
use dataset::outside_file::{self, FileKind};
use dataset::own_path::own_path;
use serde::Serialize;
use store::{CORPUS_FILES, CorpusStore, Fetched, Patience, StoreUrl};

use super::Outcome;
use super::async_runtime::async_runtime;
use super::object_store::{OnBar, failure_of};
use super::output::{count, print_json};
use crate::args::FetchArgs;
use crate::failure::{Ending, Failure};
use crate::progress::Bar;

/// What happened to the scenarios.
#[derive(Default, Serialize)]
struct Mirror {
    /// Brought by this call.
    fetched: Vec<String>,
    /// There already.
    unchanged: Vec<String>,
    /// There already with other content, and left alone.
    different: Vec<String>,
    /// Damaged in the store, with the reason.
    failed: Vec<Lost>,
    /// Files of detections that were brought.
    detections: usize,
}

#[derive(Serialize)]
struct Lost {
    id: String,
    reason: String,
}

/// Runs the verb.
pub(crate) fn run(args: &FetchArgs) -> Outcome {
    let url: &StoreUrl = &args.url;
    let store = CorpusStore::open(url, false).map_err(failure_of)?;
    let patience = Patience(Duration::from_secs(args.patience));
    let mirror = async_runtime()?.block_on(mirror(&store, args, patience))?;
    if args.json {
        print_json(&mirror)?;
    } else {
        println!(
            "{} fetched, {} there already: {}",
            count(mirror.fetched.len(), "scenario"),
            mirror.unchanged.len(),
            args.out.display()
        );
    }
    for id in &mirror.different {
        eprintln!(
            "{id} differs from what the store has and was left alone; move {} away to fetch it, or `dtd push` it",
            args.out.join("scenarios").join(id).display()
        );
    }
    for lost in &mirror.failed {
        eprintln!("{} was not fetched: {}", lost.id, lost.reason);
    }
    Ok(match mirror.different.len() + mirror.failed.len() {
        0 => Ending::Done,
        _ => Ending::Losses,
    })
}

async fn mirror(
    store: &CorpusStore,
    args: &FetchArgs,
    patience: Patience,
) -> Result<Mirror, Failure> {
    let bar = Bar::new("fetch", "scenarios", None);
    let watch = OnBar(&bar);
    store.check().await.map_err(failure_of)?;
    let ids = wanted(store.committed().await.map_err(failure_of)?, args, store)?;
    let corpus = Corpus::create(&args.out).map_err(Failure::bad_input)?;
    fetch_corpus_files(store, &corpus).await?;
    bar.set_total(ids.len() as u64);
    let mut mirror = Mirror::default();
    for (done, id) in ids.iter().enumerate() {
        bar.working_on(id);
        bar.set_done(done as u64);
        let fetched = patience
            .with(&watch, async |watch| {
                store.fetch_scenario(id, &corpus, watch).await
            })
            .await;
        match fetched {
            Ok(Fetched::Whole { .. }) => mirror.fetched.push(id.clone()),
            Ok(Fetched::Same) => mirror.unchanged.push(id.clone()),
            Ok(Fetched::Other) => {
                mirror.different.push(id.clone());
                continue;
            }
            // Taken away since we listed it: somebody is replacing it.
            Ok(Fetched::NotCommitted) => {
                mirror.failed.push(Lost {
                    id: id.clone(),
                    reason: "it is being replaced; run the same command again".into(),
                });
                continue;
            }
            Err(error @ store::StoreError::Damaged { .. }) => {
                mirror.failed.push(Lost {
                    id: id.clone(),
                    reason: error.to_string(),
                });
                continue;
            }
            Err(error) => return Err(failure_of(error)),
        }
        mirror.detections += patience
            .with(&watch, async |watch| {
                store.fetch_detections(&corpus.scenario(id), watch).await
            })
            .await
            .map_err(failure_of)?;
    }
    bar.set_done(ids.len() as u64);
    Ok(mirror)
}

/// The committed scenarios that are asked for.
fn wanted(
    committed: BTreeSet<String>,
    args: &FetchArgs,
    store: &CorpusStore,
) -> Result<Vec<String>, Failure> {
    let nothing = |what: String| {
        Failure::bad_input_message(format!(
            "{}: {what} ({} committed)",
            store.name(),
            count(committed.len(), "scenario")
        ))
    };
    if committed.is_empty() {
        return Err(nothing(
            "holds no committed scenario; is the prefix right?".into(),
        ));
    }
    if let Some(id) = args.only.iter().find(|id| !committed.contains(*id)) {
        return Err(nothing(format!("has no committed scenario {id}")));
    }
    let is_wanted = |id: &String| args.only.is_empty() || args.only.contains(id);
    Ok(committed.into_iter().filter(is_wanted).collect())
}

/// The store has the last word on the files of the whole corpus.
async fn fetch_corpus_files(store: &CorpusStore, corpus: &Corpus) -> Result<(), Failure> {
    let _claim = corpus.claim().map_err(Failure::of_corpus)?;
    for name in CORPUS_FILES {
        if let Some(theirs) = store.read(name).await.map_err(failure_of)? {
            let path = own_path(corpus.root(), name).map_err(Failure::bad_input)?;
            if outside_file::read(&path, FileKind::PLAN).ok().as_ref() != Some(&theirs) {
                write_atomically(&path, &theirs)?;
            }
        }
    }
    Ok(())
}
