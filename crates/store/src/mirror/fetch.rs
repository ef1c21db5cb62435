//! Downloads a corpus: the files of the whole corpus first, then scenario by scenario.

use std::collections::{BTreeSet, VecDeque};
use std::path::Path;

use dataset::corpus::{Corpus, check_place};
use dataset::files::file_name::BadFileName;
use dataset::files::json_file::write_atomically;
use dataset::files::outside_file::{self, FileKind};
use dataset::files::own_path::own_path;
use dataset::plan::{Plan, PlannedScenarios};

use super::corpus_files::{BadFile, Conflict, CorpusFiles, Judge};
use super::{FileDecision, Mirror, MirrorError, claim_corpus};
use crate::corpus_store::Listing;
use crate::error::StoreError;
use crate::scenario::{Fetched, MovedDetections};

/// Result of the download of a corpus.
#[derive(Debug, Default)]
pub struct FetchedCorpus {
    /// Decisions about the files of the whole corpus, by their names.
    pub files: Vec<(&'static str, FileDecision)>,
    /// Names in the store that have a seal, but cannot be identifiers of scenarios, with the reason.
    pub foreign: Vec<(String, BadFileName)>,
    /// True if the folder has a plan now.
    pub has_plan: bool,
    /// The scenarios of the plan.
    pub planned: PlannedScenarios,
    /// The requested scenarios, as far as they were downloaded.
    pub scenarios: Vec<FetchedScenario>,
    /// Identifiers of the others, if the download ended before them.
    pub to_go: VecDeque<String>,
}

/// Result of the download of a scenario.
#[derive(Debug)]
pub struct FetchedScenario {
    /// Its identifier.
    pub id: String,
    /// The result, or the reason why this scenario cannot be downloaded.
    pub fetched: Result<Fetched, StoreError>,
    /// The result for its detections; none were moved if the folder does not have the store's scenario.
    pub detections: MovedDetections,
}

impl Mirror<'_> {
    /// Downloads the corpus into a folder, or of its scenarios only these, if there are any. `result` is filled in the meantime, for a
    /// caller that drops the download.
    ///
    /// # Errors
    /// See [`MirrorError`]; the same call resumes.
    pub async fn fetch(
        &self,
        folder: &Path,
        only: &[String],
        result: &mut FetchedCorpus,
    ) -> Result<(), MirrorError> {
        self.store.check().await?;
        let listing = self.store.listing().await?;
        let ids = self.wanted(listing.committed(), only)?;
        check_place(folder).map_err(MirrorError::Folder)?;
        let corpus = Corpus::create(folder).map_err(MirrorError::Folder)?;
        result.files = self.fetch_files(&corpus).await?;
        let foreign = listing.foreign();
        result.foreign = foreign.map(|(name, bad)| (name.to_owned(), bad)).collect();
        result.has_plan = corpus.plan_path().exists();
        result.planned = PlannedScenarios::read(&corpus)?;
        self.transfer.watch.begin("", ids.len() as u64);
        result.to_go.extend(ids.iter().cloned());
        for (done, id) in ids.into_iter().enumerate() {
            self.transfer.watch.advance(done as u64, &id);
            self.transfer.check()?;
            let fetched = self.fetch_scenario(&id, &corpus, &listing).await?;
            let is_there = matches!(fetched, Ok(Fetched::Whole { .. } | Fetched::Same));
            let detections = if is_there {
                let scenario = corpus.scenario(&id);
                self.patience
                    .with(self.transfer, async || {
                        self.store.fetch_detections(&scenario, self.transfer).await
                    })
                    .await?
            } else {
                MovedDetections::default()
            };
            result.scenarios.push(FetchedScenario {
                id,
                fetched,
                detections,
            });
            result.to_go.pop_front();
        }
        self.transfer
            .watch
            .advance(result.scenarios.len() as u64, "");
        Ok(())
    }

