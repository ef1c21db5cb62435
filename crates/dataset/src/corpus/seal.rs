//! Atomic commit of scenario folders, and of later changes.
//!
//! A folder is filled under a temporary name (`<id>.partial`), sealed (`MANIFEST.b3` with a BLAKE3 hash per file, in the format of `b3sum`,
//! and `DONE.json` with the manifest's hash), and then renamed. Later steps replace sealed files through [`replace_files`], holding the
//! scenario's claim: new files are written next to the old ones as `<name>.new`, the new seal last. `DONE.json.new` commits the change; all
//! that remains is renaming. Readers ([`crate::corpus::seal::sealed`]) see the complete old state before that moment and the complete new
//! one after it, and never write. If a process is killed or the disk fails, the next writer completes a committed change and drops an
//! uncommitted one. An error after the commit, e.g. from a sync, does not undo it: the files alone determine the state, and removing what
//! the new seal names would destroy the scenario.

pub mod sealed;

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::io;
use std::path::{Component, Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::corpus::claim::Claim;
use crate::error::{Error, Result};
use crate::files::corpus_names::{FILES, MODEL_FOLDERS};
use crate::files::file_name;
use crate::files::folder;
use crate::files::json_file::{read_json, write_atomically, write_json};
use crate::files::new_file::{TEMPORARY_SUFFIX, clear_leftovers, sync};
use crate::files::outside_file::{self, FileKind};
use crate::files::own_path::{own_path, refuse_link};
use sealed::{FileState, Sealed};

/// Hashes of all files in the folder.
pub const MANIFEST: &str = "MANIFEST.b3";
/// The seal itself.
pub const DONE: &str = "DONE.json";
const NEW_SUFFIX: &str = ".new";
const NEVER_FINISHED: &str = "DONE.json is missing: the folder was never finished";
/// Folder of the videos.
const VIDEOS: &str = "views/";

/// Content of `DONE.json`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Seal {
    /// Hash of the scenario's parameters, as in `scenario.json`.
    pub config_hash: String,
    /// BLAKE3 hash of `MANIFEST.b3`.
    pub manifest_blake3: String,
    /// Sizes of the videos by name, in bytes: a check that does not read them still detects a truncated one. Empty if there are no videos.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub video_bytes: BTreeMap<String, u64>,
}

/// A file that a manifest lists.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SealedFile {
    /// Name relative to the folder, with forward slashes.
    pub name: String,
    /// BLAKE3 hash in hexadecimal digits.
    pub blake3: String,
}

/// Reason why a manifest cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{MANIFEST} {0}")]
pub struct BadManifest(String);

/// The files that a manifest lists, if it matches `seal`.
pub fn sealed_files(
    manifest: &str,
    seal: &Seal,
) -> std::result::Result<Vec<SealedFile>, BadManifest> {
    if blake3::hash(manifest.as_bytes()).to_string() != seal.manifest_blake3 {
        return Err(BadManifest(format!("does not match the hash in {DONE}")));
    }
    files_in(manifest)
}

/// The files that a manifest lists. Each has one line; the folder of the videos contains no other files.
fn files_in(manifest: &str) -> std::result::Result<Vec<SealedFile>, BadManifest> {
    let mut files = Vec::new();
    let mut names = BTreeSet::new();
    for line in manifest.lines() {
        let bad = |fault: String| Err(BadManifest(fault));
        let Some((blake3, name)) = line.split_once("  ") else {
            return bad(format!("has a line that is not `hash  name`: {line}"));
        };
        // It becomes a path under the folder, and may come from anyone.
        if !is_within(Path::new(name)) {
            return bad(format!("names a file outside of the folder: {name}"));
        }
        if !names.insert(name) {
            return bad(format!("has two lines for {name}, expected one"));
        }
        if name.starts_with(VIDEOS) && view_of(name).is_none() {
            return bad(format!(
                "names {name}, expected only videos there: {VIDEOS}VIEW.mp4"
            ));
        }
        files.push(SealedFile {
            name: name.into(),
            blake3: blake3.into(),
        });
    }
    Ok(files)
}

/// A video's view, by its name within the folder.
pub(crate) fn view_of(name: &str) -> Option<&str> {
    let view = name.strip_prefix(VIDEOS)?.strip_suffix(".mp4")?;
    file_name::check(view).is_ok().then_some(view)
}

/// True if a name within the folder is a scenario file's.
pub fn is_scenario_file(name: &str) -> bool {
    FILES.contains(&name) || view_of(name).is_some()
}

