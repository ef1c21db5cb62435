//! A folder of files that appears as a whole.
//!
//! It is made in its workshop. If a process is killed or the disk fails, the same command writes the files again. An empty folder that is
//! there already, such as `.` or a volume's root, cannot be replaced in every place: it is filled, is complete with the last file, and
//! contains the claim meanwhile.

use std::fs;
use std::io::ErrorKind;
use std::path::Path;
use std::time::Duration;

use crate::corpus::workshop::{CLAIM, NEW, Workshop, lock, refuse_named, resolve};
use crate::error::{Error, Result};
use crate::files::folder;
use crate::files::json_file::write_atomically;
use crate::files::new_file::{clear_leftovers, sync};

/// Writing some models takes seconds.
const PATIENCE: Duration = Duration::from_secs(60);

/// Names and contents.
type Files<'a> = [(&'a str, &'a [u8])];

/// Writes files into a folder that does not exist, is empty, or holds some files from an interrupted call. Missing parents are created.
///
/// # Errors
/// The folder or its workshop contains something else, a different process is writing the folder, or the disk fails.
pub fn write(folder: &Path, files: &Files<'_>) -> Result<()> {
    let folder = resolve(folder)?;
    if !folder.is_dir() {
        let workshop = Workshop::enter(&folder, &[], PATIENCE)?;
        // A different process may have made it by then.
        if !folder.is_dir() {
            return make(&workshop, files);
        }
    }
    fill(&folder, files)
}

fn make(workshop: &Workshop, files: &Files<'_>) -> Result<()> {
    let new = workshop.path(NEW);
    fs::create_dir_all(&new).map_err(Error::io("create", &new))?;
    let names: Vec<&str> = files.iter().map(|(name, _)| *name).collect();
    workshop.tidy(NEW, &names)?;
    for (name, content) in files {
        write_atomically(&new.join(name), content)?;
    }
    workshop.put_in_place().inspect_err(|error| {
        if matches!(error, Error::Taken { .. }) {
            // If that fails as well, the first error is still the one to report.
            let _ = workshop.remove(NEW);
        }
    })
}

/// Writes the files one by one into an existing folder. Other files in it are an error.
fn fill(folder: &Path, files: &Files<'_>) -> Result<()> {
    if is_written(folder, files)? {
        return Ok(());
    }
    let _claim = lock(folder, folder, PATIENCE)?.in_existing_folder();
    clear_leftovers(folder);
    let mut others = Vec::new();
    for name in folder::names(folder)? {
        let is_own = match files.iter().find(|(own, _)| *own == name) {
            Some((_, content)) => has_content(&folder.join(&name), content)?,
            None => name == CLAIM,
        };
        if !is_own {
            others.push(name);
        }
    }
    refuse_named(folder, "expected a new or an empty folder, but", others)?;
    for (name, content) in files {
        write_atomically(&folder.join(name), content)?;
    }
    sync(folder)
}

/// Returns true for a folder with exactly these files, unchanged.
fn is_written(folder: &Path, files: &Files<'_>) -> Result<bool> {
    let has = |(name, content): &(&str, &[u8])| has_content(&folder.join(name), content);
    let mut left = files.len();
    for file in files {
        left -= usize::from(has(file)?);
    }
    Ok(left == 0 && folder::names(folder)?.len() == files.len())
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

    /// Writes the files again after each sync that can fail. `was_there`: an empty folder is filled.
    fn interrupted_calls_go_on(was_there: bool) {
        for before in 0.. {
            let temporary = tempfile::tempdir().unwrap();
            let folder = temporary.path().join("models");
            if was_there {
                fs::create_dir(&folder).unwrap();
            }
            let (result, struck) = failing_sync::after(before, || write(&folder, &FILES));
            assert_eq!(result.is_err(), struck, "sync {before}: {result:?}");
            if result.is_err() && !was_there && folder.exists() {
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
    fn a_folder_is_there_as_a_whole_or_not_at_all_and_the_same_call_again_makes_it() {
        interrupted_calls_go_on(false);
    }

    #[test]
    fn an_empty_folder_is_filled_and_an_interrupted_call_goes_on() {
        interrupted_calls_go_on(true);
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
            assert_eq!(folder::names(&folder).unwrap(), [name]);
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
            message.contains("other.partial: is where a folder is made, but it holds notes"),
            "{message}"
        );
    }
}
