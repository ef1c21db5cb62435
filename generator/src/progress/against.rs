//! Compares a plan with an existing corpus: complete, missing and mismatched scenarios.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use dataset::corpus::effective_weather::ReportedWeather;
use dataset::corpus::scenario::ScenarioRecord;
use dataset::corpus::seal::{self, Seal};
use dataset::corpus::{Corpus, ScenarioFolder};
use dataset::files::folder::bytes_below;
use dataset::plan::{Difference, Plan, PlannedScenario};
use futures_util::future::{LocalBoxFuture, try_join_all};
use serde::Serialize;
use store::{Committed, Connection, CorpusStore, Logged, StoreError};

use crate::generate::FolderState;
use crate::plan::MeasuredSize;
use crate::progress::Pace;

/// Records that are read from an object store at the same time.
const QUESTIONS_AT_ONCE: usize = 16;

/// Scenario state in a corpus.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Standing {
    /// Sealed in the corpus, with exactly the same parameters.
    Whole,
    /// Planned in the corpus, not yet recorded.
    ToMake,
    /// New in this plan.
    New,
    /// Present in the corpus with different parameters.
    Changed,
    /// Present without a seal, or with missing or truncated files: its folder must be moved away before the scenario can be recorded again.
    Damaged,
}

/// Difference between a plan and a corpus.
#[derive(Debug, Clone, PartialEq)]
pub struct Against {
    /// Scenarios that the plan adds to, changes in and removes from the corpus's plan.
    pub difference: Difference,
    /// State per scenario, in plan order.
    pub standings: Vec<Standing>,
    /// Faults of the damaged ones, by identifier.
    pub damaged: BTreeMap<String, String>,
    /// Weather reported by simulators at the aircraft in the complete scenarios, by name of the planned weather.
    pub weather: BTreeMap<String, ReportedWeather>,
    /// Size of the complete scenarios, if their images match the plan's.
    pub size: Option<MeasuredSize>,
    /// Pace of the corpus's recordings.
    pub pace: Option<Pace>,
}

impl Against {
    /// Compares a plan with a corpus; a corpus without a plan is empty.
    pub fn compare(plan: &Plan, corpus: &Corpus) -> dataset::Result<Self> {
        let frozen = if corpus.plan_path().exists() {
            Some(Plan::read(&corpus.plan_path())?)
        } else {
            None
        };
        let (mut seals, mut damaged) = (BTreeMap::new(), BTreeMap::new());
        for scenario in &plan.scenarios {
            let folder = corpus.scenario(&scenario.id);
            match FolderState::of(&folder, seal::faults_at_a_glance)? {
                FolderState::Absent => {}
                FolderState::Sealed(seal) => {
                    seals.insert(scenario.id.clone(), seal);
                }
                FolderState::Damaged(what) => {
                    damaged.insert(scenario.id.clone(), what);
                }
            }
        }
        let mut against = Self::of(plan, frozen.as_ref(), &seals, damaged);
        let records = against.records(plan, corpus)?;
        against.weather = ReportedWeather::by_name(&records);
        let alike = |frozen: &Plan| {
            frozen.common.picture == plan.common.picture && frozen.common.video == plan.common.video
        };
        if frozen.as_ref().is_some_and(alike) {
            against.size = measure(&records, corpus)?;
            against.pace = Pace::of_corpus(corpus, seals.keys());
        }
        Ok(against)
    }