/// True if a relative name stays within its folder.
pub fn is_within(name: &Path) -> bool {
    let mut parts = name.components().peekable();
    parts.peek().is_some() && parts.all(|part| matches!(part, Component::Normal(_)))
}

/// BLAKE3 hash of this content, in hexadecimal.
pub fn hash_bytes(content: &[u8]) -> String {
    blake3::hash(content).to_string()
}

/// BLAKE3 hash of the file, in hexadecimal digits.
pub fn hash_file(path: &Path) -> Result<String> {
    hash_opened(outside_file::open(path, FileKind::VIDEO)?, path)
}

/// Like [`hash_file`] for a sealed file's current content: a file that is far too large is rejected unread.
pub(crate) fn hash_sealed(name: &str, path: &Path) -> Result<String> {
    let kind = if name.starts_with(VIDEOS) {
        FileKind::VIDEO
    } else {
        FileKind::TABLE
    };
    hash_opened(outside_file::open(path, kind)?, path)
}

fn hash_opened(mut file: File, path: &Path) -> Result<String> {
    let mut hasher = blake3::Hasher::new();
    io::copy(&mut file, &mut hasher).map_err(Error::io("read", path))?;
    Ok(hasher.finalize().to_hex().to_string())
}

/// Seals a folder whose files are all written.
pub fn seal_folder(folder: &Path, config_hash: &str) -> Result<Seal> {
    // The content must be on disk before it is sealed, so that a power failure cannot undo it.
    let mut folders = BTreeSet::new();
    for name in files_of(folder)? {
        let path = folder.join(name);
        sync(&path)?;
        folders.extend(path.parent().map(Path::to_owned));
    }
    for folder in folders {
        sync(&folder)?;
    }
    let manifest = manifest_of(folder)?;
    files_in(&manifest).map_err(|bad| {
        Error::corpus(
            folder,
            format!("cannot be sealed because readers would reject it: {bad}"),
        )
    })?;
    write_atomically(&folder.join(MANIFEST), manifest.as_bytes())?;
    let seal = Seal {
        config_hash: config_hash.into(),
        manifest_blake3: blake3::hash(manifest.as_bytes()).to_string(),
        video_bytes: video_bytes(folder)?,
    };
    write_json(&folder.join(DONE), &seal)?;
    Ok(seal)
}

/// Video sizes in the folder, by name.
fn video_bytes(folder: &Path) -> Result<BTreeMap<String, u64>> {
    let videos = files_of(folder)?
        .into_iter()
        .filter(|name| name.starts_with(VIDEOS));
    videos
        .map(|name| {
            let path = folder.join(&name);
            let about = fs::metadata(&path).map_err(Error::io("read the size of", &path))?;
            Ok((name, about.len()))
        })
        .collect()
}

/// Renames a sealed folder to its final name, durably.
pub fn commit_folder(partial: &Path, committed: &Path) -> Result<()> {
    fs::rename(partial, committed).map_err(Error::io("rename into place", committed))?;
    sync(committed.parent().unwrap_or(committed))
}

/// A folder's seal, if it has one: a committed change's seal takes precedence.
pub fn read_seal(folder: &Path) -> Result<Option<Seal>> {
    // In this order: the first is renamed to the second.
    for path in [decision(folder), folder.join(DONE)] {
        refuse_link(&path)?;
        if let Some(seal) = Error::if_there(read_json(&path, "seal"))? {
            return Ok(Some(seal));
        }
    }
    Ok(None)
}

/// Returns true for a sealed folder, intact or damaged.
pub fn is_at(folder: &Path) -> bool {
    [DONE, MANIFEST]
        .iter()
        .all(|name| folder.join(name).is_file())
}

/// Everything in a sealed folder that does not match its seal, as text; empty if it is intact.
pub fn faults(folder: &Path) -> Result<Vec<String>> {
    while_it_stays(folder, || {
        let sealed = match Sealed::read(folder) {
            Ok(sealed) => sealed,
            Err(error) if error.is_bad_content() => return Ok(vec![error.to_string()]),
            Err(error) => return Err(error),
        };
        let Some(sealed) = sealed else {
            return Ok(vec![NEVER_FINISHED.into()]);
        };
        let mut faults = faults_of_listed(&sealed, |_| true);
        for name in files_of(folder)? {
            if sealed.hash_of(&name).is_none() {
                faults.push(format!("{name} is not listed in {MANIFEST}"));
            }
        }
        Ok(faults)
    })
}

