//! Downloads one scenario into a folder, atomically, as `dtd generate` writes it: next to its destination, then renamed.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Write};
use std::path::Path;

use dataset::corpus::claim::Claim;
use dataset::corpus::open_scenario::check_identity;
use dataset::corpus::seal::{self, DONE, MANIFEST, SealedFile};
use dataset::corpus::{Corpus, ScenarioFolder};
use dataset::files::file_name;
use dataset::files::json_file::{write_atomically, write_json};
use dataset::files::new_file::{NewFile, clear_leftovers};
use dataset::files::outside_file::{self, FileKind};
use dataset::files::own_path::{own_path, refuse_link};
use futures_util::future::LocalBoxFuture;
use futures_util::{StreamExt, TryStreamExt, stream};
use object_store::GetOptions;
use tokio::task::spawn_blocking;

use super::stored_fault::{StoredFault, StoredFaults};
use super::stored_seal::{FoundSeal, StoredSeal};
use crate::corpus_store::{CorpusStore, Objects, scenario_file};
use crate::error::{Result, StoreError};
use crate::patience::Transfer;

const RECORD: &str = "scenario.json";
/// Files in parallel.
const FILES_AT_ONCE: usize = 4;

/// The result for a scenario.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fetched {
    /// It is there now.
    Whole {
        /// Files that were downloaded.
        brought: usize,
        /// Files that an earlier, unfinished call had downloaded.
        there: usize,
    },
    /// It existed already, with this content.
    Same,
    /// It existed already, with other content, and was left alone.
    Other,
    /// It is not committed in the store.
    NotCommitted,
}

impl CorpusStore {
    /// Downloads a committed scenario, or resumes. It is compared with a listing first; then files are checked against `MANIFEST.b3`,
    /// and that against `DONE.json`. `seen` are its objects from a listing, if there is one.
    pub fn fetch_scenario<'a>(
        &'a self,
        id: &'a str,
        corpus: &'a Corpus,
        seen: Option<&'a Objects>,
        transfer: &'a Transfer<'_>,
    ) -> LocalBoxFuture<'a, Result<Fetched>> {
        Box::pin(async move {
            if let Err(bad) = file_name::check_id(id) {
                return Err(self.damaged(id, bad));
            }
            let Some(found) = self.found_seal(id).await? else {
                return Ok(Fetched::NotCommitted);
            };
            let lost = |fault: StoredFault| self.faulty(id, fault);
            let theirs = found.stored.as_ref().map_err(|fault| lost(fault.clone()))?;
            let committed = corpus.scenario(id);
            if is_there(&committed, theirs)? {
                return Ok(Fetched::Same);
            }
            let claim = claim(&committed).await?;
            if is_there(&committed, theirs)? {
                return Ok(Fetched::Same);
            }
            if committed.root().exists() {
                return Ok(Fetched::Other);
            }
            let there = self.objects_as_sealed(id, theirs, seen).await?;
            let (manifest, files) = self.manifest(id, theirs, &there).await?.map_err(lost)?;

            let partial = corpus.partial_scenario(id);
            refuse_link(partial.root())?;
            clear_others(partial.root(), &files)?;
            let bring = async |file: &SealedFile| {
                let target = own_path(partial.root(), &file.name)?;
                let is_brought = target.is_file() && seal::hash_file(&target)? == file.blake3;
                if !is_brought {
                    self.bring(id, file, &target, &there, transfer).await?;
                    transfer.kept();
                }
                Ok::<bool, StoreError>(!is_brought)
            };
            // First: another scenario's files are not worth downloading.
            let (record, others): (Vec<_>, Vec<_>) =
                files.iter().partition(|file| file.name == RECORD);
            let mut brought = Vec::new();
            for file in record {
                brought.push(bring(file).await?);
                let path = partial.root().join(&file.name);
                let content =
                    outside_file::read(&path, FileKind::json("scenario record").unlinked())?;
                if let Err(foreign) =
                    check_identity(id, &theirs.seal, &content, Path::new(&file.name))
                {
                    remove_partial(partial.root(), &files);
                    let reason = foreign.to_string();
                    return Err(self.faulty(id, StoredFault::OtherScenario { reason }));
                }
            }
            let others: Vec<bool> = stream::iter(others.into_iter().map(bring))
                .buffer_unordered(FILES_AT_ONCE)
                .try_collect()
                .await?;
            brought.extend(others);
            write_atomically(&partial.root().join(MANIFEST), manifest.as_bytes())?;
            write_seal(&partial.root().join(DONE), &found)?;
            for folder in [partial.root().to_owned(), partial.root().join("views")] {
                clear_leftovers(&folder);
            }
            seal::commit_folder(partial.root(), committed.root())?;
            drop(claim);
            let brought_files = brought.iter().filter(|brought| **brought).count();
            Ok(Fetched::Whole {
                brought: brought_files,
                there: brought.len() - brought_files,
            })
        })
    }

    /// The objects of a committed scenario; an error if one is not as it was sealed, in which case no file of the scenario is written.
    async fn objects_as_sealed(
        &self,
        id: &str,
        stored: &StoredSeal,
        seen: Option<&Objects>,
    ) -> Result<Objects> {
        if let Some(seen) = seen
            && self.faults(id, stored, seen).await?.is_empty()
        {
            return Ok(seen.clone());
        }
        let there = self.objects(id).await?;
        let faults = self.faults(id, stored, &there).await?;
        if faults.is_empty() {
            return Ok(there);
        }
        Err(self.faulty(id, StoredFaults(faults)))
    }

    /// One file, under another name until it is complete and has its hash.
    pub(crate) async fn bring(
        &self,
        id: &str,
        file: &SealedFile,
        target: &Path,
        there: &Objects,
        transfer: &Transfer<'_>,
    ) -> Result<()> {
        let name = || file.name.clone();
        let missing = || self.faulty(id, StoredFault::Missing { file: name() });
        let (object, _) = there.locate(file).ok_or_else(missing)?;
        let object = scenario_file(id, &object);
        let doing = || format!("read {object}");
        let folder = target.parent().unwrap_or(target);
        fs::create_dir_all(folder).map_err(dataset::Error::io("create", folder))?;
        let found = self.get(&object, GetOptions::default()).await?;
        let mut content = found.ok_or_else(missing)?.into_stream();
        let mut new = NewFile::create(target)?;
        let mut hasher = blake3::Hasher::new();
        while let Some(bytes) = content
            .try_next()
            .await
            .map_err(|error| self.error(&doing(), &error))?
        {
            transfer.check()?;
            hasher.update(&bytes);
            new.write_all(&bytes)
                .map_err(dataset::Error::io("write", target))?;
            transfer.passed(bytes.len() as u64);
        }
        if hasher.finalize().to_string() != file.blake3 {
            return Err(self.faulty(id, StoredFault::OtherContent { file: name() }));
        }
        Ok(new.commit()?)
    }
}

