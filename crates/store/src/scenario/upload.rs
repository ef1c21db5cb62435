//! Uploads one scenario from its folder: all files first, then the manifest, then the seal, which commits them.
//!
//! Objects of files are named after their content, so they are never overwritten with other content. Only `DONE.json` is replaced,
//! and only if it is still the one that was judged. After that it is read again and compared with a listing: a scenario is reported as
//! committed once the store has all of it.
//!
//! An interrupted upload resumes when it is repeated: files that exist with the right size and hash are not sent.

use std::collections::BTreeMap;
use std::fs;
use std::time::SystemTime;

use dataset::corpus::ScenarioFolder;
use dataset::corpus::seal::sealed::Sealed;
use dataset::corpus::seal::{self, DONE, SealedFile};
use dataset::files::outside_file::{self, FileKind};
use futures_util::future::BoxFuture;

use super::precedence::{First, SealedCopy, are_same_poses, first};
use super::stored_fault::{StoredFault, StoredFaults};
use super::stored_seal::{FoundSeal, Noted, StoredSeal, manifest_file};
use crate::corpus_store::{CorpusStore, Objects, scenario_file};
use crate::error::{Result, StoreError};
use crate::patience::Transfer;

/// Maximum number of times that a file of the folder may be renamed to its final name just before it is opened.
const ROUNDS: u32 = 3;
/// Maximum number of times that another process may commit the same scenario, or the store may lose a part of it, before an upload gives
/// up.
const MAX_COMMITS: u32 = 8;

/// State of a scenario in the store before it was uploaded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Before {
    /// It was not committed.
    Nothing,
    /// It was committed with content that ours goes before.
    Other,
    /// It was committed, but not all of it was there.
    Damaged(StoredFaults),
}

/// The result for a scenario.
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
    /// It was committed already, with this content, and all of it is there.
    Same,
    /// It is committed with the same parameters, but is another recording, and was left alone.
    OtherRecording,
    /// Of the same recording, the store has a version that was sealed later.
    Newer,
    /// Of the same recording, the store has the labels and ours has none.
    Labelled,
}

/// Remaining work of an upload.
enum Standing {
    /// No work is left.
    Settled(Pushed),
    /// Send what is missing, and commit.
    ToCommit(Before),
    /// The objects that the store's copy had lost are sent; its seal must be replaced by one that notes them before a copy is chosen.
    Mended(StoredSeal),
}

/// One state of a folder, to upload.
struct Ours<'a> {
    folder: &'a ScenarioFolder,
    sealed: &'a Sealed,
    sealed_at: SystemTime,
    /// The sealed files and the manifest.
    files: Vec<SealedFile>,
}

impl CorpusStore {
    /// Uploads a sealed scenario and commits it, if it goes before what the store has. `seen` are its objects from a listing, if there
    /// is one.
    ///
    /// # Errors
    /// The folder does not match its seal, the scenario in the store has other parameters, or the store fails; then the same call
    /// resumes.
    pub fn push_scenario<'a>(
        &'a self,
        folder: &'a ScenarioFolder,
        seen: Option<&'a Objects>,
        transfer: &'a Transfer<'_>,
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
                match self.push_state(folder, &sealed, seen, transfer).await {
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
        seen: Option<&Objects>,
        transfer: &Transfer<'_>,
    ) -> Result<Pushed> {
        folder.check_identity(sealed)?;
        let id = folder.id();
        let mut files = sealed.files().to_vec();
        files.push(manifest_file(sealed.seal()));
        let ours = Ours {
            folder,
            sealed,
            sealed_at: sealed_at(folder)?,
            files,
        };
        let mut seen = seen.cloned();
        // Objects that this call has sent and committed; later rounds confirm them.
        let mut noted = BTreeMap::new();
        let mut committed: Option<Pushed> = None;
        for _ in 0..MAX_COMMITS {
            let found = self.found_seal(&id).await?;
            let there = self.objects_for(&ours, found.as_ref(), seen.take()).await?;
            let standing = self
                .standing(&ours, found.as_ref(), &there, transfer)
                .await?;
            let now_before = match standing {
                Standing::Settled(Pushed::Same) => return Ok(committed.unwrap_or(Pushed::Same)),
                Standing::Settled(pushed) => return Ok(pushed),
                Standing::ToCommit(before) => before,
                Standing::Mended(theirs) => {
                    let version = found.map(|found| found.version);
                    let done = theirs.to_json()?;
                    self.replace_version(&id, DONE, &done, version.as_ref())
                        .await?;
                    continue;
                }
            };
            // The store's version is whole, so only another whole version may replace it. The hashes of the files that are sent do not
            // suffice.
            if now_before == Before::Other
                && let Some(fault) = seal::faults(folder.root())?.into_iter().next()
            {
                return Err(StoreError::Damaged {
                    place: folder.root().display().to_string(),
                    message: fault,
                });
            }
            let now_sent = self
                .send_files(&ours, found.as_ref(), &there, &mut noted, transfer)
                .await?;
            let stored = StoredSeal::new(sealed.seal().clone(), ours.sealed_at, noted.clone());
            let done = stored.to_json()?;
            let version = found.map(|found| found.version);
            if self
                .replace_version(&id, DONE, &done, version.as_ref())
                .await?
            {
                committed.get_or_insert(Pushed::Committed {
                    sent: now_sent,
                    there: sealed.files().len() - now_sent,
                    before: now_before,
                });
            }
        }
        Err(StoreError::Away {
            url: self.name().into(),
            doing: format!("commit scenario {id}"),
            message: "others change it all the time, or the store loses what it is sent".into(),
        })
    }

