//! Uploads one scenario from its folder: all files first, `MANIFEST.b3`, then `DONE.json`.
//!
//! An interrupted upload resumes when it is repeated: files that exist with the right size and hash are not sent. A large file is
//! sent in parts, which become visible only with the last one.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;
use std::time::SystemTime;

use dataset::corpus::ScenarioFolder;
use dataset::json_file::json_bytes;
use dataset::outside_file::{self, FileKind};
use dataset::seal::{self, DONE, MANIFEST, Seal, SealedFile};
use dataset::sealed::Sealed;
use futures_util::future::BoxFuture;
use object_store::{PutMultipartOptions, PutOptions, WriteMultipart};
use tokio::task::spawn_blocking;

use crate::corpus_store::{CorpusStore, ObjectInfo, scenario_file};
use crate::error::{Result, StoreError};
use crate::patience::Watch;

/// A file up to this size is one request, a larger one is sent in parts of this size. All stores accept parts of 5 MiB and more.
const PART_BYTES: u64 = 8 << 20;
/// Parts of one file in parallel: limits memory, and is enough to fill a link with some latency.
const PARTS_AT_ONCE: usize = 4;
/// No store accepts more than 10 000 parts: parts of larger files are larger.
const MOST_PARTS: u64 = 9_000;
/// How often a file of the folder may be renamed to its final name just before it is opened.
const ROUNDS: u32 = 3;

/// What to do if the store has the scenario with other content.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OnOther {
    /// Leave it: it was there first.
    Keep,
    /// Replace it if ours is newer. In the meantime the scenario is not committed.
    ReplaceOlder,
}

/// The result for a scenario.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pushed {
    /// It is committed now.
    Committed {
        /// Files that were sent.
        sent: usize,
        /// Files that existed already.
        there: usize,
        /// Whether there was other content before.
        replaced: bool,
    },
    /// It was committed already, with this content.
    Same,
    /// It was committed already, with another content, and was left alone.
    Other,
    /// The same, because that content is newer than ours.
    Newer,
    /// The same, because that content has labels and ours has none, however new it is: copying a folder makes it new.
    Labelled,
}

