//! Folders that appear or are replaced as a whole.
//!
//! ```text
//! NAME             the finished folder
//! NAME.partial/    its workshop, on the same file system
//!   claim          locked by the process that works on NAME
//!   new/           the folder in the making, renamed to NAME when complete on disk
//!   ..             further files of the maker, e.g. a checkpoint
//! ```
//!
//! A killed process leaves its workshop to the next one, which resumes or drops the work found there. A workshop with foreign entries is
//! rejected, and left as it is; what lies in `new/` is the maker's.

pub mod new_folder;

use std::fs;
use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::corpus::claim::Claim;
use crate::corpus::{PARTIAL_SUFFIX, own_folder_around};
use crate::error::{Error, Result};
use crate::files::folder;
use crate::files::new_file::{clear_leftovers, is_temporary, sync};
use crate::files::outside_file::name_of;
use crate::files::own_path::resolved;
use crate::plain::shown;

/// Name of the file that locks a folder.
pub const CLAIM: &str = "claim";
/// Name of the folder in the making.
pub const NEW: &str = "new";
/// Errors of renaming to a place where something has appeared.
const TAKEN: [ErrorKind; 3] = [
    ErrorKind::DirectoryNotEmpty,
    ErrorKind::AlreadyExists,
    ErrorKind::NotADirectory,
];
/// Maximum number of foreign files that an error names.
const MAX_NAMED: usize = 20;

/// A place's workshop, locked until this is dropped, and then removed if it is empty.
#[derive(Debug)]
pub struct Workshop {
    place: PathBuf,
    folder: PathBuf,
    _claim: Claim,
}

impl Workshop {
    /// Path of the place's workshop.
    pub fn beside(place: &Path) -> PathBuf {
        let mut name = place.file_name().unwrap_or_default().to_owned();
        name.push(PARTIAL_SUFFIX);
        place.with_file_name(name)
    }

    /// Locks the workshop of the [`resolve`]d place; waits up to `patience` for other processes. Missing folders are created. `own` names
    /// the maker's entries besides [`NEW`].
    ///
    /// # Errors
    /// A different process works there ([`Error::Held`]), the place is a mount point, or the workshop has foreign entries.
    pub fn enter(place: &Path, own: &[&str], patience: Duration) -> Result<Self> {
        refuse_mount_point(place)?;
        let folder = Self::beside(place);
        refuse_other_than_folder(&folder)?;
        let own = [&[CLAIM, NEW][..], own].concat();
        // Before anything is written there, and again, since it may have changed until it is locked.
        refuse_foreign(&folder, &own)?;
        let claim = lock(&folder, place, patience)?;
        tidy(&folder, &own)?;
        Ok(Self {
            place: place.to_owned(),
            folder,
            _claim: claim,
        })
    }

    /// The place that the new folder is for.
    pub fn place(&self) -> &Path {
        &self.place
    }

    /// Path of the workshop's entry.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Removes temporary files of killed processes from a folder of the workshop, and rejects entries with other names than these.
    pub fn tidy(&self, folder: &str, own: &[&str]) -> Result<()> {
        tidy(&self.path(folder), own)
    }

    /// Removes an entry of the workshop with all its content; it may be missing.
    pub fn remove(&self, name: &str) -> Result<()> {
        let path = self.path(name);
        let removed = if path.is_dir() {
            fs::remove_dir_all(&path)
        } else {
            fs::remove_file(&path)
        };
        missing_is_fine(removed).map_err(Error::io("remove", &path))
    }

    /// Removes these files in this order from a folder of the workshop, and then the folder. All may be missing.
    ///
    /// # Errors
    /// Other files are in the folder, or the disk fails.
    pub fn remove_files(&self, folder: &str, names: &[&str]) -> Result<()> {
        let folder = self.path(folder);
        for path in names.iter().map(|name| folder.join(name)) {
            missing_is_fine(fs::remove_file(&path)).map_err(Error::io("remove", &path))?;
        }
        missing_is_fine(fs::remove_dir(&folder)).map_err(Error::io("remove", &folder))
    }

