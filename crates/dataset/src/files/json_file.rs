//! JSON files, with their name in every error message, written atomically.

use std::io::Write;
use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error::{Error, Result};
use crate::files::new_file::NewFile;
use crate::files::outside_file::{self, FileKind};

/// Reads a JSON file; `what` names its content in messages.
pub fn read_json<T: DeserializeOwned>(path: &Path, what: &'static str) -> Result<T> {
    let text = outside_file::read(path, FileKind::json(what))?;
    parse_json(&text, path, what)
}

/// Reads JSON content; messages name it as `path` and its content as `what`.
pub fn parse_json<T: DeserializeOwned>(text: &[u8], path: &Path, what: &'static str) -> Result<T> {
    if text.iter().all(u8::is_ascii_whitespace) {
        return Err(Error::corpus(path, format!("is empty, expected a {what}")));
    }
    serde_json::from_slice(text).map_err(|source| Error::Json {
        what,
        path: path.to_owned(),
        source,
    })
}

/// Writes a value as indented JSON with a final newline, atomically.
pub fn write_json<T: Serialize + ?Sized>(path: &Path, value: &T) -> Result<()> {
    write_atomically(path, &json_bytes(value, path)?)
}

/// Writes a value like [`write_json`], as [`write_unsynced`] writes a file.
pub fn write_json_unsynced<T: Serialize + ?Sized>(path: &Path, value: &T) -> Result<()> {
    write_unsynced(path, &json_bytes(value, path)?)
}

/// A value as [`write_json`] writes it; messages name its file as `path`.
pub fn json_bytes<T: Serialize + ?Sized>(value: &T, path: &Path) -> Result<Vec<u8>> {
    let mut text = serde_json::to_vec_pretty(value).map_err(|source| Error::Json {
        what: "value to write",
        path: path.to_owned(),
        source,
    })?;
    text.push(b'\n');
    Ok(text)
}

/// Writes a file so that readers see either the old content or the new.
pub fn write_atomically(path: &Path, content: &[u8]) -> Result<()> {
    let mut file = NewFile::create(path)?;
    file.write_all(content).map_err(Error::io("write", path))?;
    file.commit()
}

/// Writes a file into a folder that is sealed afterwards ([`crate::corpus::seal::seal_folder`] makes it durable).
pub fn write_unsynced(path: &Path, content: &[u8]) -> Result<()> {
    let mut file = NewFile::create(path)?;
    file.write_all(content).map_err(Error::io("write", path))?;
    file.commit_unsynced()
}
