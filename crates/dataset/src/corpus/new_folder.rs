//! A folder of files that appears as a whole.
//!
//! ```text
//! NAME             complete
//! NAME.partial/
//!   claim          locked by the process that makes it
//!   new/           its files, renamed when all of them are on disk
//! ```
//!
//! If a process is killed or the disk fails, the same command writes them again. An empty folder that is there already, such as `.` or the
//! root of a volume, cannot be renamed over in every place: it is filled, is complete with the last file, and contains the claim meanwhile.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::corpus::PARTIAL_SUFFIX;
use crate::corpus::claim::Claim;
use crate::error::{Error, Result};
use crate::files::json_file::write_atomically;
use crate::files::new_file::{clear_leftovers, sync};
use crate::files::own_path::refuse_link;

const CLAIM: &str = "claim";
const NEW: &str = "new";
/// Writing some models takes seconds.
const PATIENCE: Duration = Duration::from_secs(60);

/// Names and contents.
type Files<'a> = [(&'a str, &'a [u8])];

/// Writes files into a folder that does not exist, is empty, or holds some of these files from an interrupted call. Missing parents are
/// created.
///
/// # Errors
/// The folder contains something else, another folder is in the place of the unfinished one, another process is writing the folder, or
/// the disk fails.
pub fn write(folder: &Path, files: &Files<'_>) -> Result<()> {
    let folder: PathBuf = folder.components().collect();
    if !folder.is_dir() {
        if folder.symlink_metadata().is_ok() {
            return Err(Error::corpus(&folder, "is no folder; name a new one"));
        }
        let mut partial = folder.clone().into_os_string();
        partial.push(PARTIAL_SUFFIX);
        let partial = PathBuf::from(partial);
        refuse_link(&partial)?;
        let _claim = Claim::wait_in(&partial, CLAIM, &folder, PATIENCE)?;
        // Another process may have made it until then.
        if !folder.is_dir() {
            return make(&folder, &partial, files);
        }
    }
    fill(&folder, files)
}

/// Makes the folder in `partial`, which is claimed.
fn make(folder: &Path, partial: &Path, files: &Files<'_>) -> Result<()> {
    let new = partial.join(NEW);
    refuse_strangers(partial, |name| [CLAIM, NEW].contains(&name))?;
    refuse_link(&new)?;
    fs::create_dir_all(&new).map_err(Error::io("create", &new))?;
    clear_leftovers(&new);
    refuse_strangers(&new, |name| files.iter().any(|(own, _)| *own == name))?;
    for (name, content) in files {
        write_atomically(&new.join(name), content)?;
    }
    // Replaces no folder but an empty one.
    fs::rename(&new, folder).map_err(|error| {
        let taken = [ErrorKind::DirectoryNotEmpty, ErrorKind::AlreadyExists];
        if taken.contains(&error.kind()) {
            let _ = fs::remove_dir_all(&new);
            Error::corpus(
                folder,
                "was made by something else meanwhile and is not replaced; name another folder",
            )
        } else {
            Error::io("rename into place", folder)(error)
        }
    })?;
    match folder.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => sync(parent),
        _ => sync(Path::new(".")),
    }
}

/// Writes the files one by one into an existing folder. Other files in it are an error.
fn fill(folder: &Path, files: &Files<'_>) -> Result<()> {
    if is_written(folder, files)? {
        return Ok(());
    }
    let _claim = Claim::wait_in(folder, CLAIM, folder, PATIENCE)?.in_existing_folder();
    clear_leftovers(folder);
    refuse_others(folder, files)?;
    for (name, content) in files {
        write_atomically(&folder.join(name), content)?;
    }
    sync(folder)
}

/// Refuses a folder with anything but some of these files, unchanged, and the claim.
fn refuse_others(folder: &Path, files: &Files<'_>) -> Result<()> {
    for name in names_in(folder)? {
        let own = files.iter().find(|(own, _)| *own == name);
        let is_own = match own {
            Some((_, content)) => has_content(&folder.join(&name), content)?,
            None => name == CLAIM,
        };
        if !is_own {
            return Err(Error::corpus(
                folder,
                format!(
                    "holds {name}, expected a new or an empty folder; remove it, or name another"
                ),
            ));
        }
    }
    Ok(())
}

fn refuse_strangers(partial: &Path, is_own: impl Fn(&str) -> bool) -> Result<()> {
    match names_in(partial)?.into_iter().find(|name| !is_own(name)) {
        Some(name) => Err(Error::corpus(
            &partial.join(name),
            "is where a folder is made, and belongs to something else; move it away",
        )),
        None => Ok(()),
    }
}

