//! Scenarios in a store: object names, seal, and wholeness.
//!
//! Object names contain the content (`frames.parquet` is `frames.<hash>.parquet`), so no upload, however late it arrives, replaces other
//! content. Folders that other tools copied have the plain names; readers take those if there is no other.
//!
//! `DONE.json` is the folder's seal with notes about the objects (hash, size, ETag) and a checksum. So one listing
//! shows damage: an object is whole if size and noted ETag agree. With a different ETag its content is read. With no note, the hash in its
//! metadata counts.

use std::collections::BTreeMap;
use std::path::Path;

use dataset::corpus::seal::{self, DONE, MANIFEST, Seal, SealedFile};
use dataset::files::json_file::json_bytes;
use futures_util::{StreamExt, TryStreamExt, stream};
use object_store::ObjectMeta;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::client::{Connection, ObjectInfo, Objects, scenario_file};
use crate::error::{Fault, Faults, Result, StoreError};

/// Hash digits in a name: 128 bits. Object readers compare the whole hash.
const DIGITS: usize = 32;
/// Longest part in a sealed name: file systems allow 255 bytes, and objects have a hash in their names.
const MAX_PART_BYTES: usize = 200;
/// Small requests in parallel.
const QUESTIONS_AT_ONCE: usize = 16;
/// The field in `DONE.json` that the checksum does not cover.
const CHECKSUM: &str = "seal_blake3";

/// `DONE.json` in a store.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct StoredSeal {
    #[serde(flatten)]
    pub(crate) seal: Seal,
    /// Notes about all sealed files and the manifest, by file name. Empty if a different tool copied the folder.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) objects: BTreeMap<String, Noted>,
    /// BLAKE3 hash of all other fields. Missing if a different tool copied the folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    seal_blake3: Option<String>,
}

/// An object as its upload noted it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Noted {
    pub(crate) blake3: String,
    pub(crate) bytes: u64,
    /// The store's tag of this content.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) e_tag: Option<String>,
}

/// `DONE.json` as read.
#[derive(Debug)]
pub(crate) struct FoundSeal {
    /// The seal, or its fault.
    pub(crate) stored: std::result::Result<StoredSeal, Fault>,
    /// The version to replace.
    pub(crate) version: ObjectMeta,
}

/// Scenario state in a store.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Committed {
    /// It has no seal.
    No,
    /// All its objects are whole.
    Whole(Seal),
    /// It has a seal, but not all that was sealed.
    Damaged(Faults),
}

/// Knowledge about an object's content besides its name.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Evidence<'a> {
    /// From its upload's note, or only the size.
    Note {
        bytes: Option<u64>,
        e_tag: Option<&'a str>,
    },
    /// No knowledge: the content is read.
    Content,
}

impl StoredSeal {
    pub(crate) fn new(seal: Seal, objects: BTreeMap<String, Noted>) -> Self {
        Self {
            seal,
            objects,
            seal_blake3: None,
        }
    }

    /// Reads a `DONE.json`, which must match its checksum, if it has one.
    fn parse(text: &[u8]) -> std::result::Result<Self, Fault> {
        let bad =
            |error: serde_json::Error| Fault::of(DONE, format!("is not a valid seal: {error}"));
        let stored: Self = serde_json::from_slice(text).map_err(bad)?;
        match &stored.seal_blake3 {
            Some(expected) if checksum(text).map_err(bad)? != *expected => Err(Fault::of(
                DONE,
                "was changed after it was written: its content does not match its seal_blake3",
            )),
            _ => Ok(stored),
        }
    }

    /// Content of `DONE.json`, with a checksum.
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

    /// The note about this file with this content.
    pub(crate) fn noted(&self, file: &SealedFile) -> Option<&Noted> {
        let noted = self.objects.get(&file.name);
        noted.filter(|noted| noted.blake3 == file.blake3)
    }

    /// Noted size and ETag, as far as they are known.
    fn evidence(&self, file: &SealedFile) -> Evidence<'_> {
        let sealed = || Evidence::Note {
            bytes: self.seal.video_bytes.get(&file.name).copied(),
            e_tag: None,
        };
        self.noted(file).map_or_else(sealed, Noted::evidence)
    }
}

