//! The seal of a scenario in a store, and the comparison of the scenario with a listing.
//!
//! `DONE.json` has the content of a folder's seal, and notes what the upload has sent: hash, size and ETag of each object. So one
//! listing shows whether all of it is still there. The hash of an object with another ETag, or none noted, is looked up. A checksum of
//! the seal itself shows whether any of this was changed.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, SystemTime};

use dataset::corpus::seal::{self, DONE, MANIFEST, Seal, SealedFile};
use dataset::files::json_file::json_bytes;
use futures_util::future::BoxFuture;
use object_store::UpdateVersion;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::content_name::content_name;
use super::stored_fault::{StoredFault, StoredFaults};
use crate::corpus_store::{CorpusStore, Objects, scenario_file};
use crate::error::{Result, StoreError};

/// `DONE.json` in a store.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct StoredSeal {
    #[serde(flatten)]
    pub(crate) seal: Seal,
    /// Time at which the scenario was sealed in its folder, by that machine's clock, in milliseconds since 1970. Missing if another
    /// tool copied the folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    sealed_unix_ms: Option<u64>,
    /// The objects of all sealed files and of the manifest, by the names of the files. Empty if another tool copied the folder.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) objects: BTreeMap<String, Noted>,
    /// BLAKE3 hash of all other fields. Missing if another tool copied the folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    seal_blake3: Option<String>,
}

/// The field that is not part of the hash.
const CHECKSUM: &str = "seal_blake3";

/// An object as its upload noted it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Noted {
    /// Hash of its content.
    pub(crate) blake3: String,
    /// Its size.
    pub(crate) bytes: u64,
    /// The store's tag of this content.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) e_tag: Option<String>,
}

/// `DONE.json` of a scenario, as read.
#[derive(Debug)]
pub(crate) struct FoundSeal {
    /// The seal, or what is wrong with it.
    pub(crate) stored: std::result::Result<StoredSeal, StoredFault>,
    /// The version to replace.
    pub(crate) version: UpdateVersion,
    /// Time of writing, by the store's clock.
    modified: SystemTime,
}

/// State of a scenario in a store.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Committed {
    /// It has no seal.
    No,
    /// All its objects are there.
    Whole(Seal),
    /// It has a seal, but not all that was sealed.
    Damaged(StoredFaults),
}

impl StoredSeal {
    pub(crate) fn new(seal: Seal, sealed: SystemTime, objects: BTreeMap<String, Noted>) -> Self {
        Self {
            seal,
            sealed_unix_ms: Some(unix_ms(sealed)),
            objects,
            seal_blake3: None,
        }
    }

    /// Reads a `DONE.json`, which must match its checksum, if it has one.
    fn parse(text: &[u8]) -> std::result::Result<Self, StoredFault> {
        let bad = |error: serde_json::Error| StoredFault::NotASeal {
            reason: error.to_string(),
        };
        let stored: Self = serde_json::from_slice(text).map_err(bad)?;
        let Some(seal_blake3) = &stored.seal_blake3 else {
            return Ok(stored);
        };
        if checksum(text).map_err(bad)? == *seal_blake3 {
            Ok(stored)
        } else {
            Err(StoredFault::ChangedSeal)
        }
    }

    /// The content of `DONE.json`, with a checksum.
    pub(crate) fn to_json(&self) -> Result<Vec<u8>> {
        let done = Path::new(DONE);
        let mut sealed = self.clone();
        sealed.seal_blake3 = None;
        let hash = checksum(&json_bytes(&sealed, done)?);
        sealed.seal_blake3 = Some(hash.map_err(|source| dataset::Error::Json {
            what: "seal to write",
            path: done.to_owned(),
            source,
        })?);
        Ok(json_bytes(&sealed, done)?)
    }

    /// The time at which the scenario was sealed in its folder, if noted.
    pub(crate) fn sealed(&self) -> Option<SystemTime> {
        let since_1970 = Duration::from_millis(self.sealed_unix_ms?);
        SystemTime::UNIX_EPOCH.checked_add(since_1970)
    }

    /// True if it seals the same content.
    pub(crate) fn is_of(&self, seal: &Seal) -> bool {
        self.seal.manifest_blake3 == seal.manifest_blake3
            && self.seal.config_hash == seal.config_hash
    }

    /// The note about this file with this content.
    pub(crate) fn noted(&self, file: &SealedFile) -> Option<&Noted> {
        let noted = self.objects.get(&file.name);
        noted.filter(|noted| noted.blake3 == file.blake3)
    }

    /// Replaces the note about a file. A seal that another tool copied has no notes, and gets none.
    pub(crate) fn note(&mut self, file: &SealedFile, object: Noted) {
        if let Some(noted) = self.objects.get_mut(&file.name) {
            *noted = object;
        }
    }