impl CorpusStore {
    /// Uploads a sealed scenario and commits it.
    ///
    /// # Errors
    /// The folder does not match its seal, the scenario in the store has other parameters, or the store fails; then the same call
    /// resumes.
    pub fn push_scenario<'a>(
        &'a self,
        folder: &'a ScenarioFolder,
        on_other: OnOther,
        watch: &'a dyn Watch,
    ) -> BoxFuture<'a, Result<Pushed>> {
        Box::pin(async move {
            let mut rounds_left = ROUNDS;
            loop {
                let damaged = |message: String| StoreError::Damaged {
                    place: folder.root().display().to_string(),
                    message,
                };
                let sealed = match Sealed::read(folder.root()) {
                    Ok(Some(sealed)) => sealed,
                    Ok(None) => {
                        return Err(damaged(format!("has no {DONE}: it was never finished")));
                    }
                    Err(error) if error.is_bad_content() => return Err(damaged(error.to_string())),
                    Err(error) => return Err(error.into()),
                };
                match self.push_state(folder, &sealed, on_other, watch).await {
                    // It was labelled in the meantime, or a file was renamed between two looks.
                    Err(StoreError::Damaged { .. })
                        if folder.seal()?.as_ref() != Some(sealed.seal()) => {}
                    Err(StoreError::Local(error))
                        if (error.is_not_found() || error.is_passing()) && rounds_left > 0 =>
                    {
                        rounds_left -= 1;
                    }
                    Err(StoreError::Local(error))
                        if error.is_not_found() || error.is_bad_content() =>
                    {
                        return Err(damaged(format!("does not match its seal: {error}")));
                    }
                    pushed => return pushed,
                }
            }
        })
    }

    async fn push_state(
        &self,
        folder: &ScenarioFolder,
        sealed: &Sealed,
        on_other: OnOther,
        watch: &dyn Watch,
    ) -> Result<Pushed> {
        let id = folder.id();
        let damaged = |message: String| StoreError::Damaged {
            place: folder.root().display().to_string(),
            message,
        };
        folder.check_identity(sealed)?;
        let (ours, files) = (sealed.seal(), sealed.files());
        let mut replaced = false;
        match self.dated_seal(&id).await? {
            Some((theirs, _)) if theirs == *ours => return Ok(Pushed::Same),
            Some((theirs, _)) if theirs.config_hash != ours.config_hash => {
                return Err(StoreError::Damaged {
                    place: format!("{}/scenarios/{id}", self.name()),
                    message: format!(
                        "is committed, but was made from other parameters than {}; delete one of them first",
                        folder.root().display()
                    ),
                });
            }
            Some(_) if on_other == OnOther::Keep => return Ok(Pushed::Other),
            Some((theirs, _))
                if sealed.hash_of(ScenarioFolder::TRUTH_BOXES).is_none()
                    && self.is_labelled(&id, &theirs).await? =>
            {
                return Ok(Pushed::Labelled);
            }
            Some((_, committed)) if committed > sealed_at(folder)? => return Ok(Pushed::Newer),
            Some(_) => {
                // The store's version counts until ours is known to be complete.
                if let Some(fault) = seal::faults(folder.root())?.into_iter().next() {
                    return Err(damaged(fault));
                }
                self.delete(&scenario_file(&id, DONE)).await?;
                replaced = true;
            }
            None => {}
        }
        let there = self.objects(&id).await?;
        let (mut sent, mut skipped) = (0, 0);
        for file in files {
            if self.send_if_missing(folder, file, &there, watch).await? {
                sent += 1;
            } else {
                skipped += 1;
            }
        }
        self.delete_unnamed(&id, sealed, &there).await;
        // Only now: nobody looks at a scenario without them.
        let done = json_bytes(ours, &folder.root().join(DONE))?;
        for (name, bytes) in [
            (MANIFEST, sealed.manifest().as_bytes().to_vec()),
            (DONE, done),
        ] {
            self.send_bytes(&scenario_file(&id, name), bytes).await?;
        }
        Ok(Pushed::Committed {
            sent,
            there: skipped,
            replaced,
        })
    }

    /// Whether a scenario of the store is labelled; `false` if its manifest does not tell.
    async fn is_labelled(&self, id: &str, seal: &Seal) -> Result<bool> {
        let manifest = self.read(&scenario_file(id, MANIFEST)).await?;
        let manifest = manifest.and_then(|manifest| String::from_utf8(manifest).ok());
        let files = manifest.and_then(|manifest| seal::sealed_files(&manifest, seal).ok());
        let mut files = files.unwrap_or_default().into_iter();
        Ok(files.any(|file| file.name == ScenarioFolder::TRUTH_BOXES))
    }

    /// Deletes files of an earlier state of the scenario that the new one lacks.
    async fn delete_unnamed(
        &self,
        id: &str,
        sealed: &Sealed,
        there: &BTreeMap<String, ObjectInfo>,
    ) {
        let unnamed = there
            .keys()
            .filter(|name| seal::is_scenario_file(name) && sealed.hash_of(name).is_none());
        for name in unnamed {
            // Write permission does not imply permission to delete. It does no harm: files outside the manifest are ignored.
            if let Err(error) = self.delete(&scenario_file(id, name)).await {
                tracing::warn!(%error, "an earlier form of the scenario had it, and it is still there");
            }
        }
    }

    /// Whether the store has exactly this file.
    pub(crate) async fn has(
        &self,
        folder: &ScenarioFolder,
        file: &SealedFile,
        there: &BTreeMap<String, ObjectInfo>,
    ) -> Result<bool> {
        let path = seal::current_path(folder.root(), &file.name)?;
        let bytes = size_of(&path)?;
        let name = scenario_file(&folder.id(), &file.name);
        Ok(
            there.get(&file.name).map(|there| there.bytes) == Some(bytes)
                && self.hash_of(&name).await?.as_deref() == Some(file.blake3.as_str()),
        )
    }

    /// Whether the file had to be sent.
    pub(crate) async fn send_if_missing(
        &self,
        folder: &ScenarioFolder,
        file: &SealedFile,
        there: &BTreeMap<String, ObjectInfo>,
        watch: &dyn Watch,
    ) -> Result<bool> {
        if watch.stopped() {
            return Err(StoreError::Stopped);
        }
        if self.has(folder, file, there).await? {
            return Ok(false);
        }
        let path = seal::current_path(folder.root(), &file.name)?;
        let bytes = size_of(&path)?;
        let name = scenario_file(&folder.id(), &file.name);
        let hash = if bytes <= PART_BYTES {
            self.send_whole(&path, &name, &file.blake3, watch).await?
        } else {
            self.send_in_parts(&path, &name, bytes, &file.blake3, watch)
                .await?
        };
        match hash {
            Some(()) => Ok(true),
            None => Err(StoreError::Damaged {
                place: path.display().to_string(),
                message: format!("does not match its seal: its hash differs from {MANIFEST}"),
            }),
        }
    }

    /// `None` if the file has another hash; then nothing is sent.
    async fn send_whole(
        &self,
        path: &Path,
        name: &str,
        blake3: &str,
        watch: &dyn Watch,
    ) -> Result<Option<()>> {
        let file = outside_file::open(path, FileKind::VIDEO.unlinked())?;
        let (_, bytes) = read_part(file, PART_BYTES)
            .await
            .map_err(dataset::Error::io("read", path))?;
        if blake3::hash(&bytes).to_string() != blake3 {
            return Ok(None);
        }
        let length = bytes.len() as u64;
        let options = PutOptions {
            attributes: self.attributes(blake3),
            ..PutOptions::default()
        };
        self.store
            .put_opts(&self.own_key(name)?, bytes.into(), options)
            .await
            .map_err(|error| self.error(&format!("write {name}"), &error))?;
        watch.passed(length);
        Ok(Some(()))
    }

    /// The same in parts. If it fails, the parts in the store are removed.
    async fn send_in_parts(
        &self,
        path: &Path,
        name: &str,
        bytes: u64,
        blake3: &str,
        watch: &dyn Watch,
    ) -> Result<Option<()>> {
        // A process that clears incomplete uploads cannot know that this one is still active: it starts over.
        let failed = |error: object_store::Error| match error {
            object_store::Error::NotFound { .. } => StoreError::Away {
                url: self.name().into(),
                doing: format!("write {name}"),
                message: "another `dtd push` cleared this upload".into(),
            },
            error => self.error(&format!("write {name}"), &error),
        };
        let mut file = outside_file::open(path, FileKind::VIDEO.unlinked())?;
        let options = PutMultipartOptions {
            attributes: self.attributes(blake3),
            ..PutMultipartOptions::default()
        };
        let upload = self
            .store
            .put_multipart_opts(&self.own_key(name)?, options)
            .await
            .map_err(|error| self.error(&format!("write {name}"), &error))?;
        let part_bytes = PART_BYTES.max(bytes.div_ceil(MOST_PARTS));
        let mut parts = WriteMultipart::new_with_chunk_size(upload, part_bytes as usize);
        let mut hasher = blake3::Hasher::new();
        let whole = async {
            loop {
                let part;
                (file, part) = read_part(file, part_bytes)
                    .await
                    .map_err(dataset::Error::io("read", path))?;
                if part.is_empty() {
                    return Ok::<bool, StoreError>(hasher.finalize().to_string() == blake3);
                }
                if watch.stopped() {
                    return Err(StoreError::Stopped);
                }
                hasher.update(&part);
                parts
                    .wait_for_capacity(PARTS_AT_ONCE)
                    .await
                    .map_err(failed)?;
                let length = part.len() as u64;
                parts.put(part.into());
                watch.passed(length);
            }
        };
        let whole = whole.await;
        match whole {
            Ok(true) => {
                parts.finish().await.map_err(failed)?;
                Ok(Some(()))
            }
            other => {
                if let Err(error) = parts.abort().await {
                    tracing::debug!(%error, name, "parts are left in the store");
                }
                other.map(|_| None)
            }
        }
    }

    async fn send_bytes(&self, name: &str, bytes: Vec<u8>) -> Result<()> {
        let options = PutOptions {
            attributes: self.attributes(&blake3::hash(&bytes).to_string()),
            ..PutOptions::default()
        };
        self.store
            .put_opts(&self.own_key(name)?, bytes.into(), options)
            .await
            .map_err(|error| self.error(&format!("write {name}"), &error))?;
        Ok(())
    }
}

fn size_of(path: &Path) -> Result<u64> {
    let found = fs::metadata(path).map_err(dataset::Error::io("read", path))?;
    Ok(found.len())
}

/// When a scenario got its seal.
fn sealed_at(folder: &ScenarioFolder) -> Result<SystemTime> {
    let path = folder.root().join(DONE);
    let found = fs::metadata(&path).and_then(|found| found.modified());
    Ok(found.map_err(dataset::Error::io("look at", &path))?)
}

/// The next bytes of a file, on a thread that may block on the disk; empty at the end.
async fn read_part(mut file: File, most: u64) -> io::Result<(File, Vec<u8>)> {
    spawn_blocking(move || {
        let mut part = Vec::new();
        file.by_ref().take(most).read_to_end(&mut part)?;
        Ok((file, part))
    })
    .await
    .map_err(io::Error::other)?
}
