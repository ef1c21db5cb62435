//! Object stores on the command line: exit codes of their failures, the stage, and transfers that can be stopped.

use std::env;
use std::path::{Path, PathBuf};
use std::time::Duration;

use dataset::plan::PlannedScenarios;
use store::{CorpusStore, MirrorError, StoreError, StoreUrl};
use tokio::time::sleep;

use super::async_runtime::async_runtime;
use crate::failure::Failure;
use crate::progress::verb_watch::VerbWatch;

/// Longest time for transfers to stop.
const STOP_TIMEOUT: Duration = Duration::from_secs(5);

/// The message about a regenerated split.
pub(super) const SPLIT_AGAIN: &str = "splits.json was lost and has been regenerated from plan and seed; if the corpus was ever added to, its \
                                      sides may have changed: train again before you evaluate";

/// A failure of the store, or something that the caller must fix.
pub(super) fn failure_of(error: StoreError) -> Failure {
    match error {
        StoreError::Local(error) => Failure::of_corpus(error),
        StoreError::Stopped(_) => Failure::Interrupted { resumes: true },
        error if error.is_bad_input() => Failure::bad_input(error),
        error => Failure::Failed(error.into()),
    }
}

/// The same of a whole corpus.
pub(super) fn failure_to_mirror(error: MirrorError) -> Failure {
    match error {
        MirrorError::Store(error) => failure_of(error),
        MirrorError::Folder(error) => Failure::bad_input(error),
        MirrorError::Refused { .. } => Failure::bad_input(error),
        MirrorError::Damaged { .. } => Failure::Failed(error.into()),
    }
}

/// Advice for a scenario that is damaged in a store. A scenario that is not planned is neither pushed nor recorded.
pub(super) fn mend(store: &CorpusStore, planned: &PlannedScenarios, id: &str) -> String {
    if planned.has(id) {
        "`dtd push` from a folder that has it whole sends what is missing; without one, `dtd generate` records it again".into()
    } else {
        format!(
            "plan.json has no such scenario: delete {}/scenarios/{id}/DONE.json, which removes it from the corpus",
            store.name()
        )
    }
}

/// The default stage of a URL: in the user's cache, which survives a reboot, unlike the folder for temporary files.
pub(super) fn default_stage(url: &StoreUrl) -> PathBuf {
    let set = |name: &str| env::var_os(name).filter(|value| !value.is_empty());
    let cache = set("XDG_CACHE_HOME")
        .map(PathBuf::from)
        .filter(|path| path.is_absolute())
        .or_else(|| set("HOME").map(|home| Path::new(&home).join(".cache")))
        .unwrap_or_else(env::temp_dir);
    cache.join("dtd").join("staging").join(url.folder_name())
}

/// Runs a verb's transfers. If they do not end soon after the verb was stopped, because a store does not answer or another process holds
/// a scenario, they are dropped, which is no worse than a kill.
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
