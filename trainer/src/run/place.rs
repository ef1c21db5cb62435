//! Run location: a new run is built in a workshop beside the final folder, and replaces that atomically.
//!
//! ```text
//! RUN             current run
//! RUN.partial/    workshop ([`dataset::corpus::workshop`])
//!   new/          run in the making
//!   old/          replaced run, before its deletion
//!   training/     checkpoint ([`crate::networks::checkpoint`])
//! ```
//!
//! A run is built in `new/`, which first records the identity of the run to replace (`replaces.json`), and is sealed like a scenario
//! (`MANIFEST.b3`, then `DONE.json`). The seal commits the change: `RUN` moves to `old/`, `new/` to `RUN`, and `old/` is deleted. The next
//! holder of the lock completes a committed change and drops an uncommitted one. Only the recorded run is ever replaced, and only run files
//! are ever deleted. An evaluation also builds a complete run: the training's files plus the results.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use dataset::corpus::seal;
use dataset::corpus::workshop::{self, NEW, Workshop, is_vacant, refuse_strangers};
use dataset::files::json_file::{read_json, write_json_unsynced};
use dataset::files::new_file::clear_leftovers;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::run::folder::RunFolder;

const OLD: &str = "old";
const TRAINING: &str = "training";

/// Run location, locked until dropped.
#[derive(Debug)]
pub(crate) struct RunPlace {
    workshop: Workshop,
}

impl RunPlace {
    /// Locks the location for a new run; it must be empty or contain a run.
    pub(crate) fn take(run: &RunFolder) -> Result<Self> {
        Self::take_if(run, |_| true)
    }

    /// Locks a vacant location, for results outside run folders.
    pub(crate) fn take_vacant(folder: &Path) -> Result<Self> {
        let refuse_content = |folder: &Path| {
            let what = "is not empty, and an evaluation replaces no files:";
            refuse_strangers(folder, what, |_| false)
        };
        refuse_content(folder)?;
        let place = Self::take(&RunFolder::at(folder))?;
        // An earlier evaluation may have been completed just now, after a kill.
        refuse_content(place.place())?;
        Ok(place)
    }

    /// Locks an existing run.
    pub(crate) fn take_existing(run: &RunFolder) -> Result<Self> {
        let is_there = |run: &Path| {
            let beside = Workshop::beside(run);
            run.join(RunFolder::SUMMARY).is_file()
                || beside.join(NEW).is_dir()
                || beside.join(OLD).is_dir()
        };
        let place = Self::take_if(run, is_there)?;
        if !place.run().path(RunFolder::SUMMARY).is_file() {
            return Err(unfinished(run.root()));
        }
        Ok(place)
    }

    fn take_if(run: &RunFolder, is_wanted: impl Fn(&Path) -> bool) -> Result<Self> {
        let run = workshop::resolve(run.root())?;
        refuse_in_run(&run)?;
        if !is_wanted(&run) {
            return Err(unfinished(&run));
        }
        let workshop = Workshop::enter(&run, &[OLD, TRAINING], Duration::ZERO)?;
        let place = Self { workshop };
        place.recover()?;
        place.refuse_other_content()?;
        Ok(place)
    }

    fn place(&self) -> &Path {
        self.workshop.place()
    }

    /// The current run.
    pub(crate) fn run(&self) -> RunFolder {
        RunFolder::at(self.place())
    }

    /// An empty folder for a new run.
    pub(crate) fn begin(&self) -> Result<RunFolder> {
        let new = self.new_run();
        fs::create_dir(&new).map_err(dataset::Error::io("create", &new))?;
        let replaces = Replaces {
            run: identity(self.place())?,
        };
        write_json_unsynced(&new.join(RunFolder::REPLACES), &replaces)?;
        Ok(RunFolder::at(&new))
    }

    /// Checkpoint path, until the run is in place.
    pub(crate) fn checkpoint(&self) -> PathBuf {
        self.workshop.path(TRAINING).join(RunFolder::CHECKPOINT)
    }

    /// Removes the checkpoint after the run is in place.
    pub(crate) fn remove_checkpoint(&self) -> Result<()> {
        let checkpoint = &[RunFolder::CHECKPOINT];
        Ok(self.workshop.remove_files(TRAINING, checkpoint)?)
    }

    /// Seals the completely written run and moves it into place.
    pub(crate) fn commit(&self, config_hash: &str) -> Result<()> {
        seal::seal_folder(&self.new_run(), config_hash)?;
        self.put_in_place().inspect_err(|_| {
            tracing::warn!(
                run = %self.new_run().display(),
                "the finished run is whole there; the next start puts it into its place, if that is free or holds the run that it replaces"
            );
        })
    }

