//! Object stores on the command line: exit codes of their failures, the stage, transfers that can be stopped, and the part that `fetch` and
//! `push` share.

use std::env;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use indicatif::{DecimalBytes, HumanDuration};
use serde_json::Value;
use store::{Connection, CorpusStore, MirrorReport, StoreError, StoreUrl};
use tokio::time::sleep;

use super::async_runtime::async_runtime;
use super::output::{interrupted, print_json};
use crate::failure::{Ending, Failure};
use crate::progress::verb_watch::VerbWatch;

/// Longest wait for a store of verbs without `--timeout`.
pub(super) const STORE_TIMEOUT: Duration = Duration::from_secs(300);
/// Longest time for transfers to stop.
const STOP_TIMEOUT: Duration = Duration::from_secs(5);

/// A failure of the store, or something that the caller must fix.
pub(super) fn failure_of(error: StoreError) -> Failure {
    match error {
        StoreError::Local(error) => Failure::of_corpus(error),
        StoreError::Stopped(_) => Failure::Interrupted { resumes: true },
        error if error.is_bad_input() => Failure::bad_input(error),
        error if error.is_passing() => Failure::Failed(anyhow::anyhow!(
            "{error}; run the same command again to resume"
        )),
        error => Failure::Failed(error.into()),
    }
}

/// Default stage for a URL: in the user's cache, which survives a reboot, unlike the folder for temporary files.
pub(super) fn default_stage(url: &StoreUrl) -> PathBuf {
    let set = |name: &str| env::var_os(name).filter(|value| !value.is_empty());
    let cache = set("XDG_CACHE_HOME")
        .map(PathBuf::from)
        .filter(|path| path.is_absolute())
        .or_else(|| set("HOME").map(|home| Path::new(&home).join(".cache")))
        .unwrap_or_else(env::temp_dir);
    cache.join("dtd").join("staging").join(url.folder_name())
}

/// Runs a verb's transfers. If they do not end soon after the verb was stopped, because a store does not answer or a scenario is
/// claimed elsewhere, they are dropped, which is no worse than a kill.
pub(super) fn run_transfers<T>(
    watch: &VerbWatch,
    transfers: impl Future<Output = Result<T, Failure>>,
) -> Result<T, Failure> {
    let runtime = async_runtime()?;
    let result = runtime.block_on(async {
        let no_longer = async {
            watch.stopped().await;
            sleep(STOP_TIMEOUT).await;
        };
        tokio::select! {
            result = transfers => result,
            () = no_longer => Err(Failure::Interrupted { resumes: true }),
        }
    });
    runtime.shutdown_background();
    result
}

/// Result after a corpus transfer.
pub(super) struct Mirrored {
    pub(super) report: MirrorReport,
    pub(super) bytes: u64,
    pub(super) stopped: bool,
    took: Duration,
}

/// Transfers a corpus. The result includes all that was done before a signal.
pub(super) fn mirror(
    verb: &'static str,
    store: &CorpusStore,
    transfer: impl AsyncFnOnce(&Connection<'_>, &mut MirrorReport) -> store::Result<()>,
) -> Result<Mirrored, Failure> {
    let began = Instant::now();
    let watch = VerbWatch::new(verb, "scenarios");
    let connection = store.watched(&watch);
    let mut report = MirrorReport::default();
    let transferring = async { transfer(&connection, &mut report).await.map_err(failure_of) };
    let stopped = match run_transfers(&watch, transferring) {
        Err(Failure::Interrupted { .. }) if !report.left.is_empty() => true,
        result => result.map(|()| false)?,
    };
    Ok(Mirrored {
        bytes: connection.bytes(),
        report,
        stopped,
        took: began.elapsed(),
    })
}

impl Mirrored {
    /// Prints the result: as JSON, or `scenarios` and then bytes, time and `place`.
    pub(super) fn print(
        &self,
        json: Option<Value>,
        scenarios: &str,
        place: &str,
    ) -> Result<(), Failure> {
        match json {
            Some(json) => print_json(&json)?,
            None => println!(
                "{scenarios}; {} in {}: {place}",
                DecimalBytes(self.bytes),
                HumanDuration(self.took)
            ),
        }
        for line in &self.report.corpus_files {
            eprintln!("{line}");
        }
        Ok(())
    }

    /// Prints the losses; `moved` is the verb's participle.
    pub(super) fn end(&self, moved: &str) -> Ending {
        let report = &self.report;
        for (model, reason) in &report.left_detections {
            eprint_warning!("detections {model} were not {moved}: {reason}");
        }
        for (what, reason) in &report.refused {
            eprint_warning!("{what} was not {moved}: {reason}");
        }
        if self.stopped {
            return interrupted(report.moved.len(), moved, report.left.len());
        }
        let lists = [&report.left_detections, &report.refused];
        if lists.iter().all(|list| list.is_empty()) && report.different.is_empty() {
            Ending::Done
        } else {
            Ending::Losses
        }
    }
}

/// Pairs as JSON objects with these keys.
pub(super) fn objects<'a>(
    pairs: impl IntoIterator<Item = &'a (String, String)>,
    [first, second]: [&str; 2],
) -> Value {
    let object = |(one, other): &(String, String)| serde_json::json!({first: one, second: other});
    pairs.into_iter().map(object).collect()
}