    /// Compares a plan with a corpus in an object store: reads plan, seals and records from there.
    pub fn compare_with_store<'a>(
        plan: &'a Plan,
        store: &'a CorpusStore,
    ) -> LocalBoxFuture<'a, Result<Self, StoreError>> {
        Box::pin(async move {
            let name = store.name();
            let path = Path::new(name).join(Corpus::PLAN);
            let store = store.watched(&Logged);
            let frozen = match store.read(Corpus::PLAN).await? {
                Some(bytes) => {
                    let frozen = Plan::parse_undamaged(&bytes, &path)?;
                    if frozen.is_none() {
                        tracing::warn!(
                            "the store's plan.json is damaged; `dtd generate` with the sweep of the corpus writes it again"
                        );
                    }
                    frozen
                }
                None => None,
            };
            let ids = plan.scenarios.iter().map(|scenario| scenario.id.clone());
            let (mut seals, mut damaged) = (BTreeMap::new(), BTreeMap::new());
            for (id, state) in store.states(ids).await? {
                match state {
                    Committed::Whole(seal) => {
                        seals.insert(id, seal);
                    }
                    Committed::Damaged(faults) => {
                        damaged.insert(id, faults.to_string());
                    }
                    Committed::No => {}
                }
            }
            let mut against = Self::of(plan, frozen.as_ref(), &seals, damaged);
            let whole = against.standing(plan, Standing::Whole);
            let whole: Vec<&str> = whole.map(|scenario| scenario.id.as_str()).collect();
            let mut records = Vec::new();
            for ids in whole.chunks(QUESTIONS_AT_ONCE) {
                let asked = ids.iter().map(|id| record_in_store(&store, name, id));
                records.extend(try_join_all(asked).await?.into_iter().flatten());
            }
            against.weather = ReportedWeather::by_name(&records);
            Ok(against)
        })
    }

    fn of(
        plan: &Plan,
        frozen: Option<&Plan>,
        seals: &BTreeMap<String, Seal>,
        damaged: BTreeMap<String, String>,
    ) -> Self {
        let difference = match frozen {
            Some(frozen) => Difference::between(frozen, plan),
            None => {
                let nothing = Plan {
                    scenarios: Vec::new(),
                    ..plan.clone()
                };
                Difference::between(&nothing, plan)
            }
        };
        let added: BTreeSet<&str> = difference.added.iter().map(String::as_str).collect();
        let changed: BTreeSet<&str> = difference.changed.iter().map(|c| c.id.as_str()).collect();
        let standing = |scenario: &PlannedScenario| match seals.get(&scenario.id) {
            _ if changed.contains(scenario.id.as_str()) => Standing::Changed,
            _ if damaged.contains_key(&scenario.id) => Standing::Damaged,
            Some(seal) if seal.config_hash == scenario.config_hash => Standing::Whole,
            Some(_) => Standing::Changed,
            None if added.contains(scenario.id.as_str()) => Standing::New,
            None => Standing::ToMake,
        };
        let standings = plan.scenarios.iter().map(standing).collect();
        Self {
            difference,
            standings,
            damaged,
            weather: BTreeMap::new(),
            size: None,
            pace: None,
        }
    }

    /// Planned scenarios in this state.
    pub fn standing<'a>(
        &'a self,
        plan: &'a Plan,
        standing: Standing,
    ) -> impl Iterator<Item = &'a PlannedScenario> {
        let pairs = plan.scenarios.iter().zip(&self.standings);
        pairs.filter_map(move |(scenario, its)| (*its == standing).then_some(scenario))
    }

    fn records(&self, plan: &Plan, corpus: &Corpus) -> dataset::Result<Vec<ScenarioRecord>> {
        let whole = self.standing(plan, Standing::Whole);
        whole
            .map(|scenario| corpus.scenario(&scenario.id).open()?.record())
            .collect()
    }
}

fn measure(records: &[ScenarioRecord], corpus: &Corpus) -> dataset::Result<Option<MeasuredSize>> {
    let mut size = MeasuredSize {
        bytes: 0,
        pictures: 0,
        scenarios: 0,
    };
    for record in records {
        size.bytes += bytes_below(corpus.scenario(&record.id).root())?;
        size.pictures += record.pictures();
        size.scenarios += 1;
    }
    Ok((size.scenarios > 0).then_some(size))
}

/// The record of a scenario in an object store, if it is still there.
async fn record_in_store(
    store: &Connection<'_>,
    url: &str,
    id: &str,
) -> Result<Option<ScenarioRecord>, StoreError> {
    match store.sealed_file(id, ScenarioFolder::RECORD).await? {
        Some(bytes) => {
            let name = format!("scenarios/{id}/{}", ScenarioFolder::RECORD);
            let path = Path::new(url).join(name);
            Ok(Some(ScenarioRecord::parse(&bytes, &path)?))
        }
        None => Ok(None),
    }
}
