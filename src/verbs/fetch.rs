//! `dtd fetch`: downloads a corpus from an object store into a folder.

use std::time::Duration;

use generator::sweep_language::Sweeps;
use serde_json::json;
use store::CorpusStore;

use super::Outcome;
use super::object_store::{failure_of, mirror, objects};
use super::output::count;
use crate::args::corpus::FetchArgs;

/// Runs the verb.
pub(crate) fn run(args: &FetchArgs) -> Outcome {
    let timeout = Duration::from_secs(args.timeout_s);
    let store = CorpusStore::open(&args.url, false, timeout).map_err(failure_of)?;
    let fetched = mirror("fetch", &store, async |store, report| {
        store.fetch(&args.out, &args.only, &Sweeps, report).await
    })?;
    let report = &fetched.report;
    let json = args.json.then(|| {
        json!({
            "fetched": report.moved,
            "unchanged": report.unchanged,
            "different": report.different,
            "failed": objects(&report.refused, ["id", "reason"]),
            "detections": report.detections,
            "mended_detections": report.mended_detections,
            "left_detections": objects(&report.left_detections, ["id", "reason"]),
            "corpus_files": report.corpus_files,
            "bytes": fetched.bytes,
            "left": report.left,
            "stopped": fetched.stopped,
        })
    });
    let scenarios = format!(
        "{} fetched, {} there already",
        count(report.moved.len(), "scenario"),
        report.unchanged.len()
    );
    fetched.print(json, &scenarios, &args.out.display().to_string())?;
    for mended in &report.mended_detections {
        eprintln!("mended the detections {mended}, which were damaged here");
    }
    for id in &report.different {
        eprint_warning!(
            "{id} differs from the store's and was left alone; move {} away to fetch it; to replace the store's, delete \
             {}/scenarios/{id}/DONE.json and `dtd push`",
            args.out.join("scenarios").join(id).display(),
            store.name()
        );
    }
    Ok(fetched.end("fetched"))
}
