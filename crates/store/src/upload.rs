//! Uploads one scenario: all files first, then its seal, which commits them.
//!
//! The seal is created, or replaces one that was judged: of the same recording, and damaged or, if ours is labelled, unlabelled. A damaged
//! labelled copy is given back what it lost if ours is unlabelled. A scenario counts as committed once seal and listing were read again
//! and agree. A repeated upload sends only missing files.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;

use dataset::corpus::ScenarioFolder;
use dataset::corpus::seal::sealed::Sealed;
use dataset::corpus::seal::{self, DONE, MANIFEST, Seal, SealedFile};
use dataset::files::outside_file::{self, FileKind};
use object_store::{PutMultipartOptions, PutOptions, PutResult, WriteMultipart};
use tokio::task::spawn_blocking;

use crate::client::{Connection, Objects, scenario_file};
use crate::error::{Fault, Faults, Result, StoreError};
use crate::stored::{
    Evidence, FoundSeal, Noted, StoredSeal, check_names, content_name, manifest_file,
};

/// Changes of the folder during an upload: it is labelled once, and a file renamed to its final name just before it is opened.
const MAX_CHANGES: u32 = 3;
/// Part size; smaller files are one request. All stores accept parts of 5 MiB and more.
const PART_BYTES: u64 = 8 << 20;
/// Parts in parallel: limits memory, and is enough to fill a link with some latency.
const PARTS_AT_ONCE: usize = 4;
/// No store accepts more than 10 000 parts: parts of larger files are larger.
const MAX_PARTS: u64 = 9_000;

/// A scenario's state in the store before its upload.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Before {
    /// It was not committed.
    Nothing,
    /// It was committed without labels.
    Unlabelled,
    /// It was committed and was not whole.
    Damaged(Faults),
}

/// The copy that an upload commits: ours, or the store's with the files that it had lost.
struct Commit {
    before: Before,
    seal: Seal,
    /// The sealed files and the manifest.
    files: Vec<SealedFile>,
}

/// Upload result.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Pushed {
    /// It is committed now.
    Committed {
        /// Files that were sent.
        sent: usize,
        /// Files that existed already.
        there: usize,
        /// State in the store before the upload.
        before: Before,
    },
    /// It was committed already, with this content, and is whole.
    Same,
    /// The store has the same recording with labels, and ours has none.
    Labelled,
    /// The store has a whole copy with different content, which stays.
    Other,
}

/// The folder's state to upload.
struct LocalCopy<'a> {
    folder: &'a ScenarioFolder,
    id: String,
    sealed: &'a Sealed,
    /// The sealed files and the manifest.
    files: Vec<SealedFile>,
}

impl LocalCopy<'_> {
    fn commit(&self, before: Before) -> Commit {
        Commit {
            before,
            seal: self.sealed.seal().clone(),
            files: self.files.clone(),
        }
    }
}