impl Noted {
    pub(crate) fn evidence(&self) -> Evidence<'_> {
        Evidence::Note {
            bytes: Some(self.bytes),
            e_tag: self.e_tag.as_deref(),
        }
    }
}

/// BLAKE3 hash of all fields of a `DONE.json` except the checksum, including those of other versions, in the order of their names.
fn checksum(text: &[u8]) -> serde_json::Result<String> {
    let mut fields: BTreeMap<String, Value> = serde_json::from_slice(text)?;
    fields.remove(CHECKSUM);
    Ok(blake3::hash(&serde_json::to_vec(&fields)?).to_string())
}

/// The manifest that a seal names, as a file.
pub(crate) fn manifest_file(seal: &Seal) -> SealedFile {
    SealedFile {
        name: MANIFEST.into(),
        blake3: seal.manifest_blake3.clone(),
    }
}

/// Rejects names that files cannot have beside a seal: they would stand for the seal itself, or could not be written.
pub(crate) fn check_names(files: &[SealedFile]) -> std::result::Result<(), Fault> {
    for SealedFile { name, .. } in files {
        let is_of_seal = [DONE, MANIFEST].contains(&name.as_str());
        let is_temporary = name.ends_with(".new") || name.ends_with(".tmp");
        let is_long = name.split('/').any(|part| part.len() > MAX_PART_BYTES);
        let is_folder = |other: &SealedFile| {
            other.name != *name && Path::new(&other.name).starts_with(Path::new(name))
        };
        if is_of_seal || is_temporary || is_long || files.iter().any(is_folder) {
            let name: String = name.chars().take(MAX_PART_BYTES).collect();
            return Err(Fault::of(
                MANIFEST,
                format!("names {name}, which no file of a scenario can be called"),
            ));
        }
    }
    Ok(())
}

/// Name of the object with this file's content, within the scenario.
pub(crate) fn content_name(file: &SealedFile) -> String {
    let digits = file.blake3.get(..DIGITS).unwrap_or(&file.blake3);
    let (folder, name) = split_folder(&file.name);
    match name.rsplit_once('.') {
        Some((stem, ending)) => format!("{folder}{stem}.{digits}.{ending}"),
        None => format!("{folder}{name}.{digits}"),
    }
}

/// File name for an object, whose name contains the content or not.
pub(crate) fn file_name(object: &str) -> String {
    let (folder, name) = split_folder(object);
    let is_hash =
        |part: &str| part.len() == DIGITS && part.bytes().all(|digit| digit.is_ascii_hexdigit());
    let mut parts: Vec<&str> = name.split('.').collect();
    let hash = parts.iter().rposition(|part| is_hash(part));
    // Last, or before the ending; a name consists of more than a hash.
    if let Some(place) = hash.filter(|place| *place > 0 && place + 2 >= parts.len()) {
        parts.remove(place);
    }
    format!("{folder}{}", parts.join("."))
}

/// The folder with its slash, and the name within.
fn split_folder(name: &str) -> (&str, &str) {
    name.split_at(name.rfind('/').map_or(0, |slash| slash + 1))
}

/// True if two ETags agree, apart from marks that stores add in some answers and not in others.
fn are_same(one: Option<&str>, other: Option<&str>) -> bool {
    let plain = |e_tag: &str| -> String {
        let e_tag = e_tag.trim_start_matches("W/");
        e_tag.trim_matches('"').to_owned()
    };
    one.is_some() && one.map(plain) == other.map(plain)
}

impl Objects {
    /// A file's object: the one with the content in the name, else the one with the plain name.
    pub(crate) fn locate(&self, file: &SealedFile) -> Option<(String, &ObjectInfo)> {
        let names = [content_name(file), file.name.clone()];
        let mut found = names.into_iter();
        found.find_map(|name| self.0.get(&name).map(|info| (name, info)))
    }

    /// True if a file's object is as its upload noted it.
    pub(crate) fn has(&self, file: &SealedFile, noted: &Noted) -> bool {
        self.locate(file).is_some_and(|(_, info)| {
            info.bytes == noted.bytes
                && (noted.e_tag.is_none()
                    || are_same(noted.e_tag.as_deref(), info.e_tag.as_deref()))
        })
    }
}

