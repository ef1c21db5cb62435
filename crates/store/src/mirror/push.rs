//! Uploads a corpus: the files of the whole corpus first, then scenario by scenario.

use std::collections::{BTreeSet, VecDeque};

use dataset::corpus::{Corpus, ScenarioFolder};
use dataset::files::outside_file::{self, FileKind};
use dataset::files::own_path::own_path;
use dataset::plan::PlannedScenarios;

use super::corpus_files::{BadFile, Conflict, CorpusFiles, Judge};
use super::settle::Keep;
use super::{FileDecision, Mirror, MirrorError, claim_corpus};
use crate::corpus_store::Listing;
use crate::error::StoreError;
use crate::scenario::{MovedDetections, Pushed};

/// Result of the upload of a corpus.
#[derive(Debug, Default)]
pub struct PushedCorpus {
    /// Decisions about the files of the whole corpus, by their names.
    pub files: Vec<(&'static str, FileDecision)>,
    /// A file in the store that cannot be used with the plan beside it, and that none of ours may replace.
    pub left: Option<BadFile>,
    /// Incomplete uploads of earlier calls that were cleared.
    pub cleared: usize,
    /// The scenarios of the folder, as far as they were uploaded.
    pub scenarios: Vec<PushedScenario>,
    /// Identifiers of the others, if the upload ended before them.
    pub to_go: VecDeque<String>,
}

/// Result of the upload of a scenario.
#[derive(Debug)]
pub struct PushedScenario {
    /// The scenario.
    pub folder: ScenarioFolder,
    /// The result, or the reason why this scenario cannot be uploaded.
    pub pushed: Result<Pushed, StoreError>,
    /// The result for its detections; none were moved if the scenario was not.
    pub detections: MovedDetections,
}

impl Mirror<'_> {
    /// Uploads a corpus. `result` is filled in the meantime, for a caller that drops the upload.
    ///
    /// # Errors
    /// See [`MirrorError`]; the same call resumes.
    pub async fn push(
        &self,
        corpus: &Corpus,
        result: &mut PushedCorpus,
    ) -> Result<(), MirrorError> {
        let files = self.files_to_push(corpus, result).await?;
        let folders = corpus.scenarios()?;
        let ids: BTreeSet<String> = folders.iter().map(ScenarioFolder::id).collect();
        match self.store.clear_unfinished(&ids).await {
            Ok(cleared) => result.cleared = cleared,
            // They use space and do no harm; write permission does not imply permission to list.
            Err(error) => {
                let line = format!("unfinished uploads are left there: {error}");
                self.transfer.watch.warn(&line);
            }
        }
        self.push_files(&files, result).await?;
        let planned = PlannedScenarios::read(corpus)?;
        let listing = self
            .patience
            .with(self.transfer, async || self.store.listing().await)
            .await?;
        self.transfer.watch.begin("", folders.len() as u64);
        result.to_go.extend(folders.iter().map(ScenarioFolder::id));
        for (done, folder) in folders.into_iter().enumerate() {
            self.transfer.watch.advance(done as u64, &folder.id());
            self.transfer.check()?;
            let pushed = self.push_scenario(&folder, &planned, &listing).await?;
            let is_there = matches!(pushed, Ok(Pushed::Committed { .. } | Pushed::Same));
            let detections = if is_there {
                self.patience
                    .with(self.transfer, async || {
                        self.store.push_detections(&folder, self.transfer).await
                    })
                    .await?
            } else {
                MovedDetections::default()
            };
            result.scenarios.push(PushedScenario {
                folder,
                pushed,
                detections,
            });
            result.to_go.pop_front();
        }
        self.transfer
            .watch
            .advance(result.scenarios.len() as u64, "");
        Ok(())
    }

