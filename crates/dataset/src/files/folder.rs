//! Entries, names and size of a folder.

use std::fs::{self, DirEntry};
use std::path::Path;

use crate::error::{Error, Result};

/// Entries of a folder, in no order.
pub fn entries(folder: &Path) -> Result<Vec<DirEntry>> {
    fs::read_dir(folder)
        .and_then(Iterator::collect)
        .map_err(Error::io("list", folder))
}

/// Names of the entries of a folder. A name that is not UTF-8 is shown with replacement characters.
pub fn names(folder: &Path) -> Result<Vec<String>> {
    let entries = entries(folder)?.into_iter();
    Ok(entries
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect())
}

/// Total size of the files below a folder, bytes.
pub fn bytes_below(folder: &Path) -> Result<u64> {
    let mut bytes = 0;
    for entry in entries(folder)? {
        let about = entry
            .metadata()
            .map_err(Error::io("look at", &entry.path()))?;
        bytes += if about.is_dir() {
            bytes_below(&entry.path())?
        } else {
            about.len()
        };
    }
    Ok(bytes)
}
