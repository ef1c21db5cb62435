//! A corpus in an object store: the folder is then a stage, where scenarios are recorded and from which finished ones are uploaded
//! (`uploads.rs`). Scenarios committed in the store count as done; the stage holds the rest.

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
use dataset::files::outside_file::{self, FileKind};
use dataset::plan::{Difference, Plan, PlannedScenario};
use store::{Committed, CorpusStore, Keep};

use super::error::GenerateError;

/// Destination of finished scenarios.
#[derive(Debug, Clone)]
pub struct Remote {
    /// The corpus.
    pub store: CorpusStore,
    /// Keep uploaded scenarios on the stage as well.
    pub keep_staged: bool,
}

impl Remote {
    /// Checks that the store grants access, and rejects objects of others and a corpus that was started from a different sweep. Returns
    /// the split of that corpus, if it has one. In the place of a damaged one, the split of the stage holds; a damaged plan is replaced if
    /// this sweep has all scenarios that are there.
    pub(super) async fn look(
        &self,
        plan: &Plan,
        stage: &Path,
    ) -> Result<Option<Vec<u8>>, GenerateError> {
        self.store.check_place().await?;
        if let Some(theirs) = self.store.read(Corpus::PLAN).await?
            && self.agrees(plan, &theirs)?.is_none()
        {
            self.has_all_committed(plan).await?;
        }
        let Some(split) = self.store.read(Corpus::SPLITS).await? else {
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

    /// The plan of the store, if ours may replace it; `None` if it is damaged.
    fn agrees(&self, plan: &Plan, theirs: &[u8]) -> Result<Option<Plan>, GenerateError> {
        let Some(theirs) = Plan::parse_undamaged(theirs, &self.path_of(Corpus::PLAN))? else {
            return Ok(None);
        };
        match Difference::between(&theirs, plan).conflict() {
            Some(difference) => Err(GenerateError::OtherPlan {
                corpus: self.store.name().into(),
                difference,
            }),
            None => Ok(Some(theirs)),
        }
    }

    /// Rejects a plan that lacks a committed scenario, in the place of a damaged one.
    async fn has_all_committed(&self, plan: &Plan) -> Result<(), GenerateError> {
        let committed = self.store.listing().await?.committed();
        let is_planned = |id: &String| plan.scenarios.iter().any(|scenario| scenario.id == *id);
        if let Some(id) = committed.into_iter().find(|id| !is_planned(id)) {
            return Err(GenerateError::LostPlan {
                plan: self.path_of(Corpus::PLAN),
                id,
            });
        }
        tracing::warn!("the store's plan.json is damaged; this sweep's replaces it");
        Ok(())
    }

    /// The committed ones of `wanted` that are complete in the store, after checking their parameters. Scenarios with lost objects are sent
    /// or recorded again.
    pub(super) async fn committed(
        &self,
        wanted: &[&PlannedScenario],
    ) -> Result<BTreeMap<String, Seal>, GenerateError> {
        let listing = self.store.listing().await?;
        let ids = wanted.iter().map(|scenario| scenario.id.clone());
        let mut seals = BTreeMap::new();
        for (id, state) in self.store.states(&listing, ids).await? {
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
    pub(super) async fn publish(&self, stage: &Corpus, plan: &Plan) -> Result<(), GenerateError> {
        let files = [
            outside_file::read(&stage.plan_path(), FileKind::PLAN)?,
            outside_file::read(&stage.splits_path(), FileKind::json("split"))?,
            outside_file::read(&stage.sweep_path(), FileKind::SWEEP)?,
        ];
        let named = Corpus::FILES
            .into_iter()
            .zip(files.iter().map(Vec::as_slice));
        self.store
            .settle_files(named, |name, theirs, settled_plan| {
                Ok(match name {
                    Corpus::PLAN if self.agrees(plan, theirs)?.as_ref() == Some(plan) => {
                        Keep::Theirs
                    }
                    // A text that the plan was not expanded from is damaged, or of an interrupted run.
                    Corpus::SWEEP if plan.is_of_sweep(theirs) => settled_plan,
                    _ => Keep::Ours,
                })
            })
            .await
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
            // Other content is somebody's work: it stays.
            if whole.seal().is_ok_and(|ours| ours.as_ref() == Some(theirs)) {
                self.unstage(stage, id).await;
            }
        }
    }

    /// Removes a scenario from the stage once the store has it, of which the caller made sure, without ever leaving half of one under
    /// its name. It stays if its detections exist nowhere else.
    pub(super) async fn unstage(&self, stage: &Corpus, id: &str) {
        let [whole, partial] = [stage.scenario(id), stage.partial_scenario(id)];
        match self.store.has_detections_of(&whole).await {
            Ok(true) => {}
            Ok(false) => {
                tracing::warn!(
                    id,
                    "stays on the stage, for the store has not all of its detections; send them with `dtd push {} {}`",
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
        for name in self.store.names_in(FAILED).await? {
            let Some(id) = name.strip_suffix(".json") else {
                continue;
            };
            if committed.contains_key(id) {
                self.forget_failure(id).await;
            } else if to_make.iter().any(|scenario| scenario.id == id)
                && let Some(text) = self.store.read(&SetAside::name(id)).await?
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
            Ok::<_, GenerateError>(self.store.write(&SetAside::name(id), &text).await?)
        };
        if let Err(error) = told.await {
            tracing::warn!(id, %error, "why it failed is on the stage only");
        }
    }

    pub(super) async fn forget_failure(&self, id: &str) {
        if let Err(error) = self.store.remove(&SetAside::name(id)).await {
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
