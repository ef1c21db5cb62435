//! Location of a run: it is built beside the final folder, which it replaces atomically.
//!
//! ```text
//! RUN             the run that counts
//! RUN.partial/    beside it, on the same file system
//!   claim         locked by the process that works on the run
//!   new/          a run that is being made
//!   old/          the run that it replaces, on its way out
//!   training/     checkpoint of a training that was killed ([`crate::networks::checkpoint`])
//! ```
//!
//! A run is built in `new/`, which records from the start which run it replaces (`replaces.json`), and sealed like a scenario
//! (`MANIFEST.b3`, then `DONE.json`). The seal commits the change: `RUN` moves to `old/`, `new/` to `RUN`, and `old/` is deleted. The next
//! holder of the claim completes a committed change and drops an uncommitted one. Only the run that existed when the new one was started is
//! ever replaced, and only files of a run are ever deleted. An evaluation also builds a complete run: the training's files, and its own.

use std::fs;
use std::io::ErrorKind;
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::path::{Path, PathBuf};

use dataset::corpus::claim::{Claim, Claimed};
use dataset::corpus::own_folder_around;
use dataset::corpus::seal;
use dataset::files::json_file::{read_json, write_json_unsynced};
use dataset::files::new_file::{clear_leftovers, sync};
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result, RunFault};
use crate::run::folder::RunFolder;

const CLAIM: &str = "claim";
const NEW: &str = "new";
const OLD: &str = "old";
const TRAINING: &str = "training";
/// Maximum number of foreign files named in an error.
const MOST_NAMED: usize = 20;

/// A run's location, locked until this is dropped.
#[derive(Debug)]
pub(crate) struct RunPlace {
    run: PathBuf,
    beside: PathBuf,
    _claim: Claim,
}

impl RunPlace {
    /// Takes the location of a new run; it must be empty or contain a run.
    pub(crate) fn take(run: &RunFolder) -> Result<Self> {
        Self::take_if(run, |_| true)
    }

    /// Takes a vacant location, for results that do not belong in a run's folder.
    pub(crate) fn take_vacant(folder: &Path) -> Result<Self> {
        let refused = |fault| Err(Error::run(folder, fault));
        if !is_vacant(folder) {
            return refused(RunFault::Occupied);
        }
        let place = Self::take(&RunFolder::at(folder))?;
        match is_vacant(&place.run) {
            true => Ok(place),
            // Completed just now, after a kill.
            false => refused(RunFault::Occupied),
        }
    }

    /// Takes the location of an existing run.
    pub(crate) fn take_existing(run: &RunFolder) -> Result<Self> {
        let root = run.root();
        let is_there = |run: &Path| {
            let beside = RunFolder::place_beside(run);
            run.is_dir() || beside.join(NEW).is_dir() || beside.join(OLD).is_dir()
        };
        let place = Self::take_if(run, is_there)?;
        match place.run.join(RunFolder::SUMMARY).is_file() {
            true => Ok(place),
            false => Err(Error::run(root, RunFault::Unfinished)),
        }
    }

    fn take_if(run: &RunFolder, is_wanted: impl Fn(&Path) -> bool) -> Result<Self> {
        let run = real_path(run.root())?;
        if let Some(own) = own_folder_around(&run) {
            let own = own.to_owned();
            return Err(Error::run(&run, RunFault::InCorpus { own }));
        }
        refuse_in_run(&run)?;
        if !is_wanted(&run) {
            return Err(Error::run(&run, RunFault::Unfinished));
        }
        let parent = parent_of(&run);
        fs::create_dir_all(parent).map_err(|error| cannot_be_made(&run, error))?;
        let beside = RunFolder::place_beside(&run);
        refuse_strangers(
            &beside,
            &[CLAIM, NEW, OLD, TRAINING],
            "is where a run is made, but",
        )?;
        let claim = match Claim::take_in(&beside, CLAIM) {
            Ok(Claimed::Mine(claim)) => claim,
            Ok(Claimed::Theirs(holder)) => {
                return Err(Error::Held {
                    run,
                    holder: holder.to_string(),
                });
            }
            Err(error) if error.is_of_disk() => return Err(error.into()),
            Err(dataset::Error::Io { source, .. }) => return Err(cannot_be_made(&run, source)),
            Err(error) => return Err(error.into()),
        };
        let place = Self {
            run,
            beside,
            _claim: claim,
        };
        place.recover()?;
        place.refuse_other_content()?;
        Ok(place)
    }