impl Connection<'_> {
    /// Uploads a sealed scenario and commits it, if it may replace the store's.
    ///
    /// # Errors
    /// The folder does not match its seal, the scenario in the store has other parameters, or the store fails; then the same call
    /// resumes.
    pub async fn push_scenario(&self, folder: &ScenarioFolder) -> Result<Pushed> {
        let damaged = |message: String| StoreError::Damaged {
            place: folder.root().display().to_string(),
            message,
        };
        let mut changes = 0;
        loop {
            let sealed = match Sealed::read(folder.root()) {
                Ok(Some(sealed)) => sealed,
                Ok(None) => return Err(damaged(format!("has no {DONE}: it was never finished"))),
                Err(error) if error.is_bad_content() => return Err(damaged(error.to_string())),
                Err(error) => return Err(error.into()),
            };
            changes += 1;
            let may_change = changes <= MAX_CHANGES;
            match self.push_sealed(folder, &sealed).await {
                Err(StoreError::Damaged { .. })
                    if may_change && folder.seal()?.as_ref() != Some(sealed.seal()) => {}
                Err(StoreError::Local(error))
                    if may_change && (error.is_not_found() || error.is_passing()) => {}
                Err(StoreError::Local(error)) if error.is_not_found() || error.is_bad_content() => {
                    return Err(damaged(format!("does not match its seal: {error}")));
                }
                pushed => return pushed,
            }
        }
    }

    async fn push_sealed(&self, folder: &ScenarioFolder, sealed: &Sealed) -> Result<Pushed> {
        folder.check_identity(sealed)?;
        let damaged = |message: String| StoreError::Damaged {
            place: folder.root().display().to_string(),
            message,
        };
        check_names(sealed.files()).map_err(|fault| damaged(fault.message))?;
        let mut files = sealed.files().to_vec();
        files.push(manifest_file(sealed.seal()));
        let ours = LocalCopy {
            folder,
            id: folder.id(),
            sealed,
            files,
        };
        let done = scenario_file(&ours.id, DONE);
        let mut retries = self.retries();
        // Objects that this call has sent; later rounds confirm them.
        let mut sent = BTreeMap::new();
        let mut committed = None;
        let mut fault = None;
        loop {
            let found = self.found_seal(&ours.id).await?;
            let there = self.objects(&ours.id).await?;
            let commit = match self.judge(&ours, found.as_ref(), &there).await? {
                Ok(commit) => commit,
                Err(Pushed::Other) => return Ok(Pushed::Other),
                Err(pushed) => return Ok(committed.unwrap_or(pushed)),
            };
            // What this call has sent or committed is not there, or others have replaced it.
            if let Some(fault) = fault.take() {
                self.wait(&mut retries, fault).await?;
            }
            // Only a whole copy may replace a whole one: the hashes of the files that are sent do not suffice.
            if commit.before == Before::Unlabelled
                && let Some(fault) = seal::faults(folder.root())?.into_iter().next()
            {
                return Err(damaged(fault));
            }
            let stored = found.as_ref().and_then(|found| found.stored.as_ref().ok());
            let files = &commit.files;
            let count = self.send_files(&ours, files, stored, &there, &mut sent);
            let count = count.await?;
            let listed = self.objects(&ours.id).await?;
            let is_lost = |file: &&SealedFile| {
                let noted = sent.get(&file.name);
                !noted.is_some_and(|noted| listed.has(file, noted))
            };
            if let Some(lost) = files.iter().find(is_lost) {
                fault = Some(self.store.not_kept(&scenario_file(&ours.id, &lost.name)));
                continue;
            }
            let stored = StoredSeal::new(commit.seal, sent.clone());
            let version = found.as_ref().map(|found| &found.version);
            // A repeated request may meet what the first one wrote.
            self.replace(&done, &stored.to_json()?, version).await?;
            committed.get_or_insert(Pushed::Committed {
                sent: count,
                there: files.len() - 1 - count,
                before: commit.before,
            });
            fault = Some(self.store.not_kept(&done));
        }
    }

    /// Compares our copy with the store's: what to commit, or why the store's stays.
    ///
    /// # Errors
    /// The store's copy has other parameters, or is damaged and may not be replaced by ours.
    async fn judge(
        &self,
        ours: &LocalCopy<'_>,
        found: Option<&FoundSeal>,
        there: &Objects,
    ) -> Result<std::result::Result<Commit, Pushed>> {
        let damaged = |faults| Ok(Ok(ours.commit(Before::Damaged(Faults(faults)))));
        let stored = match found.map(|found| &found.stored) {
            None => return Ok(Ok(ours.commit(Before::Nothing))),
            Some(Err(fault)) => return damaged(vec![fault.clone()]),
            Some(Ok(stored)) => stored,
        };
        let (id, seal) = (&ours.id, ours.sealed.seal());
        let (found_hash, our_hash) = (&stored.seal.config_hash, &seal.config_hash);
        if stored.seal.manifest_blake3 == seal.manifest_blake3 {
            if found_hash != our_hash {
                let difference = format!(
                    "has the config_hash {found_hash}, expected {our_hash} as in the same manifest elsewhere"
                );
                return damaged(vec![Fault::of(DONE, difference)]);
            }
            let faults = self.faults_of(id, &ours.files, stored, there).await?;
            return if faults.is_empty() {
                Ok(Err(Pushed::Same))
            } else {
                damaged(faults)
            };
        }
        if found_hash != our_hash {
            let message = format!(
                "is committed, but was made from other parameters than {folder}; to keep the store's, move {folder} away; to replace it, \
                 delete {}/{} and push again",
                self.store.name(),
                scenario_file(id, DONE),
                folder = ours.folder.root().display(),
            );
            return Err(self.store.damaged(&format!("scenarios/{id}"), message));
        }
        self.judge_content(ours, stored, there).await
    }

    /// Compares our copy with a different one in the store that has the same parameters.
    async fn judge_content(
        &self,
        ours: &LocalCopy<'_>,
        stored: &StoredSeal,
        there: &Objects,
    ) -> Result<std::result::Result<Commit, Pushed>> {
        let id = &ours.id;
        let damaged = |faults| Before::Damaged(Faults(faults));
        let files = match self.files_of(id, stored, there).await? {
            Ok(files) => files,
            Err(fault) => return Ok(Ok(ours.commit(damaged(vec![fault])))),
        };
        let faults = self.faults_of(id, &files, stored, there).await?;
        let is_same_recording = videos_of(&ours.files) == videos_of(&files);
        let labels = (is_labelled(&ours.files), is_labelled(&files));
        if faults.is_empty() {
            return Ok(match labels {
                (true, false) if is_same_recording => Ok(ours.commit(Before::Unlabelled)),
                (false, true) if is_same_recording => Err(Pushed::Labelled),
                _ => Err(Pushed::Other),
            });
        }
        let removes_labels = labels == (false, true);
        if is_same_recording && !removes_labels {
            return Ok(Ok(ours.commit(damaged(faults))));
        }
        let is_lost = |file: &&SealedFile| faults.iter().any(|fault| fault.file == file.name);
        let mut lost = files.iter().filter(is_lost);
        if is_same_recording && lost.all(|file| ours.files.contains(file)) {
            return Ok(Ok(Commit {
                before: damaged(faults),
                seal: stored.seal.clone(),
                files,
            }));
        }
        let (reason, needed) = if is_same_recording {
            ("it has no labels", "a labelled copy")
        } else {
            (
                "it is a different recording",
                "a copy of the store's recording",
            )
        };
        let message = format!(
            "is damaged: {}; {} does not replace it, because {reason}; to mend it, push {needed}; to replace it, delete {}/{} and run the \
             same command again",
            Faults(faults),
            ours.folder.root().display(),
            self.store.name(),
            scenario_file(id, DONE),
        );
        Err(self.store.damaged(&format!("scenarios/{id}"), message))
    }

    /// Sends the files that the store lacks, and returns their number without the manifest. An object without a note is read: the store
    /// may have exchanged it since a killed upload.
    async fn send_files(
        &self,
        ours: &LocalCopy<'_>,
        files: &[SealedFile],
        stored: Option<&StoredSeal>,
        there: &Objects,
        sent: &mut BTreeMap<String, Noted>,
    ) -> Result<usize> {
        let mut count = 0;
        let manifest = ours.sealed.manifest().as_bytes();
        let own_manifest = manifest_file(ours.sealed.seal());
        sent.retain(|name, noted| {
            let is_sent = |file: &SealedFile| file.name == *name && file.blake3 == noted.blake3;
            files.iter().any(is_sent)
        });
        for file in files {
            self.watch.check()?;
            let noted = sent.get(&file.name);
            let noted = noted.or_else(|| stored.and_then(|stored| stored.noted(file)));
            let evidence = noted.map_or(Evidence::Content, Noted::evidence);
            let noted = match self.look(&ours.id, file, evidence, there).await? {
                Ok(noted) => noted,
                Err(_) if *file == own_manifest => {
                    let name = scenario_file(&ours.id, &content_name(file));
                    let put = async || self.put_hashed(&name, manifest, &file.blake3).await;
                    note(file, manifest.len() as u64, self.ask(put).await?)
                }
                Err(_) => {
                    count += 1;
                    self.send(ours.folder, file).await?
                }
            };
            sent.insert(file.name.clone(), noted);
        }
        Ok(count)
    }

    /// Uploads a scenario's file, as one request or in parts; its object carries the hash as metadata.
    pub(crate) async fn send(&self, folder: &ScenarioFolder, file: &SealedFile) -> Result<Noted> {
        let path = seal::current_path(folder.root(), &file.name)?;
        let bytes = size_of(&path)?;
        let name = scenario_file(&folder.id(), &content_name(file));
        self.store.own_key(&name)?;
        let put = self.ask(async || {
            if bytes <= PART_BYTES {
                self.send_at_once(&path, &name, &file.blake3).await
            } else {
                self.send_in_parts(&path, &name, bytes, &file.blake3).await
            }
        });
        match put.await? {
            Some(put) => Ok(note(file, bytes, put)),
            None => Err(StoreError::Damaged {
                place: path.display().to_string(),
                message: format!("does not match its seal: its hash differs from {MANIFEST}"),
            }),
        }
    }

    async fn put_hashed(&self, name: &str, bytes: &[u8], blake3: &str) -> Result<PutResult> {
        let options = PutOptions {
            attributes: self.store.attributes(blake3),
            ..PutOptions::default()
        };
        let put = self.store.put(name, bytes, options).await;
        put.map_err(|error| self.store.error(&format!("write {name}"), &error))
    }

    /// Returns `None` without sending if the hash differs.
    async fn send_at_once(
        &self,
        path: &Path,
        name: &str,
        blake3: &str,
    ) -> Result<Option<PutResult>> {
        let file = outside_file::open(path, FileKind::VIDEO.unlinked())?;
        let read = read_part(file, PART_BYTES).await;
        let (_, bytes) = read.map_err(dataset::Error::io("read", path))?;
        if seal::hash_bytes(&bytes) != blake3 {
            return Ok(None);
        }
        let put = self.put_hashed(name, &bytes, blake3).await?;
        self.passed(bytes.len());
        Ok(Some(put))
    }

    /// Sends parts. If one fails, those in the store are removed.
    async fn send_in_parts(
        &self,
        path: &Path,
        name: &str,
        bytes: u64,
        blake3: &str,
    ) -> Result<Option<PutResult>> {
        let doing = format!("write {name}");
        let failed = |error: object_store::Error| match error {
            object_store::Error::NotFound { .. } => {
                let message = "this upload was aborted, e.g. by a lifecycle rule of the bucket";
                self.store.away(&doing, message)
            }
            error => self.store.error(&doing, &error),
        };
        let mut file = outside_file::open(path, FileKind::VIDEO.unlinked())?;
        let options = PutMultipartOptions {
            attributes: self.store.attributes(blake3),
            ..PutMultipartOptions::default()
        };
        let upload = (self.store.client)
            .put_multipart_opts(&self.store.key(name), options)
            .await
            .map_err(|error| self.store.error(&doing, &error))?;
        let part_bytes = PART_BYTES.max(bytes.div_ceil(MAX_PARTS));
        let mut parts = WriteMultipart::new_with_chunk_size(upload, part_bytes as usize);
        let mut hasher = blake3::Hasher::new();
        let is_same = async {
            loop {
                let read = read_part(file, part_bytes).await;
                let (rest, part) = read.map_err(dataset::Error::io("read", path))?;
                file = rest;
                if part.is_empty() {
                    return Ok::<bool, StoreError>(hasher.finalize().to_string() == blake3);
                }
                self.watch.check()?;
                hasher.update(&part);
                let room = parts.wait_for_capacity(PARTS_AT_ONCE).await;
                room.map_err(failed)?;
                self.passed(part.len());
                parts.put(part.into());
            }
        };
        match is_same.await {
            Ok(true) => Ok(Some(parts.finish().await.map_err(failed)?)),
            other => {
                if let Err(error) = parts.abort().await {
                    tracing::debug!(%error, name, "parts are left in the store");
                }
                other.map(|_| None)
            }
        }
    }
}

fn note(file: &SealedFile, bytes: u64, put: PutResult) -> Noted {
    Noted {
        blake3: file.blake3.clone(),
        bytes,
        e_tag: put.e_tag,
    }
}

fn is_labelled(files: &[SealedFile]) -> bool {
    files
        .iter()
        .any(|file| file.name == ScenarioFolder::TRUTH_BOXES)
}

/// Names and hashes of the videos: copies with the same ones are of the same recording.
fn videos_of(files: &[SealedFile]) -> BTreeMap<&str, &str> {
    let videos = files.iter().filter(|file| file.name.starts_with("views/"));
    videos
        .map(|file| (file.name.as_str(), file.blake3.as_str()))
        .collect()
}

fn size_of(path: &Path) -> Result<u64> {
    let about = fs::metadata(path).map_err(dataset::Error::io("read", path))?;
    Ok(about.len())
}

/// Next bytes, read on a thread that may block on the disk; empty at the end.
async fn read_part(mut file: File, max_bytes: u64) -> io::Result<(File, Vec<u8>)> {
    spawn_blocking(move || {
        let mut part = Vec::new();
        file.by_ref().take(max_bytes).read_to_end(&mut part)?;
        Ok((file, part))
    })
    .await
    .map_err(io::Error::other)?
}
