//! Uploads and downloads a corpus: first its own files, then scenario by scenario, each with its detections. A scenario that cannot be
//! transferred does not stop the others.

use std::collections::{BTreeSet, VecDeque};
use std::path::Path;

use dataset::corpus::claim::Claim;
use dataset::corpus::{Corpus, ScenarioFolder, check_place};
use dataset::files::json_file::write_atomically;
use dataset::files::own_path::own_path;
use dataset::plan::PlannedScenarios;
use tokio::task::spawn_blocking;

use crate::client::{Connection, Listing};
use crate::corpus_files::{BadFile, CorpusFiles, SweepLanguage};
use crate::download::Fetched;
use crate::error::{Result, StoreError};
use crate::upload::{Before, Pushed};

/// Characters that a message shows from foreign names.
const MAX_SHOWN: usize = 64;
/// The message about a regenerated split.
pub const SPLIT_AGAIN: &str = "splits.json was lost and has been regenerated from plan and seed; if the corpus was ever added to, its \
                               sides may have changed: train again before you evaluate";

/// Transfer result, filled during the transfer. Detections are named `ID/MODEL`.
#[derive(Debug, Default)]
pub struct MirrorReport {
    /// Scenarios that were transferred.
    pub moved: Vec<String>,
    /// Transferred scenarios that replaced unlabelled ones.
    pub replaced: Vec<String>,
    /// Transferred scenarios that the store had damaged, with the faults.
    pub mended: Vec<(String, String)>,
    /// Scenarios that the destination had already.
    pub unchanged: Vec<String>,
    /// Scenarios of the folder that differ from the store's and were left alone.
    pub different: Vec<String>,
    /// Scenarios and files that were not transferred, with the reason.
    pub refused: Vec<(String, String)>,
    /// Detections that were transferred.
    pub detections: Vec<String>,
    /// Transferred detections that replaced different ones, which were damaged.
    pub replaced_detections: Vec<String>,
    /// Transferred detections that replaced damaged files.
    pub mended_detections: Vec<String>,
    /// Detections that were left alone, with the reason.
    pub left_detections: Vec<(String, String)>,
    /// Decisions about the files of the whole corpus.
    pub corpus_files: Vec<String>,
    /// Scenarios that the transfer has not reached.
    pub left: VecDeque<String>,
}

impl MirrorReport {
    fn refuse(&mut self, what: &str, reason: impl ToString) {
        self.refused.push((what.to_owned(), reason.to_string()));
    }

    /// Leaves a model's detections alone.
    pub(crate) fn leave(&mut self, folder: &ScenarioFolder, model: &str, reason: impl ToString) {
        let name = format!("{}/{model}", folder.id());
        self.left_detections.push((name, reason.to_string()));
    }

    /// Takes note of the files of the whole corpus that were replaced.
    fn add_replaced(&mut self, whose: &str, replaced: &[(&str, String)]) {
        let lines = replaced.iter();
        (self.corpus_files)
            .extend(lines.map(|(name, reason)| format!("replaced {whose}{name}, {reason}")));
    }
}