/// Removes only the downloaded files of a scenario that will never be complete.
fn remove_partial(partial: &Path, files: &[SealedFile]) {
    for file in files {
        let _ = fs::remove_file(partial.join(&file.name));
    }
    let _ = fs::remove_dir(partial.join("views"));
    let _ = fs::remove_dir(partial);
}

/// Returns true if the folder has this scenario.
///
/// # Errors
/// It has, but files of it are missing.
fn is_there(committed: &ScenarioFolder, theirs: &StoredSeal) -> Result<bool> {
    if !committed.seal()?.is_some_and(|ours| theirs.is_of(&ours)) {
        return Ok(false);
    }
    let faults = seal::faults_at_a_glance(committed.root())?;
    if faults.is_empty() {
        return Ok(true);
    }
    Err(StoreError::Damaged {
        place: committed.root().display().to_string(),
        message: format!("{}; move it away to fetch it again", faults.join("; ")),
    })
}

/// Writes the seal with the time when the scenario was sealed: a download makes no version newer.
fn write_seal(path: &Path, found: &FoundSeal) -> Result<()> {
    let Ok(stored) = &found.stored else {
        return Ok(());
    };
    write_json(path, &stored.seal)?;
    let seal = File::options().write(true).open(path);
    seal.and_then(|seal| seal.set_modified(found.sealed()))
        .map_err(dataset::Error::io("set the time of", path))?;
    Ok(())
}

/// Clears leftovers of an earlier attempt, of whatever verb, from a folder that will become a scenario, except these files; rejects
/// foreign files, which would become part of the scenario.
fn clear_others(partial: &Path, files: &[SealedFile]) -> Result<()> {
    let listed = |folder: &Path| {
        let entries = match fs::read_dir(folder) {
            Ok(entries) => entries,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
            Err(error) => return Err(dataset::Error::io("list", folder)(error)),
        };
        entries
            .map(|entry| entry.map(|entry| entry.path()))
            .collect::<io::Result<Vec<_>>>()
            .map_err(dataset::Error::io("list", folder))
    };
    clear_leftovers(partial);
    let views = partial.join("views");
    if refuse_link(&views).is_ok() {
        clear_leftovers(&views);
    }
    let mut to_look_at = listed(partial)?;
    while let Some(path) = to_look_at.pop() {
        let name = path
            .strip_prefix(partial)
            .unwrap_or(&path)
            .to_string_lossy()
            .into_owned();
        if files.iter().any(|file| file.name == name) {
            continue;
        }
        let is_folder = path.is_dir() && refuse_link(&path).is_ok();
        if is_folder
            && files
                .iter()
                .any(|file| Path::new(&file.name).starts_with(&name))
        {
            to_look_at.extend(listed(&path)?);
            continue;
        }
        // As left by a killed change.
        let whole_name = name.strip_suffix(".new").unwrap_or(&name);
        let is_ours = seal::is_scenario_file(whole_name) || [MANIFEST, DONE].contains(&whole_name);
        if is_folder || !is_ours {
            return Err(StoreError::Damaged {
                place: partial.display().to_string(),
                message: format!(
                    "holds {name}, which is not of the scenario; the folder is where it is put together: move {name} away and fetch again"
                ),
            });
        }
        fs::remove_file(&path).map_err(dataset::Error::io("remove", &path))?;
    }
    Ok(())
}

/// The claim of a scenario to be written; waits for another writer.
pub(crate) async fn claim(folder: &ScenarioFolder) -> Result<Claim> {
    let folder = folder.clone();
    let claimed = spawn_blocking(move || folder.claim()).await;
    Ok(claimed.unwrap_or_else(|panic| std::panic::resume_unwind(panic.into_panic()))?)
}
