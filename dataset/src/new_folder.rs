//! A folder of files that appears as a whole.
//!
//! The files are written into `<name>.partial` beside it, which is renamed when all of them are on disk. If a process is killed or the
//! disk fails, the same command writes them again. An empty folder that is there already, such as `.` or the root of a volume, cannot be
//! renamed over in every place: it is filled, and is complete with the last file.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use crate::corpus::PARTIAL_SUFFIX;
use crate::error::{Error, Result};
use crate::json_file::write_atomically;
use crate::new_file::{clear_leftovers, sync};
use crate::own_path::refuse_link;

/// Writes files into a folder that does not exist or is empty. Missing parents are created.
///
/// # Errors
/// The folder contains something, another folder is in the place of the unfinished one, or the disk fails.
pub fn write<'a>(
    folder: &Path,
    files: impl IntoIterator<Item = (&'a str, &'a [u8])>,
) -> Result<()> {
    let folder: PathBuf = folder.components().collect();
    if folder.is_dir() {
        return fill(&folder, files);
    }
    let mut partial = folder.clone().into_os_string();
    partial.push(PARTIAL_SUFFIX);
    let partial = PathBuf::from(partial);
    let files: Vec<_> = files.into_iter().collect();
    refuse_link(&partial)?;
    fs::create_dir_all(&partial).map_err(Error::io("create", &partial))?;
    clear_leftovers(&partial);
    refuse_strangers(&partial, &files)?;
    for (name, content) in files {
        write_atomically(&partial.join(name), content)?;
    }
    fs::rename(&partial, &folder).map_err(Error::io("rename into place", &folder))?;
    match folder.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => sync(parent),
        _ => sync(Path::new(".")),
    }
}

/// Writes the files one by one into an existing folder. Other files in it are an error.
fn fill<'a>(folder: &Path, files: impl IntoIterator<Item = (&'a str, &'a [u8])>) -> Result<()> {
    let files: Vec<_> = files.into_iter().collect();
    clear_leftovers(folder);
    refuse_strangers(folder, &files)?;
    for (name, content) in files {
        write_atomically(&folder.join(name), content)?;
    }
    sync(folder)
}

fn refuse_strangers(partial: &Path, files: &[(&str, &[u8])]) -> Result<()> {
    for entry in fs::read_dir(partial).map_err(Error::io("list", partial))? {
        let name = entry.map_err(Error::io("list", partial))?.file_name();
        if !files.iter().any(|(own, _)| name == *own) {
            return Err(Error::corpus(
                &partial.join(name),
                "is where a folder is made, and belongs to something else; move it away",
            ));
        }
    }
    Ok(())
}

/// Returns true for a folder that an interrupted [`write()`] has filled in part: it contains some of these files, unchanged, and no others.
///
/// # Errors
/// It cannot be read.
pub fn is_begun<'a>(
    folder: &Path,
    files: impl IntoIterator<Item = (&'a str, &'a [u8])>,
) -> Result<bool> {
    let present = files
        .into_iter()
        .filter(|(name, _)| folder.join(name).exists());
    is_written(folder, present)
}

/// Returns true for a folder with exactly these files, unchanged.
///
/// # Errors
/// It cannot be read.
pub fn is_written<'a>(
    folder: &Path,
    files: impl IntoIterator<Item = (&'a str, &'a [u8])>,
) -> Result<bool> {
    let mut left = match fs::read_dir(folder) {
        Ok(entries) => entries.count(),
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(false),
        Err(error) => return Err(Error::io("list", folder)(error)),
    };
    for (name, content) in files {
        match fs::read(folder.join(name)) {
            Ok(found) if found == content => left -= 1,
            Ok(_) => return Ok(false),
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(false),
            Err(error) => return Err(Error::io("read", &folder.join(name))(error)),
        }
    }
    Ok(left == 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::new_file::failing_sync;

    const FILES: [(&str, &[u8]); 2] = [("a.onnx", b"model"), ("CARD.md", b"card")];

    #[test]
    fn a_folder_is_there_as_a_whole_or_not_at_all_and_the_same_call_again_makes_it() {
        for before in 0.. {
            let temporary = tempfile::tempdir().unwrap();
            let folder = temporary.path().join("models");
            let (result, struck) = failing_sync::after(before, || write(&folder, FILES));
            assert_eq!(result.is_err(), struck, "sync {before}: {result:?}");
            if !is_written(&folder, FILES).unwrap() {
                assert!(!folder.exists(), "sync {before}: half a folder");
                write(&folder, FILES).unwrap();
            }
            assert!(is_written(&folder, FILES).unwrap());
            assert_eq!(fs::read_dir(temporary.path()).unwrap().count(), 1);
            if !struck {
                break;
            }
        }
    }

    #[test]
    fn an_empty_folder_is_filled_and_an_interrupted_call_goes_on() {
        for before in 0.. {
            let folder = tempfile::tempdir().unwrap();
            let (result, struck) = failing_sync::after(before, || write(folder.path(), FILES));
            assert_eq!(result.is_err(), struck, "sync {before}: {result:?}");
            assert!(is_begun(folder.path(), FILES).unwrap(), "sync {before}");
            write(folder.path(), FILES).unwrap();
            assert!(is_written(folder.path(), FILES).unwrap());
            if !struck {
                break;
            }
        }
        let other = tempfile::tempdir().unwrap();
        fs::write(other.path().join("a.onnx"), "another model").unwrap();
        assert!(!is_begun(other.path(), FILES).unwrap());
    }

    #[test]
    fn the_files_of_others_stay() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path().join("models");
        fs::create_dir_all(&folder).unwrap();
        fs::write(folder.join("thesis.tex"), "work").unwrap();
        assert!(write(&folder, FILES).is_err());
        assert!(!is_written(&folder, FILES).unwrap());
        assert_eq!(fs::read(folder.join("thesis.tex")).unwrap(), b"work");

        let partial = temporary.path().join("other.partial");
        fs::create_dir_all(&partial).unwrap();
        fs::write(partial.join("notes"), "").unwrap();
        let message = write(&temporary.path().join("other"), FILES)
            .unwrap_err()
            .to_string();
        assert!(
            message.contains("other.partial/notes: is where a folder is made"),
            "{message}"
        );
    }
}