impl Connection<'_> {
    /// Uploads a corpus.
    ///
    /// # Errors
    /// The store or the folder cannot be used, or they are different corpora; the same call resumes.
    pub async fn push(
        &self,
        corpus: &Corpus,
        sweeps: &dyn SweepLanguage,
        report: &mut MirrorReport,
    ) -> Result<()> {
        let files = self.files_to_push(corpus, sweeps, report).await?;
        let folders = corpus.scenarios()?;
        let ids: BTreeSet<String> = folders.iter().map(ScenarioFolder::id).collect();
        let decision = self.settle(&files, sweeps).await?;
        report.add_replaced("the store's ", &decision.replaced);
        if decision.has_more {
            let line = "the store's plan.json has more scenarios than ours and stays";
            report.corpus_files.push(line.into());
        }
        if let Some(bad) = decision.left {
            report.refuse(bad.name, format!(
                "{}/{} cannot be used with the plan.json beside it, which has more scenarios than ours: {bad}. `dtd push` from the folder of \
                 that plan, or `dtd generate` with its sweep to this URL, replaces it",
                self.store.name(),
                bad.name
            ));
        }
        let planned = PlannedScenarios::read(corpus)?;
        self.each(&ids, report, async |id, report| {
            let folder = corpus.scenario(id);
            if self.push_planned(&folder, &planned, report).await? {
                self.push_detections(&folder, report).await?;
            }
            Ok(())
        })
        .await
    }

    /// Downloads the corpus into a folder; if `only` names scenarios, no others.
    ///
    /// # Errors
    /// The store or the folder cannot be used, or they are different corpora; the same call resumes.
    pub async fn fetch(
        &self,
        folder: &Path,
        only: &[String],
        sweeps: &dyn SweepLanguage,
        report: &mut MirrorReport,
    ) -> Result<()> {
        self.check().await?;
        let listing = self.listing().await?;
        let ids = self.wanted(&listing, only)?;
        check_place(folder).map_err(StoreError::of_folder)?;
        let corpus = Corpus::create(folder).map_err(StoreError::of_folder)?;
        self.fetch_files(&corpus, sweeps, report).await?;
        for (name, bad) in listing.foreign() {
            let shown: String = name.chars().take(MAX_SHOWN).collect();
            let reason = format!("{bad}; it is no scenario, remove it from the store");
            report.refuse(&shown.escape_debug().to_string(), reason);
        }
        if !corpus.plan_path().exists() {
            let reason = "it is missing, here and in the store; `dtd push` from a folder that has it sends it";
            report.refuse(Corpus::PLAN, reason);
        }
        let planned = PlannedScenarios::read(&corpus)?;
        self.each(&ids, report, async |id, report| {
            match self.fetch_scenario(id, &corpus).await {
                Ok(Fetched::Whole { .. }) => report.moved.push(id.to_owned()),
                Ok(Fetched::Same) => report.unchanged.push(id.to_owned()),
                Ok(Fetched::Other) => {
                    report.different.push(id.to_owned());
                    return Ok(());
                }
                // Deleted since it was listed.
                Ok(Fetched::NotCommitted) => {
                    report.refuse(id, "it is being replaced; run the same command again");
                    return Ok(());
                }
                Err(error @ StoreError::Faulty { .. }) => {
                    report.refuse(id, format!("{error}. {}", self.advice(&planned, id)));
                    return Ok(());
                }
                Err(error) => return Err(error),
            }
            self.fetch_detections(&corpus.scenario(id), report).await
        })
        .await
    }

    /// Advice for a scenario that is damaged in the store. One that is not planned is neither pushed nor recorded.
    pub fn advice(&self, planned: &PlannedScenarios, id: &str) -> String {
        let done = format!("{}/scenarios/{id}/DONE.json", self.store.name());
        if planned.has(id) {
            format!(
                "`dtd push` from a folder that has it whole sends what is missing; without one, delete {done}, and `dtd generate` records it \
                 again"
            )
        } else {
            format!(
                "plan.json has no such scenario: delete {done}, which removes it from the corpus"
            )
        }
    }

    /// Error for a store without scenarios.
    pub fn nothing_committed(&self) -> StoreError {
        StoreError::unusable(format!(
            "{}: holds no committed scenario; is the prefix right?",
            self.store.name()
        ))
    }

    /// Transfers one scenario after the other. Errors that concern a single scenario are reported.
    async fn each(
        &self,
        ids: &BTreeSet<String>,
        report: &mut MirrorReport,
        mut transfer: impl AsyncFnMut(&str, &mut MirrorReport) -> Result<()>,
    ) -> Result<()> {
        self.watch.begin("", ids.len() as u64);
        report.left.extend(ids.iter().cloned());
        for (done, id) in ids.iter().enumerate() {
            self.watch.advance(done as u64, id);
            self.watch.check()?;
            match transfer(id, report).await {
                Err(error) if error.is_of_scenario() => report.refuse(id, error),
                transferred => transferred?,
            }
            report.left.pop_front();
        }
        self.watch.advance(ids.len() as u64, "");
        Ok(())
    }

    /// Uploads a scenario; true if the store has it now.
    async fn push_planned(
        &self,
        folder: &ScenarioFolder,
        planned: &PlannedScenarios,
        report: &mut MirrorReport,
    ) -> Result<bool> {
        let id = folder.id();
        // An invalid seal is reported by the upload.
        if let Ok(Some(seal)) = folder.seal()
            && let Err(error) = planned.check(&id, &seal.config_hash)
        {
            report.refuse(&id, error);
            return Ok(false);
        }
        let place = folder.root().display();
        let reason = match self.push_scenario(folder).await? {
            Pushed::Committed { before, .. } => {
                match before {
                    Before::Nothing => {}
                    Before::Unlabelled => report.replaced.push(id.clone()),
                    Before::Damaged(faults) => report.mended.push((id.clone(), faults.to_string())),
                }
                report.moved.push(id);
                return Ok(true);
            }
            Pushed::Same => {
                report.unchanged.push(id);
                return Ok(true);
            }
            Pushed::Labelled => format!(
                "the store has it with labels, and here it has none; run `dtd label` on the corpus, or move {place} away and fetch it"
            ),
            Pushed::Other => format!(
                "the store has a different copy of it, which stays; to keep the store's, move {place} away and fetch it; to replace it, \
                 delete {}/scenarios/{id}/DONE.json and push again",
                self.store.name()
            ),
        };
        report.refuse(&id, reason);
        Ok(false)
    }

    /// Requested scenarios among the committed ones.
    fn wanted(&self, listing: &Listing, only: &[String]) -> Result<BTreeSet<String>> {
        let mut committed = listing.committed();
        if committed.is_empty() {
            return Err(self.nothing_committed());
        }
        if let Some(id) = only.iter().find(|id| !committed.contains(*id)) {
            let plural = if committed.len() == 1 { "" } else { "s" };
            return Err(StoreError::unusable(format!(
                "{}: has no committed scenario {id} ({} scenario{plural} committed)",
                self.store.name(),
                committed.len()
            )));
        }
        committed.retain(|id| only.is_empty() || only.contains(id));
        Ok(committed)
    }

    /// The files of the folder, which belong together. A split that neither copy has is made again.
    async fn files_to_push(
        &self,
        corpus: &Corpus,
        sweeps: &dyn SweepLanguage,
        report: &mut MirrorReport,
    ) -> Result<CorpusFiles> {
        let root = corpus.root();
        let refuse = |bad: BadFile| {
            StoreError::unusable(format!(
                "{}: {bad}. Nothing was pushed; `dtd fetch {} --out FOLDER` brings the store's own",
                root.join(bad.name).display(),
                self.store.name()
            ))
        };
        let read = || {
            let contents = CorpusFiles::read(corpus).map_err(StoreError::of_folder)?;
            CorpusFiles::parse(contents, sweeps).map_err(refuse)
        };
        let files = read()?;
        self.check_place().await?;
        for name in Corpus::FILES {
            let path = root.join(name);
            let path = path.display();
            if files.contents.contains_key(name) {
                continue;
            }
            if self.read(name).await?.is_some() {
                report.corpus_files.push(format!(
                    "{path} is missing; the store keeps its own, and `dtd fetch` brings it"
                ));
            } else if name == Corpus::SPLITS
                && let Some(split) = files.split_again(sweeps)
            {
                let _claim = claim_corpus(corpus).await?;
                split.map_err(refuse)?.write(&corpus.splits_path())?;
                report.corpus_files.push(SPLIT_AGAIN.into());
            } else {
                let line = format!("{path} is missing, here and in the store");
                report.corpus_files.push(line);
            }
        }
        read()
    }

    /// Downloads the files of the whole corpus that the folder lacks or has damaged, or to which the store's only add.
    async fn fetch_files(
        &self,
        corpus: &Corpus,
        sweeps: &dyn SweepLanguage,
        report: &mut MirrorReport,
    ) -> Result<()> {
        let (store, root) = (self.store.name(), corpus.root());
        let damaged = |bad: BadFile| StoreError::Damaged {
            place: format!("{store}/{}", bad.name),
            message: format!(
                "{bad}. Nothing was fetched; `dtd push` from an intact copy of the corpus, or `dtd generate` with its sweep, replaces it"
            ),
        };
        let theirs = self.corpus_contents().await?;
        let theirs = CorpusFiles::parse(theirs, sweeps).map_err(damaged)?;
        // Other processes must not change them in the meantime.
        let _claim = claim_corpus(corpus).await?;
        let ours = CorpusFiles::read(corpus).map_err(StoreError::of_folder)?;
        let sweep = ours.get(Corpus::SWEEP).filter(|sweep| !sweep.is_empty());
        // Without a plan, it may be anyone's work.
        if !ours.contains_key(Corpus::PLAN)
            && sweep.is_some_and(|ours| theirs.contents.get(Corpus::SWEEP) != Some(ours))
        {
            return Err(StoreError::unusable(format!(
                "{} differs from {store}/{}, and there was no plan.json that was made from it. Nothing was fetched; move it away, or name a \
                 different folder",
                root.join(Corpus::SWEEP).display(),
                Corpus::SWEEP
            )));
        }
        let refuse = |name: &str, difference: &str| {
            let path = root.join(name);
            StoreError::unusable(format!(
                "{} is of a different corpus than {store}: {difference}. Nothing was fetched; name a different folder",
                path.display()
            ))
        };
        let decision = theirs.decide(&ours, sweeps);
        let decision = decision.map_err(|conflict| refuse(conflict.name, &conflict.fault))?;
        if let Some(bad) = decision.left {
            return Err(refuse(bad.name, &bad.fault));
        }
        if decision.has_more {
            let plan = corpus.plan_path();
            report.corpus_files.push(format!(
                "{} has more scenarios than the store's and stays; `dtd push` sends it",
                plan.display()
            ));
        }
        for name in decision.write {
            let path = own_path(root, name).map_err(StoreError::of_folder)?;
            write_atomically(&path, &theirs.contents[name])?;
        }
        report.add_replaced(&format!("{}/", root.display()), &decision.replaced);
        let splits = corpus.splits_path();
        if splits.exists() {
            return Ok(());
        }
        report.corpus_files.push(match theirs.split_again(sweeps) {
            Some(split) => {
                split.map_err(damaged)?.write(&splits)?;
                SPLIT_AGAIN.into()
            }
            None => format!(
                "{} is missing, here and in the store, and cannot be regenerated without plan.json and corpus.toml",
                Corpus::SPLITS
            ),
        });
        Ok(())
    }
}

/// Claim on the files of the whole corpus; waits for other writers on a second thread, so that the wait can be dropped.
async fn claim_corpus(corpus: &Corpus) -> dataset::Result<Claim> {
    let corpus = corpus.clone();
    let claimed = spawn_blocking(move || corpus.claim()).await;
    claimed.unwrap_or_else(|panic| std::panic::resume_unwind(panic.into_panic()))
}
