//! Paths of the corpus's own files. Symbolic links below the corpus may lead outside, to files that a reader or `dtd push` would mistake
//! for the corpus' and a writer would change: they are rejected wherever one could be followed.

use std::fs;
use std::path::{self, Path, PathBuf};

use crate::error::{Error, Result};

/// The path of `name` under `root`, if no part of `name` is a symbolic link. `root` itself is the caller's choice and may be one.
///
/// # Errors
/// Some part is a link.
pub fn own_path(root: &Path, name: impl AsRef<Path>) -> Result<PathBuf> {
    let mut path = root.to_owned();
    for part in name.as_ref().components() {
        path.push(part);
        refuse_link(&path)?;
    }
    Ok(path)
}

/// Rejects a symbolic link. A missing path passes.
///
/// # Errors
/// It is one.
pub fn refuse_link(path: &Path) -> Result<()> {
    let is_link = fs::symlink_metadata(path).is_ok_and(|found| found.is_symlink());
    if is_link {
        Err(Error::corpus(
            path,
            "is a symbolic link; expected a file or folder of the corpus itself, since links may lead out of it; put the real one in \
         its place",
        ))
    } else {
        Ok(())
    }
}

/// A path without links and `..`; if it does not exist, the existing part is resolved.
///
/// # Errors
/// The current folder is unknown.
pub fn resolved(path: &Path) -> Result<PathBuf> {
    let path = path::absolute(path).map_err(Error::io("resolve", path))?;
    let (real, existing) = path
        .ancestors()
        .find_map(|folder| Some((fs::canonicalize(folder).ok()?, folder)))
        .unwrap_or_else(|| (PathBuf::from("/"), Path::new("/")));
    Ok(match path.strip_prefix(existing) {
        Ok(rest) if !rest.as_os_str().is_empty() => real.join(rest),
        _ => real,
    })
}