/// Missing or changed files, without reading the videos: only their sizes are compared: fast enough to run before every run.
pub fn faults_besides_videos(folder: &Path) -> Result<Vec<String>> {
    while_it_stays(folder, || {
        let Some(sealed) = Sealed::read(folder)? else {
            return Ok(vec![NEVER_FINISHED.into()]);
        };
        Ok(faults_of_listed(&sealed, |name| !name.starts_with(VIDEOS)))
    })
}

/// Missing files and videos of a wrong size: found by reading the seal alone.
pub fn faults_at_a_glance(folder: &Path) -> Result<Vec<String>> {
    while_it_stays(folder, || {
        let Some(sealed) = Sealed::read(folder)? else {
            return Ok(vec![NEVER_FINISHED.into()]);
        };
        // Until a committed change is completed, a file may only have its new name, and is found by its hash.
        let is_unsettled = is_unsettled(folder);
        Ok(faults_of_listed(&sealed, |name| {
            is_unsettled && !name.starts_with(VIDEOS)
        }))
    })
}

/// The result of `look`, once the folder did not change during the check.
fn while_it_stays(folder: &Path, look: impl Fn() -> Result<Vec<String>>) -> Result<Vec<String>> {
    for _ in 0..sealed::ATTEMPTS {
        let before = read_seal(folder).ok();
        let found = look();
        let is_settled = matches!(&found, Ok(faults) if faults.is_empty());
        if is_settled || read_seal(folder).ok() == before {
            return found;
        }
    }
    Err(Error::Changing {
        path: folder.to_owned(),
    })
}

/// Faults of the files that the manifest lists.
fn faults_of_listed(sealed: &Sealed, is_hashed: impl Fn(&str) -> bool) -> Vec<String> {
    let fault = |file: &SealedFile| {
        let name = &file.name;
        if let Ok(Some((bytes, sealed_bytes))) = sealed.other_size(name) {
            return Some(format!(
                "{name} does not match its seal: it has {bytes} bytes, expected {sealed_bytes}"
            ));
        }
        let found = if is_hashed(name) {
            sealed.find(name, &file.blake3)
        } else {
            sealed.find_unread(name)
        };
        match found {
            Ok(FileState::Whole(_)) => None,
            Ok(FileState::Missing) => Some(format!("{name} is missing")),
            Ok(FileState::Other) => Some(format!(
                "{name} does not match its seal: its hash differs from {MANIFEST}"
            )),
            Err(error) => Some(error.to_string()),
        }
    };
    sealed.files().iter().filter_map(fault).collect()
}

/// Replaces or adds sealed files as one change: `write` receives the path for each file.
pub fn replace_files(
    claim: &Claim,
    folder: &Path,
    names: &[&str],
    mut write: impl FnMut(&str, &Path) -> Result<()>,
) -> Result<()> {
    settle(claim, folder)?;
    let sealed = Sealed::read(folder)?.ok_or_else(|| {
        Error::corpus(
            folder,
            format!("has no {DONE}; generate the scenario first"),
        )
    })?;
    let change = || {
        for name in names {
            let path = with_new_suffix(&folder.join(name));
            write(name, &path)?;
            sync(&path)?;
        }
        let manifest = manifest_with(&sealed, names)?;
        write_atomically(
            &with_new_suffix(&folder.join(MANIFEST)),
            manifest.as_bytes(),
        )?;
        let seal = Seal {
            manifest_blake3: blake3::hash(manifest.as_bytes()).to_string(),
            ..sealed.seal().clone()
        };
        // This file commits the change.
        write_json(&decision(folder), &seal)
    };
    let decided = { change }();
    // An error may also come after the rename that commits the change, from the sync of the folder. If it is unknown whether the rename
    // happened, all files stay.
    if decided.is_err() && matches!(decision(folder).try_exists(), Ok(false)) {
        drop_undecided(folder, names.iter().copied());
    }
    decided?;
    complete(folder)
}

/// Completes a committed change, drops an uncommitted one.
pub fn settle(_claim: &Claim, folder: &Path) -> Result<()> {
    clear_leftovers(folder);
    if decision(folder)
        .try_exists()
        .map_err(Error::io("look for", &decision(folder)))?
    {
        // The commit may not be durable yet, and must be before the files that it replaces are gone.
        sync(folder)?;
    }
    complete(folder)
}