    /// Notes when the scenario was sealed. In a folder that another tool copied, the time of `DONE.json` stands for it until then.
    pub(crate) fn keep_time(&mut self, sealed: SystemTime) {
        self.sealed_unix_ms.get_or_insert(unix_ms(sealed));
    }

    /// The manifest as one of the files to look for.
    fn manifest(&self) -> SealedFile {
        manifest_file(&self.seal)
    }

    /// Size of a file, if it is known without reading the file.
    fn bytes(&self, file: &SealedFile) -> Option<u64> {
        let noted = self.noted(file).map(|noted| noted.bytes);
        noted.or_else(|| self.seal.video_bytes.get(&file.name).copied())
    }
}

impl FoundSeal {
    /// The time at which the scenario was sealed, or if unknown, at which the seal was sent.
    pub(crate) fn sealed(&self) -> SystemTime {
        let noted = self.stored.as_ref().ok().and_then(StoredSeal::sealed);
        noted.unwrap_or(self.modified)
    }
}

/// BLAKE3 hash of all fields of a `DONE.json` except the checksum, including the fields of other versions, in the order of their names.
fn checksum(text: &[u8]) -> serde_json::Result<String> {
    let mut fields: BTreeMap<String, Value> = serde_json::from_slice(text)?;
    fields.remove(CHECKSUM);
    Ok(blake3::hash(&serde_json::to_vec(&fields)?).to_string())
}

/// Milliseconds since 1970: the resolution at which two seals are compared.
pub(crate) fn unix_ms(time: SystemTime) -> u64 {
    let since_1970 = time.duration_since(SystemTime::UNIX_EPOCH);
    since_1970.map_or(0, |since| {
        u64::try_from(since.as_millis()).unwrap_or(u64::MAX)
    })
}

/// The manifest that a seal names, as a file.
pub(crate) fn manifest_file(seal: &Seal) -> SealedFile {
    SealedFile {
        name: MANIFEST.into(),
        blake3: seal.manifest_blake3.clone(),
    }
}