    /// The objects of a scenario in the store. A listing that was made before the seal was read is enough if it has all of ours, or
    /// if there is no seal.
    async fn objects_for(
        &self,
        ours: &Ours<'_>,
        found: Option<&FoundSeal>,
        seen: Option<Objects>,
    ) -> Result<Objects> {
        let id = ours.folder.id();
        if let Some(seen) = seen {
            let is_enough = match found.map(|found| &found.stored) {
                None => true,
                Some(Ok(stored)) if stored.is_of(ours.sealed.seal()) => {
                    self.faults_of_ours(ours, stored, &seen).await?.is_empty()
                }
                Some(_) => false,
            };
            if is_enough {
                return Ok(seen);
            }
        }
        self.objects(&id).await
    }

    async fn faults_of_ours(
        &self,
        ours: &Ours<'_>,
        stored: &StoredSeal,
        there: &Objects,
    ) -> Result<Vec<StoredFault>> {
        let mut faults = Vec::new();
        for file in &ours.files {
            faults.extend(self.fault(&ours.folder.id(), file, stored, there).await?);
        }
        Ok(faults)
    }

    /// Compares our copy with the store's.
    async fn standing(
        &self,
        ours: &Ours<'_>,
        found: Option<&FoundSeal>,
        there: &Objects,
        transfer: &Transfer<'_>,
    ) -> Result<Standing> {
        let Some(found) = found else {
            return Ok(Standing::ToCommit(Before::Nothing));
        };
        let damaged =
            |faults: Vec<StoredFault>| Standing::ToCommit(Before::Damaged(StoredFaults(faults)));
        let stored = match &found.stored {
            Ok(stored) => stored,
            Err(fault) => return Ok(damaged(vec![fault.clone()])),
        };
        if stored.is_of(ours.sealed.seal()) {
            let faults = self.faults_of_ours(ours, stored, there).await?;
            return Ok(if faults.is_empty() {
                Standing::Settled(Pushed::Same)
            } else {
                damaged(faults)
            });
        }
        let id = ours.folder.id();
        let (found_hash, our_hash) = (&stored.seal.config_hash, &ours.sealed.seal().config_hash);
        if stored.seal.manifest_blake3 == ours.sealed.seal().manifest_blake3 {
            // The same record, which has the hash: ours was compared with it.
            return Ok(damaged(vec![StoredFault::OtherParameters {
                found: found_hash.clone(),
                expected: our_hash.clone(),
            }]));
        }
        if found_hash != our_hash {
            return Err(self.damaged(
                &id,
                format!(
                    "is committed, but was made from other parameters than {folder}; to keep the store's, move {folder} away; to replace it, \
                     delete {}/scenarios/{id}/DONE.json and push again",
                    self.name(),
                    folder = ours.folder.root().display(),
                ),
            ));
        }
        let files = match self.their_files(&id, stored, there).await? {
            Ok(files) => files,
            Err(fault) => return Ok(damaged(vec![fault])),
        };
        let (mended, faults) = self.mend(ours, stored, &files, there, transfer).await?;
        if !faults.is_empty() {
            return Ok(damaged(faults));
        }
        if let Some(mut mended) = mended {
            mended.keep_time(found.sealed());
            return Ok(Standing::Mended(mended));
        }
        let theirs = SealedCopy {
            files: &files,
            sealed: found.sealed(),
            manifest_blake3: &stored.seal.manifest_blake3,
        };
        self.precedence(ours, &theirs, there).await
    }

