//! Folder sizes.

use std::fs;
use std::path::Path;

use crate::error::{Error, Result};

/// Total size of the files below a folder, bytes.
pub fn bytes_below(folder: &Path) -> Result<u64> {
    let mut bytes = 0;
    for entry in fs::read_dir(folder).map_err(Error::io("list", folder))? {
        let entry = entry.map_err(Error::io("list", folder))?;
        let path = entry.path();
        let about = entry.metadata().map_err(Error::io("look at", &path))?;
        bytes += if about.is_dir() {
            bytes_below(&path)?
        } else {
            about.len()
        };
    }
    Ok(bytes)
}
