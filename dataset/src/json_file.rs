//! JSON files, read with their name in every message and written so that a kill never leaves half of one.

use std::fs::{self, File};
use std::io::Write;
use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error::{Error, Result};

/// Reads a JSON file; `what` names its content in messages.
pub fn read_json<T: DeserializeOwned>(path: &Path, what: &'static str) -> Result<T> {
    let text = fs::read(path).map_err(Error::io("read", path))?;
    serde_json::from_slice(&text).map_err(|source| Error::Json {
        what,
        path: path.to_owned(),
        source,
    })
}

/// Writes a value as indented JSON with a final newline, atomically.
pub fn write_json<T: Serialize + ?Sized>(path: &Path, value: &T) -> Result<()> {
    let mut text = serde_json::to_vec_pretty(value).map_err(|source| Error::Json {
        what: "value to write",
        path: path.to_owned(),
        source,
    })?;
    text.push(b'\n');
    write_atomically(path, &text)
}

/// Writes a file beside its place, syncs it and renames it, so that readers see the old content or the new, never a part.
pub fn write_atomically(path: &Path, content: &[u8]) -> Result<()> {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".tmp");
    let beside = path.with_file_name(name);
    let mut file = File::create(&beside).map_err(Error::io("create", &beside))?;
    file.write_all(content)
        .and_then(|()| file.sync_all())
        .map_err(Error::io("write", &beside))?;
    fs::rename(&beside, path).map_err(Error::io("rename into place", path))?;
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => sync(folder),
        _ => sync(Path::new(".")),
    }
}

/// Waits until a file or folder is on the disk: what follows may rely on it even if the power fails.
pub fn sync(path: &Path) -> Result<()> {
    File::open(path)
        .and_then(|handle| handle.sync_all())
        .map_err(Error::io("sync", path))
}
