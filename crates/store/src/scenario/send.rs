//! Uploads one file, as one request or in parts. Each object carries the BLAKE3 hash of its content as metadata.

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;

use dataset::corpus::ScenarioFolder;
use dataset::corpus::seal::{self, MANIFEST, SealedFile};
use dataset::files::outside_file::{self, FileKind};
use object_store::{PutMultipartOptions, PutOptions, PutResult, WriteMultipart};
use tokio::task::spawn_blocking;

use super::content_name::content_name;
use super::stored_seal::Noted;
use crate::corpus_store::{CorpusStore, Objects, scenario_file};
use crate::error::{Result, StoreError};
use crate::patience::Transfer;

/// A file up to this size is one request, a larger one is sent in parts of this size. All stores accept parts of 5 MiB and more.
const PART_BYTES: u64 = 8 << 20;
/// Parts of one file in parallel: limits memory, and is enough to fill a link with some latency.
const PARTS_AT_ONCE: usize = 4;
/// No store accepts more than 10 000 parts: parts of larger files are larger.
const MAX_PARTS: u64 = 9_000;

impl CorpusStore {
    /// Uploads a file of a scenario unless the store has it; returns its object, and whether it had to be sent. `e_tag` is the tag
    /// of this content, if an upload noted it.
    pub(crate) async fn send_if_missing(
        &self,
        folder: &ScenarioFolder,
        file: &SealedFile,
        e_tag: Option<&str>,
        there: &Objects,
        transfer: &Transfer<'_>,
    ) -> Result<(Noted, bool)> {
        transfer.check()?;
        let path = seal::current_path(folder.root(), &file.name)?;
        let bytes = size_of(&path)?;
        let id = folder.id();
        let whole = self.whole_object(&id, file, Some(bytes), e_tag, there);
        if let Ok(noted) = whole.await? {
            return Ok((noted, false));
        }
        let name = scenario_file(&id, &content_name(file));
        let put = if bytes <= PART_BYTES {
            self.send_whole(&path, &name, &file.blake3, transfer)
                .await?
        } else {
            self.send_in_parts(&path, &name, bytes, &file.blake3, transfer)
                .await?
        };
        let Some(put) = put else {
            return Err(StoreError::Damaged {
                place: path.display().to_string(),
                message: format!("does not match its seal: its hash differs from {MANIFEST}"),
            });
        };
        transfer.kept();
        Ok((noted(file, bytes, put), true))
    }

    /// Uploads a small file of which the content is in memory.
    pub(crate) async fn send_bytes(
        &self,
        id: &str,
        file: &SealedFile,
        bytes: &[u8],
    ) -> Result<Noted> {
        let name = scenario_file(id, &content_name(file));
        let put = self.put_hashed(&name, bytes.to_vec(), &file.blake3).await?;
        Ok(noted(file, bytes.len() as u64, put))
    }

    async fn put_hashed(&self, name: &str, bytes: Vec<u8>, blake3: &str) -> Result<PutResult> {
        let options = PutOptions {
            attributes: self.attributes(blake3),
            ..PutOptions::default()
        };
        self.store
            .put_opts(&self.own_key(name)?, bytes.into(), options)
            .await
            .map_err(|error| self.error(&format!("write {name}"), &error))
    }

    /// Returns `None` without sending if the file has another hash.
    async fn send_whole(
        &self,
        path: &Path,
        name: &str,
        blake3: &str,
        transfer: &Transfer<'_>,
    ) -> Result<Option<PutResult>> {
        let file = outside_file::open(path, FileKind::VIDEO.unlinked())?;
        let (_, bytes) = read_part(file, PART_BYTES)
            .await
            .map_err(dataset::Error::io("read", path))?;
        if blake3::hash(&bytes).to_string() != blake3 {
            return Ok(None);
        }
        let length = bytes.len() as u64;
        let put = self.put_hashed(name, bytes, blake3).await?;
        transfer.passed(length);
        Ok(Some(put))
    }

    /// The same in parts. If it fails, the parts in the store are removed.
    async fn send_in_parts(
        &self,
        path: &Path,
        name: &str,
        bytes: u64,
        blake3: &str,
        transfer: &Transfer<'_>,
    ) -> Result<Option<PutResult>> {
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
        let part_bytes = PART_BYTES.max(bytes.div_ceil(MAX_PARTS));
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
                transfer.check()?;
                hasher.update(&part);
                parts
                    .wait_for_capacity(PARTS_AT_ONCE)
                    .await
                    .map_err(failed)?;
                let length = part.len() as u64;
                parts.put(part.into());
                transfer.passed(length);
            }
        };
        let whole = whole.await;
        match whole {
            Ok(true) => {
                let put = parts.finish().await.map_err(failed)?;
                Ok(Some(put))
            }
            other => {
                if let Err(error) = parts.abort().await {
                    tracing::debug!(%error, name, "parts are left in the store");
                }
                other.map(|_| None)
            }
        }
    }
}

fn noted(file: &SealedFile, bytes: u64, put: PutResult) -> Noted {
    Noted {
        blake3: file.blake3.clone(),
        bytes,
        e_tag: put.e_tag,
    }
}

pub(crate) fn size_of(path: &Path) -> Result<u64> {
    let found = fs::metadata(path).map_err(dataset::Error::io("read", path))?;
    Ok(found.len())
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
