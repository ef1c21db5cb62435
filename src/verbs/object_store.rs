//! Object stores on the command line: exit codes of their failures, decisions about a corpus's files, the stage, and how waiting is
//! displayed.

use std::env;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use dataset::plan::PlannedScenarios;
use store::{CorpusStore, MirrorError, StoreError, StoreUrl, Watch};

use crate::failure::Failure;
use crate::progress::Bar;

/// The message about a regenerated split.
pub(super) const SPLIT_AGAIN: &str = "splits.json was lost and has been regenerated from plan and seed; if the corpus was ever added to, its \
                                      sides may not be those of before: train again before you evaluate";

/// A failure of the store, or something that the caller must fix.
pub(super) fn failure_of(error: StoreError) -> Failure {
    match error {
        StoreError::Local(error) => Failure::of_corpus(error),
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

/// Shows on a bar when the store is being retried, and counts what was transferred.
pub(super) struct OnBar<'a> {
    bar: &'a Bar,
    bytes: AtomicU64,
}

impl<'a> OnBar<'a> {
    pub(super) fn new(bar: &'a Bar) -> Self {
        Self {
            bar,
            bytes: AtomicU64::new(0),
        }
    }

    /// Bytes transferred so far, including failed attempts.
    pub(super) fn bytes(&self) -> u64 {
        self.bytes.load(Ordering::Relaxed)
    }
}

impl Watch for OnBar<'_> {
    fn scenario(&self, id: &str, done: usize, total: usize) {
        self.bar.set_total(total as u64);
        self.bar.working_on(id);
        self.bar.set_done(done as u64);
    }

    fn passed(&self, bytes: u64) {
        self.bytes.fetch_add(bytes, Ordering::Relaxed);
    }

    fn waiting(&self, reason: &StoreError) {
        self.bar.warn(&format!("retrying the store: {reason}"));
    }
}