    /// The current run.
    pub(crate) fn run(&self) -> RunFolder {
        RunFolder::at(&self.run)
    }

    /// An empty folder for a new run.
    pub(crate) fn begin(&self) -> Result<RunFolder> {
        let new = self.new_run();
        fs::create_dir(&new).map_err(dataset::Error::io("create", &new))?;
        let replaces = Replaces {
            run: identity(&self.run)?,
        };
        write_json_unsynced(&new.join(RunFolder::REPLACES), &replaces)?;
        Ok(RunFolder::at(&new))
    }

    /// Checkpoint folder of a training until its run is in place.
    pub(crate) fn checkpoint(&self) -> PathBuf {
        self.training().join(RunFolder::CHECKPOINT)
    }

    /// Removes the checkpoint of a training whose run is in place.
    pub(crate) fn remove_checkpoint(&self) -> Result<()> {
        for (path, removed) in [
            (self.checkpoint(), fs::remove_file(self.checkpoint())),
            (self.training(), fs::remove_dir(self.training())),
        ] {
            match removed {
                Err(error) if error.kind() != ErrorKind::NotFound => {
                    return Err(dataset::Error::io("remove", &path)(error).into());
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Moves the new, completely written run into place.
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
        self.beside.join(NEW)
    }

    fn old_run(&self) -> PathBuf {
        self.beside.join(OLD)
    }

    fn training(&self) -> PathBuf {
        self.beside.join(TRAINING)
    }

    /// Completes what a killed process had committed, and drops what it had not.
    fn recover(&self) -> Result<()> {
        clear_leftovers(&self.training());
        let checkpoint = &[RunFolder::CHECKPOINT];
        refuse_strangers(
            &self.training(),
            checkpoint,
            "is where a training is kept, but",
        )?;
        let (new, old) = (self.new_run(), self.old_run());
        for folder in [&new, &old] {
            clear_leftovers(folder);
            refuse_strangers(folder, &RunFolder::FILES, "is where a run is made, but")?;
        }
        let is_decided = new.join(seal::DONE).exists() && seal::faults(&new)?.is_empty();
        // When a run is deleted, run.json goes first.
        let old_is_whole = old.join(RunFolder::SUMMARY).is_file();
        if old_is_whole && !is_decided && is_vacant(&self.run) {
            rename(&old, &self.run)?;
        }
        if is_decided {
            if old.is_dir() && !is_vacant(&self.run) {
                return Err(Error::run(&self.run, RunFault::Contested { new, old }));
            }
            self.put_in_place()?;
            tracing::warn!(
                run = %self.run.display(),
                "an earlier training or evaluation had finished, but was killed before its run was in its place; it is now"
            );
            return Ok(());
        }
        remove_run(&new)?;
        remove_run(&old)
    }

    fn put_in_place(&self) -> Result<()> {
        let (new, old) = (self.new_run(), self.old_run());
        // Somebody may have put something there since it was looked at.
        self.refuse_other_content()?;
        let there = match identity(&self.run)? {
            None => identity(&old)?,
            there => there,
        };
        let replaces = new.join(RunFolder::REPLACES);
        let expected = match read_json::<Replaces>(&replaces, "note of what a run replaces") {
            Ok(Replaces { run }) => run,
            // Of an earlier version, or foreign.
            Err(error) if error.is_not_found() => None,
            Err(error) => return Err(error.into()),
        };
        if there.is_some() && there != expected {
            return Err(Error::run(&self.run, RunFault::OtherRun { new }));
        }
        if !is_vacant(&self.run) {
            rename(&self.run, &old)?;
        }
        rename(&new, &self.run)?;
        remove_run(&old)
    }

    /// Rejects a folder that contains anything but a run: it will be replaced as a whole.
    fn refuse_other_content(&self) -> Result<()> {
        refuse_strangers(&self.run, &RunFolder::FILES, "is not a run:")?;
        let is_run = is_vacant(&self.run) || self.run.join(RunFolder::SUMMARY).is_file();
        match is_run {
            true => Ok(()),
            // Whatever it contains, it is not a finished training.
            false => refuse_strangers(&self.run, &[], "has no run.json, so it is not a run:"),
        }
    }
}

impl Drop for RunPlace {
    fn drop(&mut self) {
        let new = self.new_run();
        // The next holder completes a committed change, and removes then what cannot be removed now.
        if new.is_dir() && !new.join(seal::DONE).exists() {
            clear_leftovers(&new);
            let _ = remove_run(&new);
        }
    }
}

/// The new run's record of its destination (`replaces.json`).
#[derive(Serialize, Deserialize)]
struct Replaces {
    /// The run that existed; `null` if there was none.
    run: Option<String>,
}

/// The identity of a run: the hash of its manifest, or of its `run.json` if it has no seal. `None` if there is no run.
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

fn parent_of(run: &Path) -> &Path {
    run.parent().unwrap_or(run)
}

/// Refuses a path in the folder of a run.
pub(crate) fn refuse_in_run(path: &Path) -> Result<()> {
    let folder = path.parent().unwrap_or(Path::new(""));
    match folder.join(RunFolder::SUMMARY).is_file() {
        true => Err(Error::run(path, RunFault::InRun)),
        false => Ok(()),
    }
}

fn cannot_be_made(run: &Path, error: std::io::Error) -> Error {
    Error::run(run, RunFault::NotMade(error))
}

/// The path of a run with all links resolved; a link to a run works like the run.
fn real_path(run: &Path) -> Result<PathBuf> {
    let refused = |fault| Err(Error::run(run, fault));
    let real = match fs::canonicalize(run) {
        Ok(real) => real,
        Err(error) if error.kind() == ErrorKind::NotFound => {
            // A link to a run that is just being replaced is dangling for a moment.
            let named = fs::read_link(run).map_or(run.to_owned(), |to| parent_of(run).join(to));
            let Some(name) = named.file_name() else {
                return refused(RunFault::NoName);
            };
            let parent = match named.parent() {
                Some(parent) if !parent.as_os_str().is_empty() => parent,
                _ => Path::new("."),
            };
            let parent = std::path::absolute(parent).map_err(|error| cannot_be_made(run, error))?;
            fs::canonicalize(&parent).unwrap_or(parent).join(name)
        }
        Err(error) => return Err(cannot_be_made(run, error)),
    };
    let Ok(found) = fs::metadata(&real) else {
        return Ok(real);
    };
    if !found.is_dir() {
        let kind = found.file_type();
        let found = match () {
            () if kind.is_file() => "a file",
            () if kind.is_fifo() => "a FIFO",
            () if kind.is_socket() => "a socket",
            () => "a device",
        };
        return refused(RunFault::NotAFolder { found });
    }
    let parent = real.parent().map(fs::metadata);
    match parent {
        Some(Ok(parent)) if parent.dev() == found.dev() => Ok(real),
        _ => refused(RunFault::TopOfFileSystem {
            inside: run.join("run"),
        }),
    }
}

/// True if the location does not exist or is an empty folder.
fn is_vacant(run: &Path) -> bool {
    match fs::read_dir(run) {
        Ok(mut entries) => entries.next().is_none(),
        Err(error) => error.kind() == ErrorKind::NotFound,
    }
}

/// Rejects a folder with anything in it but files and folders of these names.
fn refuse_strangers(folder: &Path, known: &[&str], what: &'static str) -> Result<()> {
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(dataset::Error::io("list", folder)(error).into()),
    };
    let mut names = Vec::new();
    for entry in entries {
        let entry = entry.map_err(dataset::Error::io("list", folder))?;
        let name = entry.file_name().to_string_lossy().into_owned();
        let is_link = entry.file_type().is_ok_and(|kind| kind.is_symlink());
        if is_link || !known.contains(&name.as_str()) {
            names.push(name);
        }
    }
    if names.is_empty() {
        return Ok(());
    }
    names.sort();
    let more = names.len().saturating_sub(MOST_NAMED);
    names.truncate(MOST_NAMED);
    if more > 0 {
        names.push(format!("and {more} more"));
    }
    Err(Error::run(folder, RunFault::Strangers { what, names }))
}

fn rename(from: &Path, to: &Path) -> Result<()> {
    fs::rename(from, to).map_err(dataset::Error::io("rename into place", to))?;
    sync(parent_of(from))?;
    Ok(sync(parent_of(to))?)
}

/// Removes the files of a run, and its folder if that leaves it empty.
fn remove_run(run: &Path) -> Result<()> {
    if !run.is_dir() {
        return Ok(());
    }
    let others = RunFolder::FILES.into_iter();
    let others = others.filter(|&name| name != RunFolder::SUMMARY);
    for name in [RunFolder::SUMMARY].into_iter().chain(others) {
        let path = run.join(name);
        match fs::remove_file(&path) {
            Ok(()) => {}
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(error) => return Err(dataset::Error::io("remove", &path)(error).into()),
        }
    }
    Ok(fs::remove_dir(run).map_err(dataset::Error::io("remove", run))?)
}