    fn new_run(&self) -> PathBuf {
        self.workshop.path(NEW)
    }

    fn old_run(&self) -> PathBuf {
        self.workshop.path(OLD)
    }

    /// Completes a killed process's committed change, or drops an uncommitted one.
    fn recover(&self) -> Result<()> {
        self.workshop.tidy(TRAINING, &[RunFolder::CHECKPOINT])?;
        self.workshop.tidy(NEW, &RunFolder::FILES)?;
        self.workshop.tidy(OLD, &RunFolder::FILES)?;
        let (run, new, old) = (self.place(), self.new_run(), self.old_run());
        let is_decided = new.join(seal::DONE).exists() && seal::faults(&new)?.is_empty();
        // When a run is deleted, run.json goes first.
        let old_is_whole = old.join(RunFolder::SUMMARY).is_file();
        if old_is_whole && !is_decided && is_vacant(run) {
            workshop::rename(&old, run)?;
        }
        if is_decided {
            if old.is_dir() && !is_vacant(run) {
                let fault = format!(
                    "appeared while {} was about to replace the run that is now at {}; keep one of the three and move the others away",
                    new.display(),
                    old.display()
                );
                return Err(Error::run(run, fault));
            }
            self.put_in_place()?;
            tracing::warn!(
                run = %run.display(),
                "an earlier training or evaluation had finished, but was killed before its run was in its place; it is now"
            );
            return Ok(());
        }
        self.remove_run(NEW)?;
        self.remove_run(OLD)
    }

    fn put_in_place(&self) -> Result<()> {
        let (run, new, old) = (self.place(), self.new_run(), self.old_run());
        // A different program may have written there since the last check.
        self.refuse_other_content()?;
        let there = match identity(run)? {
            None => identity(&old)?,
            there => there,
        };
        let replaces = new.join(RunFolder::REPLACES);
        let Replaces { run: expected } = read_json(&replaces, "note of what a run replaces")?;
        if there.is_some() && there != expected {
            let fault = format!(
                "is not the run that {} was made to replace; move one of the two away",
                new.display()
            );
            return Err(Error::run(run, fault));
        }
        if !is_vacant(run) {
            workshop::rename(run, &old)?;
        }
        self.workshop.put_in_place()?;
        self.remove_run(OLD)
    }

    fn remove_run(&self, folder: &str) -> Result<()> {
        Ok(self.workshop.remove_files(folder, &RunFolder::FILES)?)
    }

    /// Rejects a folder that contains anything but a run, because it will be replaced as a whole.
    fn refuse_other_content(&self) -> Result<()> {
        let run = self.place();
        let is_own = |name: &str| RunFolder::FILES.contains(&name);
        refuse_strangers(run, "is not a run:", is_own)?;
        if !run.join(RunFolder::SUMMARY).is_file() {
            // Whatever it contains, it is not a finished training.
            let what = "has no run.json, so it is not a run:";
            refuse_strangers(run, what, |_| false)?;
        }
        Ok(())
    }
}

impl Drop for RunPlace {
    fn drop(&mut self) {
        let new = self.new_run();
        // The next holder completes a committed change, and removes then what cannot be removed now.
        if new.is_dir() && !new.join(seal::DONE).exists() {
            clear_leftovers(&new);
            let _ = self.remove_run(NEW);
        }
    }
}

/// Content of `replaces.json`.
#[derive(Serialize, Deserialize)]
struct Replaces {
    /// Identity of the replaced run; `null` if there was none.
    run: Option<String>,
}

/// Identity: hash of the manifest, or of `run.json` without a seal. `None` if there is no run.
fn identity(run: &Path) -> Result<Option<String>> {
    match seal::read_seal(run) {
        Ok(Some(seal)) => return Ok(Some(seal.manifest_blake3)),
        Ok(None) => {}
        Err(error) if error.is_bad_content() => {}
        Err(error) => return Err(error.into()),
    }
    match seal::hash_file(&run.join(RunFolder::SUMMARY)) {
        Ok(hash) => Ok(Some(hash)),
        Err(error) if error.is_not_found() => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// Refuses paths inside run folders.
pub(crate) fn refuse_in_run(path: &Path) -> Result<()> {
    let folder = path.parent().unwrap_or(Path::new(""));
    if folder.join(RunFolder::SUMMARY).is_file() {
        let fault = "lies in a run, which holds nothing but its own files; name a place outside";
        Err(Error::run(path, fault))
    } else {
        Ok(())
    }
}

pub(crate) fn unfinished(run: &Path) -> Error {
    let fault = "has no run.json, so no training finished there; make one with `dtd train CORPUS --out RUN`";
    Error::run(run, fault)
}
