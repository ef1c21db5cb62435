//! Files that appear atomically, whatever exists at their path.
//!
//! A file is written next to its destination under an unpredictable name, and only if that name is free; so no planted link redirects the
//! content, and two processes that write the same file never interfere. Renaming it into place replaces a link, never the link's target.
//! Leftovers of killed processes are cleared by the next writer ([`clear_leftovers`]).

use std::collections::hash_map::RandomState;
use std::fs::{self, File, OpenOptions};
use std::hash::{BuildHasher, Hasher};
use std::io::{self, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use rustix::fs::{CWD, RenameFlags, renameat_with};
use rustix::io::Errno;

use crate::error::{Error, Result};

/// Suffix of files that are still being written.
pub(crate) const TEMPORARY_SUFFIX: &str = ".tmp";
/// Hexadecimal digits of the name.
const RANDOM_DIGITS: usize = 16;

/// A file that is being written; deleted unless it is committed.
#[derive(Debug)]
pub struct NewFile {
    path: PathBuf,
    temporary: PathBuf,
    file: File,
    committed: bool,
}

impl NewFile {
    /// Creates the temporary file for `path`, in the same folder.
    ///
    /// # Errors
    /// The folder is missing or not writable, or something other than a file exists at the path: a device would be replaced.
    pub fn create(path: &Path) -> Result<Self> {
        refuse_special(path)?;
        let temporary = temporary_beside(path);
        let file = OpenOptions::new()
            .write(true)
            // Fails if anything exists there, a link included.
            .create_new(true)
            .open(&temporary)
            .map_err(Error::io("create", path))?;
        Ok(Self {
            path: path.to_owned(),
            temporary,
            file,
            committed: false,
        })
    }

    /// The open file.
    pub fn file(&mut self) -> &mut File {
        &mut self.file
    }

    /// The path until it is committed, for checks of the content.
    pub fn temporary(&self) -> &Path {
        &self.temporary
    }

    /// Moves the file into place, durably.
    ///
    /// # Errors
    /// The disk is full, or the destination cannot be written.
    pub fn commit(self) -> Result<()> {
        sync_opened(&self.file).map_err(Error::io("write", &self.path))?;
        let path = self.path.clone();
        self.commit_unsynced()?;
        sync(folder_of(&path))
    }

    /// Moves the file into place, durably, unless anything exists there by then. If the disk fails afterwards, the place is free again.
    ///
    /// # Errors
    /// Something exists at the destination ([`Error::is_taken`]), the disk is full, or the destination cannot be written.
    pub fn commit_new(mut self) -> Result<()> {
        sync_opened(&self.file).map_err(Error::io("write", &self.path))?;
        rename_new(&self.temporary, &self.path)
            .map_err(Error::io("rename into place", &self.path))?;
        self.committed = true;
        sync(folder_of(&self.path)).inspect_err(|_| {
            if is_named_by(&self.file, &self.path) {
                let _ = fs::remove_file(&self.path);
            }
        })
    }

    /// Moves the file into place without syncing, so a power failure may undo it: for folders that are sealed afterwards, which syncs all
    /// their files at once.
    ///
    /// # Errors
    /// The destination cannot be written.
    pub(crate) fn commit_unsynced(mut self) -> Result<()> {
        fs::rename(&self.temporary, &self.path)
            .map_err(Error::io("rename into place", &self.path))?;
        self.committed = true;
        Ok(())
    }
}

impl Write for NewFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Drop for NewFile {
    fn drop(&mut self) {
        if !self.committed {
            let _ = fs::remove_file(&self.temporary);
        }
    }
}

/// Renames a file to a name that must be free.
fn rename_new(from: &Path, to: &Path) -> io::Result<()> {
    match renameat_with(CWD, from, CWD, to, RenameFlags::NOREPLACE) {
        // NFS cannot, but refuses a second name that is taken.
        Err(Errno::INVAL | Errno::NOSYS | Errno::OPNOTSUPP) => match fs::hard_link(from, to) {
            Ok(()) => fs::remove_file(from),
            // File systems over object stores have no hard links either. There, a file that appears at this moment is replaced.
            Err(error) if has_no_links(&error) => match to.symlink_metadata() {
                Ok(_) => Err(io::ErrorKind::AlreadyExists.into()),
                Err(_) => fs::rename(from, to),
            },
            Err(error) => Err(error),
        },
        result => Ok(result?),
    }
}

/// True for the errors of file systems without hard links.
fn has_no_links(error: &io::Error) -> bool {
    let errors = [Errno::PERM, Errno::NOSYS, Errno::OPNOTSUPP, Errno::MLINK];
    Errno::from_io_error(error).is_some_and(|error| errors.contains(&error))
}

/// True if the path names this open file.
pub(crate) fn is_named_by(file: &File, path: &Path) -> bool {
    match (file.metadata(), fs::metadata(path)) {
        (Ok(ours), Ok(named)) => (ours.dev(), ours.ino()) == (named.dev(), named.ino()),
        _ => false,
    }
}

/// Removes leftovers of killed writers in a folder. Call it only if no process writes there.
pub fn clear_leftovers(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else {
        return;
    };
    for entry in entries.flatten() {
        if is_temporary(&entry.file_name().to_string_lossy()) {
            // It does no harm, and the next writer tries again.
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// Waits until a file or folder is on disk, so that it survives a power failure.
///
/// # Errors
/// It does not exist, or the disk fails.
pub fn sync(path: &Path) -> Result<()> {
    File::open(path)
        .and_then(|handle| sync_opened(&handle))
        .map_err(Error::io("sync", path))
}

fn sync_opened(file: &File) -> io::Result<()> {
    #[cfg(test)]
    failing_sync::count()?;
    file.sync_all()
}

/// A disk that fails once, for tests.
#[cfg(test)]
pub(crate) mod failing_sync {
    use std::cell::Cell;
    use std::io;

    thread_local! {
        /// Syncs of this thread until one fails.
        static LEFT: Cell<Option<u32>> = const { Cell::new(None) };
    }

    /// Runs `work` while the sync after `before` others fails. Returns its result, and whether that sync was reached.
    pub(crate) fn after<T>(before: u32, work: impl FnOnce() -> T) -> (T, bool) {
        LEFT.set(Some(before));
        let result = work();
        (result, LEFT.take().is_none())
    }

    pub(super) fn count() -> io::Result<()> {
        match LEFT.take() {
            None => Ok(()),
            Some(0) => Err(io::Error::other("injected: the disk failed")),
            Some(left) => {
                LEFT.set(Some(left - 1));
                Ok(())
            }
        }
    }
}

fn refuse_special(path: &Path) -> Result<()> {
    match fs::symlink_metadata(path) {
        Ok(found) if !found.is_file() && !found.is_symlink() => Err(Error::corpus(
            path,
            "is not a file and would be replaced; expected a file or nothing",
        )),
        _ => Ok(()),
    }
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// `.<name>.<random digits>.tmp`.
fn temporary_beside(path: &Path) -> PathBuf {
    let mut name = std::ffi::OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    // Its keys come from the operating system's random number generator.
    let random = RandomState::new().build_hasher().finish();
    name.push(format!(".{random:0RANDOM_DIGITS$x}{TEMPORARY_SUFFIX}"));
    path.with_file_name(name)
}

/// True for names of temporary files, which are written before they are renamed.
pub(crate) fn is_temporary(name: &str) -> bool {
    let random = || {
        name.strip_prefix('.')?
            .strip_suffix(TEMPORARY_SUFFIX)?
            .rsplit_once('.')
    };
    random().is_some_and(|(_, random)| {
        random.len() == RANDOM_DIGITS && random.bytes().all(|digit| digit.is_ascii_hexdigit())
    })
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn a_file_that_is_not_committed_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("plan.json");
        let mut file = NewFile::create(&path).unwrap();
        file.write_all(b"half").unwrap();
        assert_eq!(names(folder.path()).len(), 1);
        drop(file);
        assert_eq!(names(folder.path()), Vec::<String>::new());
    }

    #[test]
    fn a_link_in_the_place_of_a_file_is_replaced_and_its_target_untouched() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("target");
        fs::write(&target, "precious").unwrap();
        let path = folder.path().join("plan.json");
        symlink(&target, &path).unwrap();
        let mut file = NewFile::create(&path).unwrap();
        file.write_all(b"plan").unwrap();
        file.commit().unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"plan");
        assert_eq!(fs::read(&target).unwrap(), b"precious");
    }

    #[test]
    fn a_new_file_replaces_no_file_that_appeared_meanwhile() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.parquet");
        let [mut first, mut second] = [(); 2].map(|()| NewFile::create(&path).unwrap());
        first.write_all(b"first").unwrap();
        second.write_all(b"second").unwrap();
        second.commit_new().unwrap();
        assert!(first.commit_new().unwrap_err().is_taken());
        assert_eq!(fs::read(&path).unwrap(), b"second");
        assert_eq!(names(folder.path()), ["p.parquet"]);
    }

    #[test]
    fn a_new_file_whose_disk_fails_leaves_its_place_free_and_the_files_of_others() {
        for before in 0..2 {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("p.parquet");
            let file = NewFile::create(&path).unwrap();
            let (result, struck) = failing_sync::after(before, || file.commit_new());
            assert!(struck && result.is_err(), "sync {before}");
            assert_eq!(names(folder.path()), Vec::<String>::new(), "sync {before}");
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.parquet");
        let file = NewFile::create(&path).unwrap();
        fs::write(&path, "a person's").unwrap();
        let (result, _) = failing_sync::after(0, || file.commit_new());
        assert!(result.is_err());
        assert_eq!(names(folder.path()), ["p.parquet"]);
    }

    #[test]
    fn what_is_no_file_is_not_replaced() {
        let message = NewFile::create(Path::new("/dev/null"))
            .unwrap_err()
            .to_string();
        assert!(message.contains("/dev/null: is not a file"), "{message}");
    }

    #[test]
    fn only_what_a_killed_writer_left_is_cleared() {
        let folder = tempfile::tempdir().unwrap();
        let left = NewFile::create(&folder.path().join("plan.json")).unwrap();
        std::mem::forget(left);
        for name in ["notes.tmp", ".notes.tmp", "plan.json.new"] {
            fs::write(folder.path().join(name), "a person's").unwrap();
        }
        clear_leftovers(folder.path());
        assert_eq!(
            names(folder.path()),
            [".notes.tmp", "notes.tmp", "plan.json.new"]
        );
    }
}
