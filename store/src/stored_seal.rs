//! The seal of a scenario in a store, and the comparison of the scenario with a listing.
//!
//! `DONE.json` has the content of a folder's seal, and notes what the upload has sent: hash, size and ETag of each object. So one
//! listing shows whether all of it is still there. The hash of an object with another ETag, or none noted, is looked up.

use std::collections::BTreeMap;
use std::time::{Duration, SystemTime};

use dataset::seal::{self, DONE, MANIFEST, Seal, SealedFile};
use futures_util::future::BoxFuture;
use object_store::UpdateVersion;
use serde::{Deserialize, Serialize};

use crate::content_name::content_name;
use crate::corpus_store::{CorpusStore, scenario_file};
use crate::error::{Result, StoreError};
use crate::listing::Objects;

/// `DONE.json` in a store.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct StoredSeal {
    #[serde(flatten)]
    pub(crate) seal: Seal,
    /// When the scenario was sealed in its folder, by that machine's clock, in milliseconds since 1970. Missing in stores of earlier
    /// versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    sealed_unix_ms: Option<u64>,
    /// The objects of all sealed files and of the manifest, by the names of the files. Empty in stores of earlier versions.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) objects: BTreeMap<String, Noted>,
}

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
    pub(crate) stored: std::result::Result<StoredSeal, String>,
    /// The version to replace.
    pub(crate) version: UpdateVersion,
    /// When it was written, by the store's clock.
    modified: SystemTime,
}

/// State of a scenario in a store.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Committed {
    /// It has no seal.
    No,
    /// All its objects are there.
    Whole(Seal),
    /// It has a seal, but not all that was sealed, with the faults.
    Damaged(String),
}

impl StoredSeal {
    pub(crate) fn new(seal: Seal, sealed: SystemTime, objects: BTreeMap<String, Noted>) -> Self {
        Self {
            seal,
            sealed_unix_ms: Some(unix_ms(sealed)),
            objects,
        }
    }

    /// When the scenario was sealed in its folder, if noted.
    pub(crate) fn sealed(&self) -> Option<SystemTime> {
        let since_1970 = Duration::from_millis(self.sealed_unix_ms?);
        SystemTime::UNIX_EPOCH.checked_add(since_1970)
    }

    /// Whether it seals the same content. Seals of earlier versions lack the sizes of the videos.
    pub(crate) fn is_of(&self, seal: &Seal) -> bool {
        self.seal.manifest_blake3 == seal.manifest_blake3
            && self.seal.config_hash == seal.config_hash
    }

    /// The note about this file with this content.
    pub(crate) fn noted(&self, file: &SealedFile) -> Option<&Noted> {
        let noted = self.objects.get(&file.name);
        noted.filter(|noted| noted.blake3 == file.blake3)
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
    /// When the scenario was sealed, else when that was sent.
    pub(crate) fn sealed(&self) -> SystemTime {
        let noted = self.stored.as_ref().ok().and_then(StoredSeal::sealed);
        noted.unwrap_or(self.modified)
    }
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
                Err(fault) => return Ok(Committed::Damaged(fault)),
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
                Committed::Damaged(faults.join("; "))
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
                return Err(self.damaged(id, format!("{name} does not match its seal")));
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
            stored: serde_json::from_slice(&text)
                .map_err(|error| format!("{DONE} is not a valid seal: {error}")),
            modified: object.last_modified.into(),
            version: UpdateVersion {
                e_tag: object.e_tag,
                version: object.version,
            },
        }))
    }

    /// What of a committed scenario is not in a listing as it was sent.
    pub(crate) async fn faults(
        &self,
        id: &str,
        stored: &StoredSeal,
        there: &Objects,
    ) -> Result<Vec<String>> {
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

    /// What is wrong with the object of one sealed file.
    pub(crate) async fn fault(
        &self,
        id: &str,
        file: &SealedFile,
        stored: &StoredSeal,
        there: &Objects,
    ) -> Result<Option<String>> {
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
    ) -> Result<std::result::Result<Noted, String>> {
        let name = &file.name;
        let Some((object, info)) = there.locate(file) else {
            return Ok(Err(format!("{name} is missing")));
        };
        if let Some(bytes) = bytes.filter(|bytes| *bytes != info.bytes) {
            return Ok(Err(format!(
                "{name} has {} bytes, expected {bytes}",
                info.bytes
            )));
        }
        let is_same =
            |noted: &str| info.e_tag.as_deref().map(plain_e_tag) == Some(plain_e_tag(noted));
        if !e_tag.is_some_and(is_same)
            && self.hash_of(&scenario_file(id, &object)).await?.as_ref() != Some(&file.blake3)
        {
            return Ok(Err(format!("{name} has another content")));
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
    ) -> Result<std::result::Result<Vec<SealedFile>, String>> {
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
    ) -> Result<std::result::Result<(String, Vec<SealedFile>), String>> {
        let Some((object, _)) = there.locate(&stored.manifest()) else {
            return Ok(Err(format!("{MANIFEST} is missing")));
        };
        let Some(text) = self.read(&scenario_file(id, &object)).await? else {
            return Ok(Err(format!("{MANIFEST} is missing")));
        };
        let text = match String::from_utf8(text) {
            Ok(text) => text,
            Err(error) => return Ok(Err(format!("{MANIFEST}: {error}"))),
        };
        Ok(match seal::sealed_files(&text, &stored.seal) {
            Ok(files) => Ok((text, files)),
            Err(bad) => Err(bad.to_string()),
        })
    }

    /// A scenario of the store that is not as it was sealed.
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
    ) -> Option<(String, &crate::listing::ObjectInfo)> {
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