    /// The requested committed scenarios.
    fn wanted(
        &self,
        mut committed: BTreeSet<String>,
        only: &[String],
    ) -> Result<BTreeSet<String>, MirrorError> {
        if committed.is_empty() {
            return Err(MirrorError::nothing_committed(self.store));
        }
        if let Some(id) = only.iter().find(|id| !committed.contains(*id)) {
            let count = match committed.len() {
                1 => "1 scenario".to_owned(),
                more => format!("{more} scenarios"),
            };
            return Err(MirrorError::Refused {
                message: format!(
                    "{}: has no committed scenario {id} ({count} committed)",
                    self.store.name()
                ),
            });
        }
        committed.retain(|id| only.is_empty() || only.contains(id));
        Ok(committed)
    }

    /// The outer error ends the call, the inner one concerns this scenario alone.
    async fn fetch_scenario(
        &self,
        id: &str,
        corpus: &Corpus,
        listing: &Listing,
    ) -> Result<Result<Fetched, StoreError>, MirrorError> {
        let objects = listing.of(id);
        let fetched = self
            .patience
            .with(self.transfer, async || {
                self.store
                    .fetch_scenario(id, corpus, Some(&objects), self.transfer)
                    .await
            })
            .await;
        match fetched {
            Err(StoreError::Faulty { .. } | StoreError::Damaged { .. }) | Ok(_) => Ok(fetched),
            Err(error) => Err(error.into()),
        }
    }

    /// Downloads the files that the folder lacks or has damaged, or to which the store's only add. Ones that contain more stay; if one
    /// contradicts the store's, this is another corpus.
    async fn fetch_files(
        &self,
        corpus: &Corpus,
    ) -> Result<Vec<(&'static str, FileDecision)>, MirrorError> {
        let store = self.store.name();
        let damaged = |bad: BadFile| MirrorError::Damaged {
            place: format!("{store}/{}", bad.name),
            message: bad.fault,
        };
        let theirs = CorpusFiles::of_store(self.store, self.sweeps).await?;
        let theirs = theirs.map_err(damaged)?;
        // Other processes must not change them in the meantime.
        let _claim = claim_corpus(corpus).await?;
        let has_plan = corpus.plan_path().exists();
        let mut judge = Judge::new(&theirs, Plan::of_corpus(corpus).ok().flatten());
        let mut is_plan_replaced = false;
        let mut decisions = Vec::new();
        let mut to_write = Vec::new();
        for (name, bytes) in theirs.contents() {
            let path = own_path(corpus.root(), name).map_err(MirrorError::Folder)?;
            if path.exists() {
                let ours = outside_file::read(&path, FileKind::PLAN.unlinked());
                let ours = ours.map_err(MirrorError::Folder)?;
                if ours == bytes {
                    continue;
                }
                // Without a plan, it may be anybody's work.
                if name == Corpus::SWEEP && !has_plan && !ours.is_empty() {
                    let message = format!(
                        "{} differs from {store}/{name}, and there was no plan.json that was made from it. Nothing was fetched; move it away, \
                         or name another folder",
                        path.display()
                    );
                    return Err(MirrorError::Refused { message });
                }
                let decision = judge.verdict(name, &ours, is_plan_replaced);
                let decision = decision.map_err(|Conflict(difference)| MirrorError::Refused {
                    message: format!(
                        "{} is of another corpus than {store}: {difference}. Nothing was fetched; name another folder",
                        path.display()
                    ),
                })?;
                let is_replaced = matches!(decision, Some(FileDecision::Replaced(_)));
                decisions.extend(decision.map(|decision| (name, decision)));
                if !is_replaced {
                    continue;
                }
            }
            is_plan_replaced |= name == Corpus::PLAN;
            to_write.push((path, bytes));
        }
        for (path, bytes) in to_write {
            write_atomically(&path, bytes)?;
        }
        let splits = corpus.splits_path();
        if !splits.exists() {
            let split = theirs.split_again().transpose();
            let split = split.map_err(|leak| damaged(BadFile::damaged(Corpus::PLAN, leak)))?;
            if let Some(split) = &split {
                split.write(&splits)?;
            }
            decisions.push((
                Corpus::SPLITS,
                split.map_or(FileDecision::Missing, |_| FileDecision::SplitAgain),
            ));
        }
        Ok(decisions)
    }
}
