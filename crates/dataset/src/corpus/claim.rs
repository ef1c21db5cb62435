//! Exclusive write access when several processes, on one or several machines, work on one corpus.
//!
//! A process that records or changes a scenario holds its claim, whatever the verb; readers need none. A claim is a file `claims/<name>` of
//! the corpus, locked by the operating system: the lock ends with the process, however that ends. The file names the holder. It is outside
//! the folders that are filled, cleared and renamed, and its holder deletes it on release; so a lock counts only if the file is still the
//! one at that path.
//!
//! Across machines this needs a file system with shared locks: NFS 4, Lustre with `flock`, CephFS, GPFS.

use std::fmt;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{ErrorKind, Read, Seek, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use std::{process, thread};

use rustix::fs::OFlags;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
pub use crate::files::corpus_names::WHOLE_CORPUS;
use crate::files::file_name;
use crate::files::json_file::read_json;
use crate::files::new_file::is_named_by;
use crate::files::own_path::refuse_link;

/// Folder of the corpus's claims.
pub(crate) const CLAIMS: &str = "claims";
/// Attempts to open and lock a claim's file, which may be deleted in between.
const ATTEMPTS: u32 = 100;
/// Interval for checking a held claim.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// A claim's file contains a name and a number. Anything larger is not a claim.
const MAX_BYTES: u64 = 512;
/// Waiting is worth a message only if it takes longer than a typical change.
const SAID_AFTER: Duration = Duration::from_secs(2);

/// A claim, held until it is dropped.
#[derive(Debug)]
pub struct Claim {
    path: PathBuf,
    /// Holds the lock.
    file: File,
    keeps_folder: bool,
}

/// The process that holds a claim, as far as its file names it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Holder(Option<Process>);

/// Claim file content.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Process {
    host: String,
    pid: u32,
}

impl Holder {
    /// The process named by a claim's file; `None` without a readable one.
    pub(crate) fn of_file(path: &Path) -> Option<Self> {
        let process = path.exists().then(|| read_json(path, "claim").ok())?;
        process.map(|process| Self(Some(process)))
    }
}

impl fmt::Display for Holder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.0 {
            Some(Process { host, pid }) => write!(f, "process {pid} on {host}"),
            None => f.write_str("another process"),
        }
    }
}

/// The answer to [`Claim::take`].
#[derive(Debug)]
pub enum Claimed {
    /// It is ours.
    Mine(Claim),
    /// A different process has it.
    Theirs(Holder),
}

impl Claimed {
    /// The claim, or an error that names its holder. `held` is the protected path.
    ///
    /// # Errors
    /// [`Error::Held`].
    pub fn or_held(self, held: &Path, waited: Duration) -> Result<Claim> {
        match self {
            Self::Mine(claim) => Ok(claim),
            Self::Theirs(holder) => Err(Error::Held {
                path: held.to_owned(),
                holder: holder.to_string(),
                waited,
            }),
        }
    }
}

impl Claim {
    /// Takes a claim on `held` in a folder of claims; waits up to `patience` for the current holder.
    ///
    /// # Errors
    /// It is still held ([`Error::Held`]), or its file cannot be created.
    pub(crate) fn wait_in(
        folder: &Path,
        name: &str,
        held: &Path,
        patience: Duration,
    ) -> Result<Self> {
        let began = Instant::now();
        let mut said = false;
        loop {
            let claimed = Self::take_in(folder, name)?;
            if began.elapsed() >= patience {
                return claimed.or_held(held, patience);
            }
            let holder = match claimed {
                Claimed::Mine(claim) => return Ok(claim),
                Claimed::Theirs(holder) => holder,
            };
            if !said && began.elapsed() >= SAID_AFTER {
                said = true;
                tracing::warn!(
                    "{}: waiting for {holder}, which is writing it",
                    held.display()
                );
            }
            thread::sleep(POLL_INTERVAL);
        }
    }

    /// Takes a claim, or names its holder. The folder is created, and removed with the last claim unless it has other entries.
    pub fn take_in(folder: &Path, name: &str) -> Result<Claimed> {
        let path = folder.join(name);
        for _ in 0..ATTEMPTS {
            match fs::create_dir_all(folder) {
                Ok(()) => refuse_link(folder)?,
                // A different holder deleted it at that moment; opening the file shows whether it exists now.
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                Err(error) => return Err(Error::io("create", folder)(error)),
            }
            let opened = OpenOptions::new()
                .read(true)
                .write(true)
                .create(true)
                .truncate(false)
                .custom_flags((OFlags::NOFOLLOW | OFlags::NONBLOCK).bits() as i32)
                .open(&path);
            let mut file = match opened {
                Ok(file) => file,
                // The last holder of any claim removed the folder.
                Err(error) if error.kind() == ErrorKind::NotFound => continue,
                Err(error) => return Err(Error::io("open", &path)(error)),
            };
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    return Ok(Claimed::Theirs(Holder(read_json(&path, "claim").ok())));
                }
                Err(TryLockError::Error(error)) => return Err(Error::io("lock", &path)(error)),
            }
            if !is_named_by(&file, &path) {
                continue;
            }
            refuse_other_content(&mut file, &path)?;
            // From here on the file is ours: it is deleted if it cannot be written.
            let mut claim = Self {
                path,
                file,
                keeps_folder: false,
            };
            claim.write_holder()?;
            return Ok(Claimed::Mine(claim));
        }
        Ok(Claimed::Theirs(Holder(None)))
    }

    /// The claim in a folder that existed before it, and stays when it is released.
    #[must_use]
    pub fn in_existing_folder(mut self) -> Self {
        self.keeps_folder = true;
        self
    }

    fn write_holder(&mut self) -> Result<()> {
        let text = serde_json::to_vec(&Process::this()).unwrap_or_default();
        let Self { path, file, .. } = self;
        file.set_len(0)
            .and_then(|()| file.rewind())
            .and_then(|()| file.write_all(&text))
            .map_err(Error::io("write", path))
    }

    /// Deletes the claims of killed processes in a folder, and no other files there.
    pub(crate) fn tidy_in(folder: &Path) {
        let Ok(left) = fs::read_dir(folder) else {
            return;
        };
        for entry in left.flatten() {
            let name = entry.file_name();
            if let Some(name) = name
                .to_str()
                .filter(|name| file_name::check_id(name).is_ok())
            {
                // Taking and releasing it deletes it.
                let _ = Self::take_in(folder, name);
            }
        }
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        // The file is still locked, so no process can have created a second one of this name. A file that cannot be deleted does no harm:
        // it is not locked.
        let _ = fs::remove_file(&self.path);
        if let Some(folder) = self.path.parent()
            && !self.keeps_folder
        {
            // Succeeds only for the last claim.
            let _ = fs::remove_dir(folder);
        }
    }
}

