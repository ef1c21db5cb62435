//! Run files, read only if they match the seal.

use std::collections::BTreeMap;
use std::path::PathBuf;

use dataset::corpus::seal::sealed::Sealed;
use dataset::corpus::seal::{DONE, MANIFEST};
use dataset::files::json_file::{parse_json, write_unsynced};
use dataset::files::outside_file::{self, FileKind};
use serde::de::DeserializeOwned;

use crate::error::{Error, Result};
use crate::run::folder::RunFolder;
use crate::run::place::unfinished;

/// Limit for run files; the largest are the weights.
const RUN_FILE: FileKind = FileKind::new("file of a run", 4 << 30).unlinked();

/// Sealed run files, in memory.
pub(crate) struct SealedRun {
    root: PathBuf,
    seal: Sealed,
    /// Hash of the settings.
    pub(crate) config_hash: String,
    files: BTreeMap<&'static str, Vec<u8>>,
}

impl SealedRun {
    /// Reads the training's files; rejects files that do not match the seal.
    pub(crate) fn read(folder: &RunFolder) -> Result<Self> {
        let root = folder.root();
        if !folder.path(RunFolder::SUMMARY).is_file() {
            return Err(unfinished(root));
        }
        let seal = match Sealed::read(root) {
            Ok(Some(seal)) => seal,
            Ok(None) => {
                let fault = format!(
                    "has no {DONE}, so nothing says that its files belong together; train again"
                );
                return Err(Error::run(root, fault));
            }
            Err(error) if error.is_bad_content() => {
                let fault = format!("is damaged: {error}; put the right file back, or train again");
                return Err(Error::run(root, fault));
            }
            Err(error) => return Err(error.into()),
        };
        let mut files = BTreeMap::new();
        for name in RunFolder::TRAINED {
            let path = root.join(name);
            let bytes = match outside_file::read(&path, RUN_FILE) {
                Err(error) if error.is_not_found() => {
                    let fault =
                        "is missing, though the training wrote it; put it back, or train again";
                    return Err(Error::run(&path, fault));
                }
                read => read?,
            };
            let hash = blake3::hash(&bytes).to_string();
            if seal.hash_of(name) != Some(&hash) {
                let fault = format!(
                    "is not what the training wrote: its hash differs from {MANIFEST}; put the right file back, or train again"
                );
                return Err(Error::run(&path, fault));
            }
            files.insert(name, bytes);
        }
        Ok(Self {
            root: root.to_owned(),
            config_hash: seal.seal().config_hash.clone(),
            seal,
            files,
        })
    }

    /// BLAKE3 over all files.
    pub(crate) fn blake3(&self) -> String {
        let mut hash = blake3::Hasher::new();
        for (name, bytes) in &self.files {
            hash.update(name.as_bytes());
            hash.update(&(bytes.len() as u64).to_le_bytes());
            hash.update(bytes);
        }
        hash.finalize().to_string()
    }

    /// Writes the files into `folder`.
    pub(crate) fn write(&self, folder: &RunFolder) -> Result<()> {
        for (name, bytes) in &self.files {
            write_unsynced(&folder.root().join(name), bytes)?;
        }
        Ok(())
    }

    /// `name` is in [`RunFolder::TRAINED`].
    pub(crate) fn bytes(&self, name: &'static str) -> &[u8] {
        &self.files[name]
    }

    pub(crate) fn json<T: DeserializeOwned>(
        &self,
        name: &'static str,
        what: &'static str,
    ) -> Result<T> {
        serde_json::from_slice(self.bytes(name)).map_err(|source| {
            Error::Dataset(dataset::Error::Json {
                what,
                path: self.root.join(name),
                source,
            })
        })
    }

    /// Result of an evaluation; `None` if none was sealed. One that was edited is refused: its figures would be taken for measured ones.
    pub(crate) fn result<T: DeserializeOwned>(
        &self,
        name: &'static str,
        what: &'static str,
    ) -> Result<Option<T>> {
        let Some(sealed) = self.seal.hash_of(name) else {
            return Ok(None);
        };
        let path = self.root.join(name);
        let bytes = outside_file::read(&path, RUN_FILE)?;
        if blake3::hash(&bytes).to_string() != sealed {
            let fault = format!(
                "is not what the evaluation wrote: its hash differs from {MANIFEST}; `dtd evaluate` writes it again"
            );
            return Err(self.refused(name, fault));
        }
        Ok(Some(parse_json(&bytes, &path, what)?))
    }

    pub(crate) fn refused(&self, name: &str, fault: impl Into<String>) -> Error {
        Error::run(&self.root.join(name), fault)
    }
}
