//! `dtd push`: uploads a corpus from a folder to an object store.

use std::time::Duration;

use generator::sweep_language::Sweeps;
use serde_json::json;
use store::CorpusStore;

use super::Outcome;
use super::object_store::{failure_of, mirror, objects};
use super::open_corpus::open_filled_corpus;
use super::output::count;
use crate::args::corpus::PushArgs;

/// Runs the verb.
pub(crate) fn run(args: &PushArgs) -> Outcome {
    let corpus = open_filled_corpus(&args.corpus)?;
    let timeout = Duration::from_secs(args.timeout_s);
    let store = CorpusStore::open(&args.url, true, timeout).map_err(failure_of)?;
    let pushed = mirror("push", &store, async |store, report| {
        store.push(&corpus, &Sweeps, report).await
    })?;
    let report = &pushed.report;
    let refused = report.refused.iter().chain(&report.left_detections);
    let json = args.json.then(|| {
        json!({
            "pushed": report.moved,
            "replaced": report.replaced,
            "mended": objects(&report.mended, ["id", "faults"]),
            "unchanged": report.unchanged,
            "refused": objects(refused, ["what", "reason"]),
            "detections": report.detections,
            "replaced_detections": report.replaced_detections,
            "mended_detections": report.mended_detections,
            "corpus_files": report.corpus_files,
            "bytes": pushed.bytes,
            "left": report.left,
            "stopped": pushed.stopped,
        })
    });
    let scenarios = format!(
        "{} pushed ({} replaced, {} mended), {} there already; {} of detections pushed ({} replaced, {} mended)",
        count(report.moved.len(), "scenario"),
        report.replaced.len(),
        report.mended.len(),
        report.unchanged.len(),
        count(report.detections.len(), "set"),
        report.replaced_detections.len(),
        report.mended_detections.len()
    );
    pushed.print(json, &scenarios, store.name())?;
    if !args.json {
        for replaced in &report.replaced {
            println!("replaced the store's {replaced}, which had no labels");
        }
        for replaced in &report.replaced_detections {
            println!("replaced the detections {replaced}, which the store had damaged");
        }
        for mended in &report.mended_detections {
            println!("mended the detections {mended}, which the store had damaged");
        }
        for (id, faults) in &report.mended {
            println!("mended {id}, which the store had damaged: {faults}");
        }
    }
    Ok(pushed.end("pushed"))
}