impl Process {
    fn this() -> Self {
        Self {
            host: rustix::system::uname()
                .nodename()
                .to_string_lossy()
                .into_owned(),
            pid: process::id(),
        }
    }
}

/// Rejects a path that cannot be a claim: taking it would overwrite it, and releasing it would delete it.
fn refuse_other_content(file: &mut File, path: &Path) -> Result<()> {
    let found = file.metadata().map_err(Error::io("read", path))?;
    let mut text = Vec::new();
    let is_small_file = found.is_file() && found.nlink() == 1 && found.len() <= MAX_BYTES;
    // A kill leaves it empty or complete: it is written at once.
    let is_claim = is_small_file
        && (found.len() == 0 || {
            file.take(MAX_BYTES)
                .read_to_end(&mut text)
                .map_err(Error::io("read", path))?;
            serde_json::from_slice::<Process>(&text).is_ok()
        });
    if is_claim {
        Ok(())
    } else {
        Err(Error::corpus(
            path,
            "is not a lock file of dtd, which would name a process; move it away",
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::corpus::Corpus;
    use std::sync::atomic::{AtomicU32, Ordering};
    use std::thread;

    fn corpus() -> (tempfile::TempDir, Corpus) {
        let folder = tempfile::tempdir().unwrap();
        let corpus = Corpus::create(folder.path()).unwrap();
        (folder, corpus)
    }

    #[test]
    fn a_claim_has_one_holder_who_is_named_and_leaves_no_file() {
        let (folder, corpus) = corpus();
        let Claimed::Mine(mine) = Claim::take(&corpus, "0001").unwrap() else {
            panic!("nobody else is there");
        };
        let Claimed::Theirs(holder) = Claim::take(&corpus, "0001").unwrap() else {
            panic!("it is taken");
        };
        assert_eq!(holder, Holder(Some(Process::this())));
        assert!(matches!(
            Claim::take(&corpus, "0002").unwrap(),
            Claimed::Mine(_)
        ));
        drop(mine);
        assert!(!folder.path().join(CLAIMS).exists());
    }

    #[test]
    fn what_a_killed_process_left_is_no_claim_and_is_tidied_away() {
        let (folder, corpus) = corpus();
        let left = folder.path().join(CLAIMS);
        fs::create_dir(&left).unwrap();
        let killed = serde_json::to_string(&Process::this()).unwrap();
        fs::write(left.join("0001"), killed).unwrap();
        fs::write(left.join("0002"), "").unwrap();
        assert!(matches!(
            Claim::take(&corpus, "0001").unwrap(),
            Claimed::Mine(_)
        ));
        Claim::tidy(&corpus);
        assert!(!left.exists());
    }

    #[test]
    fn what_is_no_claim_is_neither_overwritten_nor_tidied_away() {
        let (folder, corpus) = corpus();
        let left = folder.path().join(CLAIMS);
        fs::create_dir(&left).unwrap();
        let plan = folder.path().join("plan.json");
        fs::write(&plan, "{}").unwrap();
        fs::hard_link(&plan, left.join("hard")).unwrap();
        fs::write(left.join("notes.txt"), "").unwrap();
        fs::write(left.join("0001"), "a thesis").unwrap();
        fs::create_dir(left.join("run")).unwrap();
        Claim::tidy(&corpus);
        for name in ["hard", "0001"] {
            let message = Claim::take(&corpus, name).unwrap_err().to_string();
            assert!(
                message.contains(name) && message.contains("move it away"),
                "{message}"
            );
        }
        assert_eq!(fs::read(&plan).unwrap(), b"{}");
        assert_eq!(fs::read(left.join("0001")).unwrap(), b"a thesis");
        assert_eq!(fs::read_dir(&left).unwrap().count(), 4);
    }

    #[test]
    fn many_who_take_and_let_go_at_once_never_hold_the_same_claim() {
        let (_folder, corpus) = corpus();
        let (holders, held) = (AtomicU32::new(0), AtomicU32::new(0));
        thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..300 {
                        if let Claimed::Mine(claim) = Claim::take(&corpus, "0001").unwrap() {
                            assert_eq!(holders.fetch_add(1, Ordering::SeqCst), 0);
                            held.fetch_add(1, Ordering::SeqCst);
                            assert_eq!(holders.fetch_sub(1, Ordering::SeqCst), 1);
                            drop(claim);
                        }
                    }
                });
            }
        });
        assert!(held.load(Ordering::SeqCst) > 0);
    }
}
