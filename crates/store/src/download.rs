//! Downloads one scenario into a folder, atomically, as `dtd generate` writes it: next to its destination, then renamed.

use std::fs::{self, DirEntry};
use std::io::Write;
use std::path::{Path, PathBuf};

use dataset::corpus::claim::Claim;
use dataset::corpus::open_scenario::check_identity;
use dataset::corpus::seal::{self, DONE, MANIFEST, Seal, SealedFile};
use dataset::corpus::{Corpus, ScenarioFolder};
use dataset::files::file_name;
use dataset::files::folder;
use dataset::files::json_file::{write_atomically, write_json};
use dataset::files::new_file::{NewFile, clear_leftovers};
use dataset::files::outside_file::{self, FileKind};
use dataset::files::own_path::{own_path, refuse_link};
use futures_util::{StreamExt, TryStreamExt, stream};
use object_store::GetOptions;
use tokio::task::spawn_blocking;

use crate::client::{Connection, Objects, scenario_file};
use crate::error::{Fault, Result, StoreError};
use crate::stored::{OTHER_CONTENT, manifest_file};

/// Files in parallel.
const FILES_AT_ONCE: usize = 4;

/// Download result.
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

impl Connection<'_> {
    /// Downloads a committed scenario, or resumes. It is compared with a listing first; then files are checked against `MANIFEST.b3`,
    /// and that against `DONE.json`.
    ///
    /// # Errors
    /// It is not as it was sealed, or the store or the disk fails.
    pub async fn fetch_scenario(&self, id: &str, corpus: &Corpus) -> Result<Fetched> {
        if let Err(bad) = file_name::check_id(id) {
            return Err(self.store.damaged(&format!("scenarios/{id}"), bad));
        }
        let Some(found) = self.found_seal(id).await? else {
            return Ok(Fetched::NotCommitted);
        };
        let seal = match &found.stored {
            Ok(stored) => stored.seal.clone(),
            Err(fault) => return Err(self.faulty(id, fault.clone())),
        };
        let committed = corpus.scenario(id);
        if is_there(&committed, &seal)? {
            return Ok(Fetched::Same);
        }
        let _claim = claim(&committed).await?;
        if is_there(&committed, &seal)? {
            return Ok(Fetched::Same);
        }
        if committed.root().exists() {
            return Ok(Fetched::Other);
        }
        let (stored, there) = self.whole(id, &found).await?;
        let manifest = self.manifest(id, &stored, &there).await?;
        let (manifest, files) = manifest.map_err(|fault| self.faulty(id, fault))?;
        let partial = corpus.partial_scenario(id);
        let partial = partial.root();
        refuse_link(partial)?;
        clear_others(partial, &files)?;
        let bring = async |file: &SealedFile| {
            let target = own_path(partial, &file.name)?;
            let is_there = target.is_file() && seal::hash_file(&target)? == file.blake3;
            if !is_there {
                self.bring(id, file, &target, &there).await?;
            }
            Ok::<bool, StoreError>(!is_there)
        };
        let own = manifest_file(&seal);
        let brought: Vec<bool> = stream::iter(files.iter().filter(|file| **file != own).map(bring))
            .buffer_unordered(FILES_AT_ONCE)
            .try_collect()
            .await?;
        let record = ScenarioFolder::RECORD;
        if files.iter().any(|file| file.name == record) {
            let kind = FileKind::json("scenario record").unlinked();
            let content = outside_file::read(&partial.join(record), kind)?;
            if let Err(foreign) = check_identity(id, &seal, &content, Path::new(record)) {
                // All files there belong to a different scenario.
                let _ = fs::remove_dir_all(partial);
                let (file, message) = (record.to_owned(), foreign.to_string());
                return Err(self.faulty(id, Fault { file, message }));
            }
        }
        write_atomically(&partial.join(MANIFEST), manifest.as_bytes())?;
        write_json(&partial.join(DONE), &seal)?;
        for folder in [partial.to_owned(), partial.join("views")] {
            clear_leftovers(&folder);
        }
        seal::commit_folder(partial, committed.root())?;
        let count = brought.iter().filter(|brought| **brought).count();
        Ok(Fetched::Whole {
            brought: count,
            there: brought.len() - count,
        })
    }

    /// Downloads one file, under a temporary name until it is complete and has its hash.
    pub(crate) async fn bring(
        &self,
        id: &str,
        file: &SealedFile,
        target: &Path,
        there: &Objects,
    ) -> Result<()> {
        let missing = || self.faulty(id, Fault::missing(&file.name));
        let (object, _) = there.locate(file).ok_or_else(missing)?;
        let object = scenario_file(id, &object);
        let folder = target.parent().unwrap_or(target);
        fs::create_dir_all(folder).map_err(dataset::Error::io("create", folder))?;
        self.ask(async || {
            let found = self.get(&object, GetOptions::default()).await?;
            let mut content = found.ok_or_else(missing)?.into_stream();
            let mut new = NewFile::create(target)?;
            let mut hasher = blake3::Hasher::new();
            let failed = |error| self.store.error(&format!("read {object}"), &error);
            while let Some(bytes) = content.try_next().await.map_err(failed)? {
                self.watch.check()?;
                hasher.update(&bytes);
                new.write_all(&bytes)
                    .map_err(dataset::Error::io("write", target))?;
                self.passed(bytes.len());
            }
            if hasher.finalize().to_string() != file.blake3 {
                // Its size and ETag may be right, so that an upload would not notice.
                let difference = format!(
                    "{OTHER_CONTENT}; delete {}/{object} before it is sent again",
                    self.store.name()
                );
                return Err(self.faulty(id, Fault::of(&file.name, difference)));
            }
            Ok(new.commit()?)
        })
        .await
    }
}

/// True if the folder has this scenario.
///
/// # Errors
/// It has, but files are missing.
fn is_there(committed: &ScenarioFolder, seal: &Seal) -> Result<bool> {
    let is_same = committed.seal()?.is_some_and(|ours| {
        ours.manifest_blake3 == seal.manifest_blake3 && ours.config_hash == seal.config_hash
    });
    if !is_same {
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

/// Clears what earlier attempts, by any verb, left in a folder that will become a scenario, except these files. Rejects foreign files,
/// which would become part of the scenario.
fn clear_others(partial: &Path, files: &[SealedFile]) -> Result<()> {
    let mut entries = listed(partial)?;
    while let Some(path) = entries.pop() {
        let name = path.strip_prefix(partial).unwrap_or(&path);
        let name = name.to_string_lossy().into_owned();
        if files.iter().any(|file| file.name == name) {
            continue;
        }
        let is_folder = path.is_dir() && refuse_link(&path).is_ok();
        let holds = |file: &SealedFile| Path::new(&file.name).starts_with(&name);
        if is_folder && (name == "views" || files.iter().any(holds)) {
            entries.extend(listed(&path)?);
            continue;
        }
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

/// Folder entries without leftovers from killed writers; none if the folder is missing.
fn listed(folder: &Path) -> Result<Vec<PathBuf>> {
    clear_leftovers(folder);
    let entries = dataset::Error::if_there(folder::entries(folder))?.unwrap_or_default();
    Ok(entries.iter().map(DirEntry::path).collect())
}

/// Scenario claim for writing; waits for other writers.
pub(crate) async fn claim(folder: &ScenarioFolder) -> Result<Claim> {
    let folder = folder.clone();
    let claimed = spawn_blocking(move || folder.claim()).await;
    Ok(claimed.unwrap_or_else(|panic| std::panic::resume_unwind(panic.into_panic()))?)
}