    /// Moves the new folder, whose files are synced, into its vacant place.
    ///
    /// # Errors
    /// Something else is there by now ([`Error::Taken`]), or the disk fails.
    pub fn put_in_place(&self) -> Result<()> {
        // Not every file system renames over an empty folder.
        missing_is_fine(fs::remove_dir(&self.place))
            .map_err(Error::io("replace", &self.place))
            .and_then(|()| rename(&self.path(NEW), &self.place))
            .map_err(|error| match error {
                Error::Io { source, .. } if TAKEN.contains(&source.kind()) => {
                    let path = self.place.clone();
                    Error::Taken { path }
                }
                error => error,
            })
    }
}

/// Renames a folder durably.
pub fn rename(from: &Path, to: &Path) -> Result<()> {
    fs::rename(from, to).map_err(Error::io("rename into place", to))?;
    sync(parent_of(from))?;
    sync(parent_of(to))
}

/// Locks a folder for work on `place`; waits up to `patience` for other processes. The folder is created, and removed with the lock if it
/// is empty.
///
/// # Errors
/// A different process has the lock ([`Error::Held`]), or the folder cannot be made.
pub fn lock(folder: &Path, place: &Path, patience: Duration) -> Result<Claim> {
    match Claim::wait_in(folder, CLAIM, place, patience) {
        Err(error) if error.is_of_disk() => Err(error),
        Err(Error::Io { source, .. }) => Err(Error::corpus(
            place,
            format!("cannot be made there: {source}; name another folder"),
        )),
        locked => locked,
    }
}

/// Absolute path for a folder to be made, with links resolved: a link to a folder is as good as the folder.
///
/// # Errors
/// Something else than a folder is there, it has no name, or it is reserved for corpus files.
pub fn resolve(path: &Path) -> Result<PathBuf> {
    // A slash at the end would follow a link, and put the workshop into the folder.
    let path: PathBuf = path.components().collect();
    // A link to a folder that is just being replaced is dangling for a moment.
    let named = match fs::read_link(&path) {
        Ok(to) if !path.exists() => path.with_file_name("").join(to),
        _ => path,
    };
    let real = resolved(&named)?;
    refuse_other_than_folder(&real)?;
    if real.file_name().is_none() {
        let fault = "is the root folder; name a new folder in it";
        return Err(Error::corpus(&real, fault));
    }
    match own_folder_around(&real) {
        Some(own) => Err(reserved(&real, own)),
        None => Ok(real),
    }
}

/// The error for a place among the files of a corpus.
pub fn reserved(place: &Path, own: &Path) -> Error {
    let own = shown(own);
    Error::corpus(
        place,
        format!("lies in {own}, which is reserved for files of the corpus; name a folder outside"),
    )
}

/// True if a folder does not exist or is empty.
pub fn is_vacant(folder: &Path) -> bool {
    match fs::read_dir(folder) {
        Ok(mut entries) => entries.next().is_none(),
        Err(error) => error.kind() == ErrorKind::NotFound,
    }
}

/// Rejects a folder with anything but entries of the maker's, which may be missing; links are foreign. `what` begins the message: "is not
/// a run:".
pub fn refuse_strangers(folder: &Path, what: &str, is_own: impl Fn(&str) -> bool) -> Result<()> {
    refuse_other_than_folder(folder)?;
    let entries = match folder::entries(folder) {
        // What cannot be made there is reported by who makes it.
        Err(Error::Io { source, .. })
            if matches!(
                source.kind(),
                ErrorKind::NotFound | ErrorKind::NotADirectory
            ) =>
        {
            return Ok(());
        }
        entries => entries?,
    };
    let mut strangers = Vec::new();
    for entry in entries {
        let name = entry.file_name().to_string_lossy().into_owned();
        if entry.file_type().is_ok_and(|kind| kind.is_symlink()) || !is_own(&name) {
            strangers.push(name);
        }
    }
    refuse_named(folder, what, strangers)
}

/// Rejects foreign entries that the maker has found itself.
pub(crate) fn refuse_named(folder: &Path, what: &str, mut names: Vec<String>) -> Result<()> {
    if names.is_empty() {
        return Ok(());
    }
    names.sort();
    if let Some(more) = names.len().checked_sub(MAX_NAMED).filter(|more| *more > 0) {
        names.truncate(MAX_NAMED);
        names.push(format!("and {more} more"));
    }
    let names = names.join(", ");
    Err(Error::corpus(
        folder,
        format!("{what} it holds {names}; move that away, or choose another place"),
    ))
}