    /// The outer error ends the call, the inner one concerns this scenario alone.
    async fn push_scenario(
        &self,
        folder: &ScenarioFolder,
        planned: &PlannedScenarios,
        listing: &Listing,
    ) -> Result<Result<Pushed, StoreError>, MirrorError> {
        let id = folder.id();
        // An invalid seal is reported by the upload.
        if let Ok(Some(seal)) = folder.seal()
            && let Err(error) = planned.check(&id, &seal.config_hash)
        {
            return Ok(Err(error.into()));
        }
        let mut seen = Some(listing.of(&id));
        let pushed = self
            .patience
            .with(self.transfer, async || {
                // A repeated attempt finds more there.
                let seen = seen.take();
                self.store
                    .push_scenario(folder, seen.as_ref(), self.transfer)
                    .await
            })
            .await;
        match pushed {
            Err(error) if !matches!(error, StoreError::Damaged { .. }) => Err(error.into()),
            pushed => Ok(pushed),
        }
    }

    /// The files of the folder, which belong together. A split that neither copy has is made again.
    async fn files_to_push(
        &self,
        corpus: &Corpus,
        result: &mut PushedCorpus,
    ) -> Result<CorpusFiles<'_>, MirrorError> {
        let root = corpus.root();
        let refuse = |bad: BadFile| MirrorError::Refused {
            message: format!(
                "{}: {bad}. Nothing was pushed; `dtd fetch {} --out FOLDER` brings the store's own",
                root.join(bad.name).display(),
                self.store.name()
            ),
        };
        let read = |name| -> Result<Vec<u8>, MirrorError> {
            let path = own_path(root, name).map_err(MirrorError::Folder)?;
            outside_file::read(&path, FileKind::PLAN.unlinked()).map_err(MirrorError::Folder)
        };
        let mut files = CorpusFiles::new(self.sweeps);
        for name in Corpus::FILES {
            if own_path(root, name).map_err(MirrorError::Folder)?.exists() {
                files.add(name, read(name)?).map_err(refuse)?;
            }
        }
        files.check_together().map_err(refuse)?;
        self.store.check_place().await?;
        for name in files.missing() {
            let decision = if self.store.read(name).await?.is_some() {
                FileDecision::OnlyInStore
            } else if name == Corpus::SPLITS
                && let Some(split) = files.split_again()
            {
                let split = split.map_err(|leak| refuse(BadFile::damaged(name, leak)))?;
                let _claim = claim_corpus(corpus).await?;
                split.write(&corpus.splits_path())?;
                files.add(name, read(name)?).map_err(refuse)?;
                FileDecision::SplitAgain
            } else {
                FileDecision::Missing
            };
            result.files.push((name, decision));
        }
        Ok(files)
    }

    /// Uploads the files of which the store has none, a damaged one or one that ours only adds to. One that contradicts ours is an error;
    /// one that contains more stays.
    async fn push_files(
        &self,
        files: &CorpusFiles<'_>,
        result: &mut PushedCorpus,
    ) -> Result<(), MirrorError> {
        let mut decisions: Vec<(&'static str, FileDecision)> = Vec::new();
        let mut judge = Judge::new(files, files.plan().cloned());
        let settled = self
            .store
            .settle_files(files.contents(), |name, theirs, plan| {
                // Judged again if another process wrote it in the meantime.
                decisions.retain(|(of, _)| *of != name);
                let decision = judge.verdict(name, theirs, plan == Keep::Ours);
                let decision = decision.map_err(|Conflict(difference)| MirrorError::Refused {
                    message: format!(
                        "{}: the corpus was started from a different sweep or split, {name} differs: {difference}. A corpus can only be added \
                         to: push to another prefix",
                        self.store.name()
                    ),
                })?;
                let keep = match decision {
                    Some(FileDecision::Replaced(_)) => Keep::Ours,
                    _ => Keep::Theirs,
                };
                decisions.extend(decision.map(|decision| (name, decision)));
                Ok::<_, MirrorError>(keep)
            });
        settled.await?;
        result.files.append(&mut decisions);
        // For instance the sweep of an upload that was interrupted after the plan. Ours cannot replace it if the plan is not ours.
        result.left = CorpusFiles::of_store(self.store, self.sweeps).await?.err();
        Ok(())
    }
}