impl CorpusStore {
    /// The state of a scenario. `seen` are its objects from a listing, if there is one; damage is concluded only from a listing that
    /// is younger than the seal.
    pub fn committed_state<'a>(
        &'a self,
        id: &'a str,
        seen: Option<&'a Objects>,
    ) -> BoxFuture<'a, Result<Committed>> {
        Box::pin(async move {
            let Some(found) = self.found_seal(id).await? else {
                return Ok(Committed::No);
            };
            let stored = match found.stored {
                Ok(stored) => stored,
                Err(fault) => return Ok(Committed::Damaged(fault.into())),
            };
            if let Some(seen) = seen
                && self.faults(id, &stored, seen).await?.is_empty()
            {
                return Ok(Committed::Whole(stored.seal));
            }
            let there = self.objects(id).await?;
            let faults = self.faults(id, &stored, &there).await?;
            Ok(if faults.is_empty() {
                Committed::Whole(stored.seal)
            } else {
                Committed::Damaged(StoredFaults(faults))
            })
        })
    }

    /// A sealed file of a committed scenario, if it is there.
    ///
    /// # Errors
    /// It is not as it was sealed.
    pub fn sealed_file<'a>(
        &'a self,
        id: &'a str,
        name: &'a str,
    ) -> BoxFuture<'a, Result<Option<Vec<u8>>>> {
        Box::pin(async move {
            let found = self.found_seal(id).await?;
            let stored = found.and_then(|found| found.stored.ok());
            let noted = stored.as_ref().and_then(|stored| stored.objects.get(name));
            let Some(noted) = noted else {
                return self.read(&scenario_file(id, name)).await;
            };
            let file = SealedFile {
                name: name.to_owned(),
                blake3: noted.blake3.clone(),
            };
            let mut content = None;
            for object in [content_name(&file), file.name] {
                if content.is_none() {
                    content = self.read(&scenario_file(id, &object)).await?;
                }
            }
            let is_other = |content: &Vec<u8>| blake3::hash(content).to_string() != noted.blake3;
            if content.as_ref().is_some_and(is_other) {
                let file = name.to_owned();
                return Err(self.faulty(id, StoredFault::OtherContent { file }));
            }
            Ok(content)
        })
    }

    /// The seal of a scenario with what the store notes about it, damaged or not.
    pub(crate) async fn found_seal(&self, id: &str) -> Result<Option<FoundSeal>> {
        let Some((text, object)) = self.read_object(&scenario_file(id, DONE)).await? else {
            return Ok(None);
        };
        Ok(Some(FoundSeal {
            stored: StoredSeal::parse(&text),
            modified: object.last_modified.into(),
            version: UpdateVersion {
                e_tag: object.e_tag,
                version: object.version,
            },
        }))
    }

    /// Faults of a committed scenario: files that are missing from a listing or differ from what was sent.
    pub(crate) async fn faults(
        &self,
        id: &str,
        stored: &StoredSeal,
        there: &Objects,
    ) -> Result<Vec<StoredFault>> {
        let files = if stored.objects.is_empty() {
            match self.their_files(id, stored, there).await? {
                Ok(files) => files,
                Err(fault) => return Ok(vec![fault]),
            }
        } else {
            let noted = stored.objects.iter();
            noted
                .map(|(name, noted)| SealedFile {
                    name: name.clone(),
                    blake3: noted.blake3.clone(),
                })
                .collect()
        };
        let mut faults = Vec::new();
        for file in &files {
            faults.extend(self.fault(id, file, stored, there).await?);
        }
        Ok(faults)
    }

    /// The fault of the object of one sealed file, if any.
    pub(crate) async fn fault(
        &self,
        id: &str,
        file: &SealedFile,
        stored: &StoredSeal,
        there: &Objects,
    ) -> Result<Option<StoredFault>> {
        let e_tag = stored.noted(file).and_then(|noted| noted.e_tag.as_deref());
        let whole = self.whole_object(id, file, stored.bytes(file), e_tag, there);
        Ok(whole.await?.err())
    }

    /// The object of a file in a listing if it has the file's content; else what is wrong with it. Size and ETag decide where they
    /// are known, else the hash that the store has with the object.
    pub(crate) async fn whole_object(
        &self,
        id: &str,
        file: &SealedFile,
        bytes: Option<u64>,
        e_tag: Option<&str>,
        there: &Objects,
    ) -> Result<std::result::Result<Noted, StoredFault>> {
        let name = || file.name.clone();
        let Some((object, info)) = there.locate(file) else {
            return Ok(Err(StoredFault::Missing { file: name() }));
        };
        if let Some(expected_bytes) = bytes.filter(|bytes| *bytes != info.bytes) {
            return Ok(Err(StoredFault::OtherSize {
                file: name(),
                found_bytes: info.bytes,
                expected_bytes,
            }));
        }
        let is_same =
            |noted: &str| info.e_tag.as_deref().map(plain_e_tag) == Some(plain_e_tag(noted));
        if !e_tag.is_some_and(is_same)
            && self.hash_of(&scenario_file(id, &object)).await?.as_ref() != Some(&file.blake3)
        {
            return Ok(Err(StoredFault::OtherContent { file: name() }));
        }
        Ok(Ok(Noted {
            blake3: file.blake3.clone(),
            bytes: info.bytes,
            e_tag: info.e_tag.clone(),
        }))
    }

    /// The files that the manifest of a committed scenario lists, and the manifest; or why it cannot be used.
    pub(crate) async fn their_files(
        &self,
        id: &str,
        stored: &StoredSeal,
        there: &Objects,
    ) -> Result<std::result::Result<Vec<SealedFile>, StoredFault>> {
        Ok(self
            .manifest(id, stored, there)
            .await?
            .map(|(_, mut files)| {
                files.push(stored.manifest());
                files
            }))
    }

    /// The manifest of a committed scenario with the files that it lists; or why it cannot be used.
    pub(crate) async fn manifest(
        &self,
        id: &str,
        stored: &StoredSeal,
        there: &Objects,
    ) -> Result<std::result::Result<(String, Vec<SealedFile>), StoredFault>> {
        let missing = StoredFault::Missing {
            file: MANIFEST.into(),
        };
        let Some((object, _)) = there.locate(&stored.manifest()) else {
            return Ok(Err(missing));
        };
        let Some(text) = self.read(&scenario_file(id, &object)).await? else {
            return Ok(Err(missing));
        };
        let Ok(text) = String::from_utf8(text) else {
            return Ok(Err(StoredFault::NotText));
        };
        let files = seal::sealed_files(&text, &stored.seal);
        Ok(files.map(|files| (text, files)).map_err(StoredFault::from))
    }

    /// A scenario of the store that is not as it was sealed.
    pub(crate) fn faulty(&self, id: &str, faults: impl Into<StoredFaults>) -> StoreError {
        StoreError::Faulty {
            place: format!("{}/scenarios/{id}", self.name()),
            faults: faults.into(),
        }
    }

    /// A scenario of the store that cannot be used.
    pub(crate) fn damaged(&self, id: &str, fault: impl std::fmt::Display) -> StoreError {
        StoreError::Damaged {
            place: format!("{}/scenarios/{id}", self.name()),
            message: fault.to_string(),
        }
    }
}

impl Objects {
    /// Name and attributes of the object of a file: the one with the file's content in its name, else the one of the plain name.
    pub(crate) fn locate(
        &self,
        file: &SealedFile,
    ) -> Option<(String, &crate::corpus_store::ObjectInfo)> {
        let names = [content_name(file), file.name.clone()];
        names
            .into_iter()
            .find_map(|name| Some((self.0.get(&name)?, name)))
            .map(|(info, name)| (name, info))
    }
}

/// An ETag without what stores add in some answers and not in others.
fn plain_e_tag(e_tag: &str) -> &str {
    e_tag.trim_start_matches("W/").trim_matches('"')
}