/// Temporary files that a killed process left are no foreign entries.
fn refuse_foreign(folder: &Path, own: &[&str]) -> Result<()> {
    let what = "is where a folder is made, but";
    refuse_strangers(folder, what, |name| {
        own.contains(&name) || is_temporary(name)
    })
}

fn tidy(folder: &Path, own: &[&str]) -> Result<()> {
    refuse_foreign(folder, own)?;
    clear_leftovers(folder);
    Ok(())
}

/// A path that cannot be read is reported where the folder is made.
fn refuse_other_than_folder(path: &Path) -> Result<()> {
    match fs::symlink_metadata(path) {
        Ok(found) if !found.is_dir() => {
            let found = name_of(found.file_type());
            Err(Error::corpus(
                path,
                format!("is {found}, not a folder; expected a folder, or the name of a new one"),
            ))
        }
        _ => Ok(()),
    }
}

fn refuse_mount_point(place: &Path) -> Result<()> {
    let (found, parent) = (fs::metadata(place), fs::metadata(parent_of(place)));
    match (found, parent) {
        (Ok(found), Ok(parent)) if found.dev() != parent.dev() => Err(Error::corpus(
            place,
            "is the top of a file system, which cannot be replaced as a whole; name a folder in it",
        )),
        _ => Ok(()),
    }
}

fn missing_is_fine(removed: std::io::Result<()>) -> std::io::Result<()> {
    match removed {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
        removed => removed,
    }
}

fn parent_of(place: &Path) -> &Path {
    place.parent().unwrap_or(place)
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    fn assert_refused<T>(result: Result<T>, words: &str) {
        let message = result.err().unwrap().to_string();
        assert!(message.contains(words), "{message}");
    }

    #[test]
    fn a_new_folder_takes_a_vacant_place_and_no_other() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["missing", "empty", "taken", "file"] {
            let place = resolve(&folder.path().join(name)).unwrap();
            let workshop = Workshop::enter(&place, &[], Duration::ZERO).unwrap();
            fs::create_dir(workshop.path(NEW)).unwrap();
            fs::write(workshop.path(NEW).join("a"), "").unwrap();
            match name {
                "missing" => {}
                "file" => fs::write(&place, "a user's").unwrap(),
                _ => fs::create_dir(&place).unwrap(),
            }
            if name == "taken" {
                fs::write(place.join("thesis.tex"), "a user's").unwrap();
            }
            let moved = workshop.put_in_place();
            if ["missing", "empty"].contains(&name) {
                moved.unwrap();
                assert!(place.join("a").is_file() && !workshop.path(NEW).exists());
            } else {
                assert!(matches!(moved, Err(Error::Taken { .. })), "{name}");
                workshop.remove_files(NEW, &["a"]).unwrap();
            }
            drop(workshop);
            assert!(!Workshop::beside(&place).exists(), "{name}");
        }
        assert!(folder.path().join("taken/thesis.tex").exists());
        assert!(folder.path().join("file").is_file());
    }

    #[test]
    fn a_workshop_has_one_holder_and_is_neither_a_link_nor_a_mount_point() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("place");
        let enter = || Workshop::enter(&place, &[], Duration::ZERO);
        let held = enter().unwrap();
        assert_refused(enter(), "is in use by process ");
        drop(held);
        symlink(folder.path(), Workshop::beside(&place)).unwrap();
        assert_refused(enter(), "is a symbolic link, not a folder");
        let top = Workshop::enter(Path::new("/proc"), &[], Duration::ZERO);
        assert_refused(top, "is the top of a file system");
    }

    #[test]
    fn a_link_to_a_folder_that_is_missing_for_a_moment_leads_to_its_place() {
        let folder = tempfile::tempdir().unwrap();
        let root = fs::canonicalize(folder.path()).unwrap();
        symlink("place", root.join("link")).unwrap();
        assert_eq!(resolve(&root.join("link/")).unwrap(), root.join("place"));
        assert_refused(resolve(Path::new("/")), "is the root folder");
    }
}