impl Connection<'_> {
    /// A scenario's state.
    pub async fn state(&self, id: &str) -> Result<Committed> {
        let Some(found) = self.found_seal(id).await? else {
            return Ok(Committed::No);
        };
        match self.whole(id, &found).await {
            Ok((stored, _)) => Ok(Committed::Whole(stored.seal)),
            Err(StoreError::Faulty { faults, .. }) => Ok(Committed::Damaged(faults)),
            Err(error) => Err(error),
        }
    }

    /// States of several scenarios; those without a seal are left out.
    pub async fn states(
        &self,
        ids: impl IntoIterator<Item = String>,
    ) -> Result<BTreeMap<String, Committed>> {
        let committed = self.listing().await?.committed();
        let ids = ids.into_iter().filter(|id| committed.contains(id));
        let states = ids.map(|id| async move {
            let state = self.state(&id).await?;
            Ok::<_, StoreError>((id, state))
        });
        stream::iter(states)
            .buffer_unordered(QUESTIONS_AT_ONCE)
            .try_filter(|(_, state)| std::future::ready(*state != Committed::No))
            .try_collect()
            .await
    }

    /// A committed scenario's sealed file, if it is there.
    ///
    /// # Errors
    /// It is not as it was sealed.
    pub async fn sealed_file(&self, id: &str, name: &str) -> Result<Option<Vec<u8>>> {
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
        let mut content = self.read(&scenario_file(id, &content_name(&file))).await?;
        if content.is_none() {
            content = self.read(&scenario_file(id, name)).await?;
        }
        match content {
            Some(content) if seal::hash_bytes(&content) != noted.blake3 => {
                Err(self.faulty(id, Fault::of(name, OTHER_CONTENT)))
            }
            content => Ok(content),
        }
    }

    pub(crate) async fn found_seal(&self, id: &str) -> Result<Option<FoundSeal>> {
        let found = self.read_object(&scenario_file(id, DONE)).await?;
        Ok(found.map(|(text, version)| FoundSeal {
            stored: StoredSeal::parse(&text),
            version,
        }))
    }

    /// Seal and objects, if all objects are whole.
    pub(crate) async fn whole(&self, id: &str, found: &FoundSeal) -> Result<(StoredSeal, Objects)> {
        let stored = (found.stored.clone()).map_err(|fault| self.faulty(id, fault))?;
        let there = self.objects(id).await?;
        match self.faults(id, &stored, &there).await? {
            faults if faults.is_empty() => Ok((stored, there)),
            faults => Err(self.faulty(id, Faults(faults))),
        }
    }

    async fn faults(&self, id: &str, stored: &StoredSeal, there: &Objects) -> Result<Vec<Fault>> {
        match self.files_of(id, stored, there).await? {
            Ok(files) => self.faults_of(id, &files, stored, there).await,
            Err(fault) => Ok(vec![fault]),
        }
    }

    /// Sealed files and the manifest, as the seal notes them or else the manifest lists them; or the manifest's fault.
    pub(crate) async fn files_of(
        &self,
        id: &str,
        stored: &StoredSeal,
        there: &Objects,
    ) -> Result<std::result::Result<Vec<SealedFile>, Fault>> {
        if stored.objects.is_empty() {
            let listed = self.manifest(id, stored, there).await?;
            return Ok(listed.map(|(_, files)| files));
        }
        let noted = stored.objects.iter();
        let files = noted.map(|(name, noted)| SealedFile {
            name: name.clone(),
            blake3: noted.blake3.clone(),
        });
        Ok(Ok(files.collect()))
    }

    /// Faults of the objects of sealed files.
    pub(crate) async fn faults_of(
        &self,
        id: &str,
        files: &[SealedFile],
        stored: &StoredSeal,
        there: &Objects,
    ) -> Result<Vec<Fault>> {
        let mut faults = Vec::new();
        for file in files {
            let looked = self.look(id, file, stored.evidence(file), there);
            faults.extend(looked.await?.err());
        }
        Ok(faults)
    }

    /// Note about a file's object, if the object is whole; else the fault.
    pub(crate) async fn look(
        &self,
        id: &str,
        file: &SealedFile,
        evidence: Evidence<'_>,
        there: &Objects,
    ) -> Result<std::result::Result<Noted, Fault>> {
        let Some((object, info)) = there.locate(file) else {
            return Ok(Err(Fault::missing(&file.name)));
        };
        let (bytes, e_tag, mut reads) = match evidence {
            Evidence::Note { bytes, e_tag } => (bytes, e_tag, e_tag.is_some()),
            Evidence::Content => (None, None, true),
        };
        if let Some(expected) = bytes.filter(|bytes| *bytes != info.bytes) {
            let difference = format!("has {} bytes, expected {expected}", info.bytes);
            return Ok(Err(Fault::of(&file.name, difference)));
        }
        reads |= self.store.folder.is_some();
        if !are_same(e_tag, info.e_tag.as_deref())
            && self
                .hash_of(&scenario_file(id, &object), reads)
                .await?
                .as_ref()
                != Some(&file.blake3)
        {
            return Ok(Err(Fault::of(&file.name, OTHER_CONTENT)));
        }
        Ok(Ok(Noted {
            blake3: file.blake3.clone(),
            bytes: info.bytes,
            e_tag: info.e_tag.clone(),
        }))
    }

    /// Manifest, and the files that it lists with itself; or its fault.
    pub(crate) async fn manifest(
        &self,
        id: &str,
        stored: &StoredSeal,
        there: &Objects,
    ) -> Result<std::result::Result<(String, Vec<SealedFile>), Fault>> {
        let manifest = manifest_file(&stored.seal);
        let text = match there.locate(&manifest) {
            Some((object, _)) => self.read(&scenario_file(id, &object)).await?,
            None => None,
        };
        let Some(text) = text else {
            return Ok(Err(Fault::missing(MANIFEST)));
        };
        let Ok(text) = String::from_utf8(text) else {
            return Ok(Err(Fault::of(MANIFEST, "is not UTF-8")));
        };
        let mut files = match seal::sealed_files(&text, &stored.seal) {
            Ok(files) => files,
            Err(bad) => {
                return Ok(Err(Fault {
                    file: MANIFEST.into(),
                    message: bad.to_string(),
                }));
            }
        };
        Ok(check_names(&files).map(|()| {
            files.push(manifest);
            (text, files)
        }))
    }

    pub(crate) fn faulty(&self, id: &str, faults: impl Into<Faults>) -> StoreError {
        StoreError::Faulty {
            place: format!("{}/scenarios/{id}", self.store.name()),
            faults: faults.into(),
        }
    }
}

