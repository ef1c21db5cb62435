//! Downloads one scenario into a folder, atomically, as `dtd generate` writes it: next to its destination, then renamed.

use std::fs;
use std::io::{self, ErrorKind, Write};
use std::path::Path;

use dataset::claim::Claim;
use dataset::corpus::{Corpus, ScenarioFolder};
use dataset::json_file::write_atomically;
use dataset::new_file::{NewFile, clear_leftovers};
use dataset::open_scenario::check_identity;
use dataset::outside_file::{self, FileKind};
use dataset::own_path::{own_path, refuse_link};
use dataset::seal::{self, DONE, MANIFEST, SealedFile};
use futures_util::future::LocalBoxFuture;
use futures_util::{StreamExt, TryStreamExt, stream};
use object_store::GetOptions;
use tokio::task::spawn_blocking;

use crate::corpus_store::{CorpusStore, scenario_file};
use crate::error::{Result, StoreError};
use crate::patience::Watch;

/// Advice for a scenario that is damaged in the store.
const MEND: &str = "Delete the scenario's DONE.json in the store; then `dtd push` sends it again, or `dtd generate` records it again";
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
    /// Downloads a committed scenario, or resumes. Files are checked against `MANIFEST.b3`, and that against `DONE.json`.
    pub fn fetch_scenario<'a>(
        &'a self,
        id: &'a str,
        corpus: &'a Corpus,
        watch: &'a dyn Watch,
    ) -> LocalBoxFuture<'a, Result<Fetched>> {
        Box::pin(async move {
            let damaged = |message: String| StoreError::Damaged {
                place: format!("{}/scenarios/{id}", self.name()),
                message,
            };
            if !seal::is_within(Path::new(id)) {
                return Err(damaged("is not the name of a scenario".into()));
            }
            let Some(theirs) = self.seal(id).await? else {
                return Ok(Fetched::NotCommitted);
            };
            let committed = corpus.scenario(id);
            if committed.seal()?.as_ref() == Some(&theirs) {
                return Ok(Fetched::Same);
            }
            let claim = claim(&committed).await?;
            match committed.seal()? {
                Some(ours) if ours == theirs => return Ok(Fetched::Same),
                None if !committed.root().exists() => {}
                _ => return Ok(Fetched::Other),
            }
            let manifest = self.read(&scenario_file(id, MANIFEST)).await?;
            let manifest = manifest.ok_or_else(|| damaged(format!("{MANIFEST} is missing")))?;
            let manifest =
                String::from_utf8(manifest).map_err(|error| damaged(error.to_string()))?;
            let files =
                seal::sealed_files(&manifest, &theirs).map_err(|bad| damaged(bad.to_string()))?;

            let partial = corpus.partial_scenario(id);
            refuse_link(partial.root())?;
            clear_others(partial.root(), &files)?;
            let jobs = files.iter().map(|file| {
                let target = own_path(partial.root(), &file.name);
                let name = scenario_file(id, &file.name);
                async move {
                    let target = target?;
                    let there = target.is_file() && seal::hash_file(&target)? == file.blake3;
                    if !there {
                        self.bring(&name, &target, &file.blake3, watch).await?;
                    }
                    Ok::<bool, StoreError>(!there)
                }
            });
            let brought: Vec<bool> = stream::iter(jobs)
                .buffer_unordered(FILES_AT_ONCE)
                .try_collect()
                .await?;
            if let Some(record) = files.iter().find(|file| file.name == RECORD) {
                let path = partial.root().join(&record.name);
                let content =
                    outside_file::read(&path, FileKind::json("scenario record").unlinked())?;
                check_identity(id, &theirs, &content, Path::new(&record.name))
                    .map_err(|error| damaged(error.to_string()))?;
            }
            write_atomically(&partial.root().join(MANIFEST), manifest.as_bytes())?;
            dataset::json_file::write_json(&partial.root().join(DONE), &theirs)?;
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

    /// One file, under another name until it is complete and has its hash.
    pub(crate) async fn bring(
        &self,
        name: &str,
        target: &Path,
        blake3: &str,
        watch: &dyn Watch,
    ) -> Result<()> {
        let doing = || format!("read {name}");
        let folder = target.parent().unwrap_or(target);
        fs::create_dir_all(folder).map_err(dataset::Error::io("create", folder))?;
        let found = self.get(name, GetOptions::default()).await?;
        let found = found.ok_or_else(|| StoreError::Damaged {
            place: format!("{}/{name}", self.name()),
            message: format!("is missing, though {MANIFEST} lists it. {MEND}"),
        })?;
        let mut content = found.into_stream();
        let mut file = NewFile::create(target)?;
        let mut hasher = blake3::Hasher::new();
        while let Some(bytes) = content
            .try_next()
            .await
            .map_err(|error| self.error(&doing(), &error))?
        {
            if watch.stopped() {
                return Err(StoreError::Stopped);
            }
            hasher.update(&bytes);
            file.write_all(&bytes)
                .map_err(dataset::Error::io("write", target))?;
            watch.passed(bytes.len() as u64);
        }
        if hasher.finalize().to_string() != blake3 {
            return Err(StoreError::Damaged {
                place: format!("{}/{name}", self.name()),
                message: format!("does not match its seal: its hash differs. {MEND}"),
            });
        }
        Ok(file.commit()?)
    }
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