fn names_in(folder: &Path) -> Result<Vec<String>> {
    fs::read_dir(folder)
        .and_then(|entries| {
            let name = |entry: fs::DirEntry| entry.file_name().to_string_lossy().into_owned();
            entries.map(|entry| entry.map(name)).collect()
        })
        .map_err(Error::io("list", folder))
}

/// Returns true for a folder with exactly these files, unchanged.
fn is_written(folder: &Path, files: &Files<'_>) -> Result<bool> {
    let has = |(name, content): &(&str, &[u8])| has_content(&folder.join(name), content);
    let mut left = files.len();
    for file in files {
        left -= usize::from(has(file)?);
    }
    Ok(left == 0 && names_in(folder)?.len() == files.len())
}

fn has_content(path: &Path, content: &[u8]) -> Result<bool> {
    match fs::read(path) {
        Ok(found) => Ok(found == content),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(false),
        Err(error) => Err(Error::io("read", path)(error)),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Barrier;
    use std::thread;

    use super::*;
    use crate::files::new_file::failing_sync;

    const FILES: [(&str, &[u8]); 2] = [("a.onnx", b"model"), ("CARD.md", b"card")];
    const OTHERS: [(&str, &[u8]); 2] = [("a.onnx", b"another"), ("CARD.md", b"other")];

    #[test]
    fn a_folder_is_there_as_a_whole_or_not_at_all_and_the_same_call_again_makes_it() {
        for before in 0.. {
            let temporary = tempfile::tempdir().unwrap();
            let folder = temporary.path().join("models");
            let (result, struck) = failing_sync::after(before, || write(&folder, &FILES));
            assert_eq!(result.is_err(), struck, "sync {before}: {result:?}");
            if result.is_err() && folder.exists() {
                assert!(is_written(&folder, &FILES).unwrap(), "sync {before}");
            }
            write(&folder, &FILES).unwrap();
            assert!(is_written(&folder, &FILES).unwrap());
            assert_eq!(fs::read_dir(temporary.path()).unwrap().count(), 1);
            if !struck {
                break;
            }
        }
    }

    #[test]
    fn an_empty_folder_is_filled_and_an_interrupted_call_goes_on() {
        for before in 0.. {
            let temporary = tempfile::tempdir().unwrap();
            let folder = temporary.path().join("models");
            fs::create_dir(&folder).unwrap();
            let (result, struck) = failing_sync::after(before, || write(&folder, &FILES));
            assert_eq!(result.is_err(), struck, "sync {before}: {result:?}");
            write(&folder, &FILES).unwrap();
            assert!(is_written(&folder, &FILES).unwrap());
            assert_eq!(fs::read_dir(temporary.path()).unwrap().count(), 1);
            if !struck {
                break;
            }
        }
    }

    #[test]
    fn of_two_writers_of_different_files_one_makes_the_folder_alone() {
        for round in 0..20 {
            let temporary = tempfile::tempdir().unwrap();
            let folder = temporary.path().join("models");
            if round % 2 == 1 {
                fs::create_dir(&folder).unwrap();
            }
            let start = Barrier::new(2);
            let both = [FILES, OTHERS].map(|files| (files, &folder, &start));
            let made = thread::scope(|scope| {
                let writers = both.map(|(files, folder, start)| {
                    scope.spawn(move || {
                        start.wait();
                        write(folder, &files)
                    })
                });
                writers.map(|writer| writer.join().unwrap())
            });
            assert_ne!(made[0].is_ok(), made[1].is_ok(), "round {round}: {made:?}");
            let whole = if made[0].is_ok() { FILES } else { OTHERS };
            assert!(is_written(&folder, &whole).unwrap(), "round {round}");
            assert_eq!(fs::read_dir(temporary.path()).unwrap().count(), 1);
        }
    }

    #[test]
    fn the_files_of_others_stay() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path().join("models");
        fs::create_dir_all(&folder).unwrap();
        for (name, content) in [("thesis.tex", "work"), ("a.onnx", "another model")] {
            fs::write(folder.join(name), content).unwrap();
            let message = write(&folder, &FILES).unwrap_err().to_string();
            assert!(message.contains(&format!("holds {name}")), "{message}");
            assert_eq!(names_in(&folder).unwrap(), [name]);
            assert_eq!(fs::read(folder.join(name)).unwrap(), content.as_bytes());
            fs::remove_file(folder.join(name)).unwrap();
        }

        let partial = temporary.path().join("other.partial");
        fs::create_dir_all(&partial).unwrap();
        fs::write(partial.join("notes"), "").unwrap();
        let message = write(&temporary.path().join("other"), &FILES)
            .unwrap_err()
            .to_string();
        assert!(
            message.contains("other.partial/notes: is where a folder is made"),
            "{message}"
        );
    }
}