    /// Sends what a committed scenario has lost and ours has. Returns its seal with notes of the objects that were sent, if any were, and
    /// what remains lost.
    async fn mend(
        &self,
        ours: &Ours<'_>,
        stored: &StoredSeal,
        theirs: &[SealedFile],
        there: &Objects,
        transfer: &Transfer<'_>,
    ) -> Result<(Option<StoredSeal>, Vec<StoredFault>)> {
        let mut faults = Vec::new();
        let mut mended = None;
        for file in theirs {
            let Some(fault) = self.fault(&ours.folder.id(), file, stored, there).await? else {
                continue;
            };
            if !ours.sealed.files().contains(file) {
                faults.push(fault);
                continue;
            }
            let (object, _) = self
                .send_if_missing(ours.folder, file, None, there, transfer)
                .await?;
            mended
                .get_or_insert_with(|| stored.clone())
                .note(file, object);
        }
        Ok((mended, faults))
    }

    /// The rule for two whole copies with the same parameters ([`super::precedence`]).
    async fn precedence(
        &self,
        ours: &Ours<'_>,
        theirs: &SealedCopy<'_>,
        there: &Objects,
    ) -> Result<Standing> {
        let copy = SealedCopy {
            files: &ours.files,
            sealed: ours.sealed_at,
            manifest_blake3: &ours.sealed.seal().manifest_blake3,
        };
        let is_same_recording = copy.has_videos_of(theirs)
            && (copy.has_frames_of(theirs) || self.has_poses_of(ours, theirs, there).await?);
        if !is_same_recording {
            return Ok(Standing::Settled(Pushed::OtherRecording));
        }
        Ok(match first(&copy, theirs) {
            First::Ours => Standing::ToCommit(Before::Other),
            First::TheirsIsLabelled => Standing::Settled(Pushed::Labelled),
            First::TheirsIsLater => Standing::Settled(Pushed::Newer),
        })
    }

    async fn has_poses_of(
        &self,
        ours: &Ours<'_>,
        theirs: &SealedCopy<'_>,
        there: &Objects,
    ) -> Result<bool> {
        let mut frames = theirs.files.iter();
        let frames = frames.find(|file| file.name == ScenarioFolder::FRAMES);
        let Some((object, _)) = frames.and_then(|frames| there.locate(frames)) else {
            return Ok(false);
        };
        let name = scenario_file(&ours.folder.id(), &object);
        let theirs = self.read(&name).await?;
        let theirs = theirs.ok_or_else(|| StoreError::Away {
            url: self.name().into(),
            doing: format!("read {name}"),
            message: "it was listed, and is missing now".into(),
        })?;
        let path = seal::current_path(ours.folder.root(), ScenarioFolder::FRAMES)?;
        let ours = outside_file::read(&path, FileKind::TABLE.unlinked())?;
        Ok(are_same_poses(ours, theirs))
    }

    /// Sends all files and the manifest, unless they are there; returns how many files were sent.
    async fn send_files(
        &self,
        ours: &Ours<'_>,
        found: Option<&FoundSeal>,
        there: &Objects,
        noted: &mut BTreeMap<String, Noted>,
        transfer: &Transfer<'_>,
    ) -> Result<usize> {
        let stored = found.and_then(|found| found.stored.as_ref().ok());
        let mut sent = 0;
        for file in ours.sealed.files() {
            let earlier = noted.get(&file.name);
            let earlier = earlier.or_else(|| stored.and_then(|stored| stored.noted(file)));
            let e_tag = earlier.and_then(|earlier| earlier.e_tag.as_deref());
            let (object, was_sent) = self
                .send_if_missing(ours.folder, file, e_tag, there, transfer)
                .await?;
            noted.insert(file.name.clone(), object);
            sent += usize::from(was_sent);
        }
        let manifest = manifest_file(ours.sealed.seal());
        let bytes = ours.sealed.manifest().as_bytes();
        let object = self.send_bytes(&ours.folder.id(), &manifest, bytes).await?;
        noted.insert(manifest.name, object);
        Ok(sent)
    }
}

/// The time at which a scenario was sealed.
fn sealed_at(folder: &ScenarioFolder) -> Result<SystemTime> {
    let path = folder.root().join(DONE);
    let found = fs::metadata(&path).and_then(|found| found.modified());
    Ok(found.map_err(dataset::Error::io("look at", &path))?)
}
