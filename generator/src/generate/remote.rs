//! A corpus in an object store: the folder is then a stage, where scenarios are recorded and uploaded when finished (`uploads.rs`).
//! Scenarios committed in the store count as done; the stage holds the rest. They are removed from it only if the store's copy is whole.

pub(crate) mod stage;
pub(crate) mod uploads;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use dataset::corpus::Corpus;
use dataset::corpus::claim::{Claim, Claimed};
use dataset::corpus::seal::Seal;
use dataset::corpus::set_aside::{FOLDER as FAILED, SetAside};
use dataset::corpus::splits::Splits;
use dataset::plan::{Difference, Plan, PlannedScenario};
use store::{Committed, Connection, CorpusStore, Logged};

use super::error::GenerateError;
use crate::sweep_language::Sweeps;

/// Destination of finished scenarios.
#[derive(Debug, Clone)]
pub struct Remote {
    /// The corpus.
    pub store: CorpusStore,
    /// Keep uploaded scenarios on the stage as well.
    pub keep_staged: bool,
}

impl Remote {
    pub(super) const fn connection(&self) -> Connection<'_> {
        self.store.watched(&Logged)
    }

    /// Checks that the store grants access, and rejects foreign objects and a corpus that was started from a different sweep. Returns
    /// that corpus's split, if it has one. If it is damaged, the stage's holds; a damaged plan is replaced if this sweep has all scenarios
    /// that are there.
    pub(super) async fn look(
        &self,
        plan: &Plan,
        stage: &Path,
    ) -> Result<Option<Vec<u8>>, GenerateError> {
        let store = self.connection();
        store.check_place().await?;
        if let Some(theirs) = store.read(Corpus::PLAN).await? {
            match Plan::parse_undamaged(&theirs, &self.path_of(Corpus::PLAN))? {
                None => self.check_all_committed(plan).await?,
                Some(theirs) => {
                    if let Some(difference) = Difference::between(&theirs, plan).conflict() {
                        return Err(GenerateError::OtherPlan {
                            corpus: self.store.name().into(),
                            difference,
                        });
                    }
                }
            }
        }
        let Some(split) = store.read(Corpus::SPLITS).await? else {
            return Ok(None);
        };
        match Splits::parse(&split, &self.path_of(Corpus::SPLITS)) {
            Ok(_) => Ok(Some(split)),
            Err(error) if stage.join(Corpus::SPLITS).is_file() => {
                tracing::warn!(%error, "the store's split is damaged; the stage's takes its place");
                Ok(None)
            }
            Err(error) => Err(error.into()),
        }
    }

    /// Rejects a plan that lacks a committed scenario: it may not replace a damaged one.
    async fn check_all_committed(&self, plan: &Plan) -> Result<(), GenerateError> {
        let committed = self.connection().listing().await?.committed();
        let is_planned = |id: &String| plan.scenarios.iter().any(|scenario| scenario.id == *id);
        if let Some(id) = committed.into_iter().find(|id| !is_planned(id)) {
            return Err(GenerateError::BadInput(format!(
                "{}: is damaged, and the sweep of this run lacks scenario {id}, which is there; use the sweep that the corpus was made \
                 from, or `dtd push` an intact copy of the corpus",
                self.path_of(Corpus::PLAN).display()
            )));
        }
        tracing::warn!("the store's plan.json is damaged; this sweep's replaces it");
        Ok(())
    }

    /// Committed scenarios among `wanted` that are whole in the store, after checking their parameters. Damaged ones are sent or recorded
    /// again.
    pub(super) async fn committed(
        &self,
        wanted: &[&PlannedScenario],
    ) -> Result<BTreeMap<String, Seal>, GenerateError> {
        let store = self.connection();
        let ids = wanted.iter().map(|scenario| scenario.id.clone());
        let mut seals = BTreeMap::new();
        for (id, state) in store.states(ids).await? {
            match state {
                Committed::Whole(seal) => {
                    seals.insert(id, seal);
                }
                Committed::Damaged(faults) => tracing::warn!(
                    id,
                    "damaged in the store: {faults}; it is sent again from the stage, or recorded again"
                ),
                Committed::No => {}
            }
        }
        for scenario in wanted {
            if let Some(seal) = seals.get(&scenario.id)
                && seal.config_hash != scenario.config_hash
            {
                return Err(GenerateError::ForeignFolder {
                    folder: self.path_of(&format!("scenarios/{}", scenario.id)),
                    message: "it was made from other parameters".into(),
                });
            }
        }
        Ok(seals)
    }

    /// Uploads the files of the whole corpus.
    pub(super) async fn publish(&self, stage: &Corpus) -> Result<(), GenerateError> {
        Ok(self.connection().publish(stage, &Sweeps).await?)
    }

    /// Removes from the stage what an earlier run uploaded and did not clear before it was killed.
    pub(super) async fn clear_what_is_sent(
        &self,
        stage: &Corpus,
        committed: &BTreeMap<String, Seal>,
    ) {
        if self.keep_staged {
            return;
        }
        for (id, theirs) in committed {
            let [whole, partial] = [stage.scenario(id), stage.partial_scenario(id)];
            if !(whole.root().exists() || partial.root().exists()) {
                continue;
            }
            let Ok(Claimed::Mine(_claim)) = Claim::take(stage, id) else {
                continue;
            };
            if partial.root().exists() {
                remove(partial.root());
            }
            // Different content stays: it may exist nowhere else.
            if whole.seal().is_ok_and(|ours| ours.as_ref() == Some(theirs)) {
                self.unstage(stage, id).await;
            }
        }
    }

    /// Removes a scenario that is whole in the store from the stage, without ever leaving a half under its name. It stays if the store
    /// lacks detections or has damaged them.
    pub(super) async fn unstage(&self, stage: &Corpus, id: &str) {
        let [whole, partial] = [stage.scenario(id), stage.partial_scenario(id)];
        match self.connection().has_detections_of(&whole).await {
            Ok(true) => {}
            Ok(false) => {
                tracing::warn!(
                    id,
                    "stays on the stage, because the store lacks some of its detections; send them with `dtd push {} {}`",
                    stage.root().display(),
                    self.store.name()
                );
                return;
            }
            Err(error) => {
                tracing::warn!(%error, id, "sent, but still on the stage");
                return;
            }
        }
        match fs::rename(whole.root(), partial.root()) {
            Ok(()) => remove(partial.root()),
            Err(error) => tracing::warn!(%error, id, "sent, but still on the stage"),
        }
    }

    /// Fetches to the stage why scenarios failed in earlier runs, on any machine, and deletes the records of those that are
    /// committed by now.
    pub(super) async fn bring_failures(
        &self,
        stage: &Corpus,
        to_make: &[&PlannedScenario],
        committed: &BTreeMap<String, Seal>,
    ) -> Result<(), GenerateError> {
        let store = self.connection();
        for name in store.names_in(FAILED).await? {
            let Some(id) = name.strip_suffix(".json") else {
                continue;
            };
            if committed.contains_key(id) {
                self.forget_failure(id).await;
            } else if to_make.iter().any(|scenario| scenario.id == id)
                && let Some(text) = store.read(&SetAside::name(id)).await?
            {
                SetAside::adopt(stage, id, &text)?;
            }
        }
        Ok(())
    }

    /// Records in the store why a scenario was set aside. It is informational: an unreachable store does not stop the run.
    pub(super) async fn tell_of_failure(&self, stage: &Corpus, id: &str) {
        let told = async {
            let text = SetAside::text(stage, id)?;
            let name = SetAside::name(id);
            Ok::<_, GenerateError>(self.connection().write(&name, &text).await?)
        };
        if let Err(error) = told.await {
            tracing::warn!(id, %error, "why it failed is on the stage only");
        }
    }

    pub(super) async fn forget_failure(&self, id: &str) {
        if let Err(error) = self.connection().remove(&SetAside::name(id)).await {
            tracing::warn!(id, %error, "it is committed, but the store still says why it failed before");
        }
    }

    fn path_of(&self, name: &str) -> PathBuf {
        PathBuf::from(format!("{}/{name}", self.store.name()))
    }
}

fn remove(folder: &Path) {
    if let Err(error) = fs::remove_dir_all(folder) {
        tracing::warn!(%error, folder = %folder.display(), "sent, but still on the stage");
    }
}