/// Difference if an object's content is not the sealed one.
pub(crate) const OTHER_CONTENT: &str = "has another content: its hash differs";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_content_is_part_of_the_name_and_the_ending_stays() {
        let blake3 = "0123456789abcdef".repeat(4);
        let digits = &blake3[..DIGITS];
        for (file, object) in [
            ("frames.parquet", format!("frames.{digits}.parquet")),
            ("views/left.mp4", format!("views/left.{digits}.mp4")),
            ("a.b/notes", format!("a.b/notes.{digits}")),
            ("MANIFEST.b3", format!("MANIFEST.{digits}.b3")),
        ] {
            let sealed = SealedFile {
                name: file.into(),
                blake3: blake3.clone(),
            };
            assert_eq!(content_name(&sealed), object);
            assert_eq!(file_name(&object), file);
            assert_eq!(file_name(file), file);
        }
    }

    #[test]
    fn names_that_stand_for_the_seal_or_cannot_be_written_are_refused() {
        let check = |names: &[&str]| {
            let file = |name: &&str| SealedFile {
                name: (*name).to_owned(),
                blake3: String::new(),
            };
            check_names(&names.iter().map(file).collect::<Vec<_>>())
        };
        assert_eq!(
            check(&["frames.parquet", "views/left.mp4", "notes.txt"]),
            Ok(())
        );
        let long = "a".repeat(MAX_PART_BYTES + 1);
        for names in [
            &["DONE.json.new"][..],
            &["DONE.json"],
            &["frames.parquet.tmp"],
            &["views", "views/left.mp4"],
            &[&long],
        ] {
            assert_eq!(check(names).unwrap_err().file, MANIFEST, "{names:?}");
        }
    }
}