/// Renames a committed change's files, drops an uncommitted one.
fn complete(folder: &Path) -> Result<()> {
    let Some(sealed) = Sealed::read(folder)? else {
        return Ok(());
    };
    let decided = decision(folder);
    if decided.exists() {
        let manifest = [(MANIFEST, sealed.seal().manifest_blake3.as_str())];
        let files = sealed.files().iter();
        let listed = files.map(|file| (file.name.as_str(), file.blake3.as_str()));
        for (name, blake3) in listed.chain(manifest) {
            let path = folder.join(name);
            let new = with_new_suffix(&path);
            if new.exists() && hash_sealed(name, &new)? == blake3 {
                fs::rename(&new, &path).map_err(Error::io("rename into place", &path))?;
            }
        }
        sync(folder)?;
        // The seal is renamed last: until then, this can be repeated.
        let path = folder.join(DONE);
        fs::rename(&decided, &path).map_err(Error::io("rename into place", &path))?;
        sync(folder)?;
    }
    drop_undecided(folder, sealed.files().iter().map(|file| file.name.as_str()));
    Ok(())
}

/// Removes only the `.new` files that a change would have created: a user's notes may also end in `.new`.
fn drop_undecided<'a>(folder: &Path, names: impl Iterator<Item = &'a str>) {
    for name in names.chain([MANIFEST]) {
        // Leftovers do no harm: readers go by the hash, and the next change overwrites them.
        let _ = fs::remove_file(with_new_suffix(&folder.join(name)));
    }
}

/// Current path of a file in the folder: `<name>.new` if a change is committed but not renamed yet.
///
/// # Errors
/// It is a symbolic link.
pub fn current_path(folder: &Path, name: &str) -> Result<PathBuf> {
    let path = own_path(folder, name)?;
    let new = with_new_suffix(&path);
    let is_pending = is_unsettled(folder) && new.exists() && refuse_link(&new).is_ok();
    Ok(if is_pending { new } else { path })
}

/// True if a committed change still has to be completed.
pub fn is_unsettled(folder: &Path) -> bool {
    decision(folder).exists()
}

/// The file that commits a change.
fn decision(folder: &Path) -> PathBuf {
    with_new_suffix(&folder.join(DONE))
}

/// Temporary name of the replacement for this file.
pub(crate) fn with_new_suffix(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(NEW_SUFFIX);
    name.into()
}

/// Manifest of all files in the folder.
fn manifest_of(folder: &Path) -> Result<String> {
    let mut manifest = String::new();
    for name in files_of(folder)? {
        let hash = hash_file(&folder.join(&name))?;
        manifest.push_str(&format!("{hash}  {name}\n"));
    }
    Ok(manifest)
}

/// The sealed manifest with the `.new` form of `replaced` files instead of the old. All other lines stay as sealed: hashing those files
/// again would accept any damage since.
fn manifest_with(sealed: &Sealed, replaced: &[&str]) -> Result<String> {
    let mut lines: Vec<(String, String)> = sealed
        .files()
        .iter()
        .filter(|file| !replaced.contains(&file.name.as_str()))
        .map(|file| (file.name.clone(), file.blake3.clone()))
        .collect();
    for name in replaced {
        let hash = hash_file(&with_new_suffix(&sealed.folder().join(name)))?;
        lines.push(((*name).to_owned(), hash));
    }
    lines.sort();
    Ok(lines
        .iter()
        .map(|(name, hash)| format!("{hash}  {name}\n"))
        .collect())
}

/// Files that the seal covers, relative, with forward slashes, sorted.
fn files_of(folder: &Path) -> Result<Vec<String>> {
    fn walk(folder: &Path, prefix: &str, names: &mut Vec<String>) -> Result<()> {
        for entry in folder::entries(folder)? {
            let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
            if entry.path().is_dir() {
                // Tables of models are written by later steps and versioned separately.
                if !MODEL_FOLDERS.contains(&name.as_str()) {
                    walk(&entry.path(), &format!("{name}/"), names)?;
                }
            } else if ![MANIFEST, DONE].contains(&name.as_str())
                && !name.ends_with(NEW_SUFFIX)
                && !name.ends_with(TEMPORARY_SUFFIX)
            {
                names.push(name);
            }
        }
        Ok(())
    }
    let mut names = Vec::new();
    walk(folder, "", &mut names)?;
    names.sort();
    Ok(names)
}

#[cfg(test)]
mod tests;
