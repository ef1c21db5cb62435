//! Progress of a corpus, from its files alone: the process that makes it may run on a different machine.

pub mod against;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::time::{Duration, SystemTime};

use dataset::corpus::claim::Claim;
use dataset::corpus::seal;
use dataset::corpus::set_aside::{self, SetAside};
use dataset::corpus::{Corpus, ScenarioFolder};
use dataset::files::corpus_names::DETECTIONS;
use dataset::plan::Plan;
use serde::Serialize;
use store::{CorpusStore, Logged, StoreError};

use crate::generate::FolderState;

/// A gap this long between two completed scenarios is a break of the work: twice the time that an X-Plane needs for a scenario with two
/// views at 8 images per second.
const PAUSE: Duration = Duration::from_secs(3_600);

/// Scenarios of a corpus by stage.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Status {
    /// Name of the corpus.
    pub corpus: String,
    /// Scenarios in its plan.
    pub planned: usize,
    /// Recorded ones.
    pub recorded: usize,
    /// Recorded ones with labels.
    pub labelled: usize,
    /// Recorded ones with detections.
    pub searched: usize,
    /// Scenarios that are being recorded, or were when their process ended.
    pub in_work: Vec<InWork>,
    /// Scenarios that failed all attempts, with the reasons. The next run tries them again.
    pub failed: BTreeMap<String, Vec<String>>,
    /// Scenarios with faulty files.
    pub damaged: BTreeMap<String, String>,
    /// Absent before two scenarios are recorded.
    pub pace: Option<Pace>,
    /// Time until the missing scenarios are recorded at this pace, seconds.
    pub left_s: Option<f64>,
}

/// A scenario that is not complete yet.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct InWork {
    /// Identifier of the scenario.
    pub id: String,
    /// Seconds since its files were last written.
    pub written_s_ago: f64,
    /// The process that holds it.
    pub by: Option<String>,
}

/// Pace at which all processes together complete scenarios.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Pace {
    /// Mean time from one completed scenario to the next, seconds.
    pub s_per_scenario: f64,
    /// Number of these times.
    pub of: usize,
    /// When the last scenario was completed.
    #[serde(skip)]
    pub last: SystemTime,
}

impl Pace {
    /// Pace of these scenarios.
    pub(crate) fn of_corpus<'a>(
        corpus: &Corpus,
        ids: impl Iterator<Item = &'a String>,
    ) -> Option<Self> {
        let completed =
            ids.filter_map(|id| last_written(&corpus.scenario(id).root().join("views")));
        Self::of(completed.collect())
    }

    /// Pace by the times at which scenarios were completed. Breaks of the work do not count.
    pub fn of(mut completed: Vec<SystemTime>) -> Option<Self> {
        completed.sort();
        let pairs = completed.windows(2);
        let steps = pairs.filter_map(|pair| pair[1].duration_since(pair[0]).ok());
        let steps: Vec<Duration> = steps.filter(|step| *step < PAUSE).collect();
        let total_s = steps.iter().sum::<Duration>().as_secs_f64();
        let last = completed.last().filter(|_| !steps.is_empty())?;
        Some(Self {
            s_per_scenario: total_s / steps.len() as f64,
            of: steps.len(),
            last: *last,
        })
    }
}

impl Status {
    /// Status of a corpus in a folder.
    ///
    /// # Errors
    /// It was generated and has no readable plan, or cannot be listed.
    pub fn of_folder(corpus: &Corpus) -> dataset::Result<Self> {
        let is_imported = !corpus.plan_path().exists() && !corpus.sweep_path().exists();
        let (name, planned) = if is_imported {
            // An import plans what it has.
            let ids = corpus.folders()?.iter().map(ScenarioFolder::id).collect();
            (corpus.root().display().to_string(), ids)
        } else {
            let plan = Plan::read(&corpus.plan_path())?;
            let ids: Vec<String> = plan.scenarios.into_iter().map(|of| of.id).collect();
            (plan.corpus, ids)
        };
        let mut status = Self::empty(name, planned.len());
        let mut recorded = Vec::new();
        for id in &planned {
            let folder = corpus.scenario(id);
            match FolderState::of(&folder, seal::faults_at_a_glance)? {
                FolderState::Sealed(_) => {
                    status.recorded += 1;
                    let is_labelled = is_imported || folder.truth_boxes_path().exists();
                    status.labelled += usize::from(is_labelled);
                    let detections = last_written(&folder.root().join(DETECTIONS));
                    status.searched += usize::from(detections.is_some());
                    recorded.push(id.clone());
                }
                FolderState::Damaged(what) => {
                    status.damaged.insert(id.clone(), what);
                }
                FolderState::Absent => status.in_work.extend(in_work(corpus, id)),
            }
        }
        let failed = SetAside::all(corpus)?.into_iter();
        status.failed = failed.map(|(id, record)| (id, record.reasons)).collect();
        Ok(status.at(Pace::of_corpus(corpus, recorded.iter())))
    }

    /// Status of a corpus in an object store. Scenarios in work are on the machines that record them.
    ///
    /// # Errors
    /// It has no readable plan, or the store does not answer.
    pub async fn of_store(store: &CorpusStore) -> Result<Self, StoreError> {
        let name = store.name();
        let store = store.watched(&Logged);
        let plan = store.read(Corpus::PLAN).await?;
        let plan = plan.ok_or_else(|| store.nothing_committed())?;
        let plan = Plan::parse(&plan, &Path::new(name).join(Corpus::PLAN))?;
        let mut status = Self::empty(plan.corpus.clone(), plan.scenarios.len());
        let listing = store.listing().await?;
        let mut completed = Vec::new();
        for scenario in &plan.scenarios {
            let Some(stored) = listing.scenario(&scenario.id) else {
                continue;
            };
            status.recorded += 1;
            status.labelled += usize::from(stored.is_labelled);
            status.searched += usize::from(stored.is_searched);
            completed.extend(stored.recorded);
        }
        for name in store.names_in(set_aside::FOLDER).await? {
            let Some(id) = name.strip_suffix(".json") else {
                continue;
            };
            let text = store.read(&SetAside::name(id)).await?;
            let record = text.map(|text| serde_json::from_slice::<SetAside>(&text));
            match record.transpose() {
                Ok(record) => status
                    .failed
                    .extend(record.map(|record| (id.to_owned(), record.reasons))),
                Err(error) => tracing::warn!(id, %error, "the record of its failure is ignored"),
            }
        }
        Ok(status.at(Pace::of(completed)))
    }

    fn empty(corpus: String, planned: usize) -> Self {
        Self {
            corpus,
            planned,
            recorded: 0,
            labelled: 0,
            searched: 0,
            in_work: Vec::new(),
            failed: BTreeMap::new(),
            damaged: BTreeMap::new(),
            pace: None,
            left_s: None,
        }
    }

    fn at(mut self, pace: Option<Pace>) -> Self {
        let left = self.planned - self.recorded - self.damaged.len();
        self.pace = pace;
        self.left_s = pace.map(|pace| {
            let since_s = pace.last.elapsed().unwrap_or_default().as_secs_f64();
            let is_in_work = left > 0 && !self.in_work.is_empty();
            let begun_s = if is_in_work {
                since_s.min(pace.s_per_scenario)
            } else {
                0.0
            };
            pace.s_per_scenario * left as f64 - begun_s
        });
        self
    }
}

/// When the last file directly in a folder was written; `None` without files.
fn last_written(folder: &Path) -> Option<SystemTime> {
    let entries = fs::read_dir(folder).ok()?.flatten();
    let times = entries.filter_map(|entry| entry.metadata().ok()?.modified().ok());
    times.max()
}

/// The unfinished recording of a scenario, if there is one.
fn in_work(corpus: &Corpus, id: &str) -> Option<InWork> {
    let folder = corpus.partial_scenario(id).root().to_owned();
    let written = last_written(&folder.join("views")).max(last_written(&folder))?;
    Some(InWork {
        id: id.to_owned(),
        written_s_ago: written.elapsed().unwrap_or_default().as_secs_f64(),
        by: Claim::holder(corpus, id).map(|holder| holder.to_string()),
    })
}

#[cfg(test)]
mod tests {
    use std::time::UNIX_EPOCH;

    use super::*;

    #[test]
    fn a_stop_of_the_work_does_not_slow_the_pace() {
        let at = |seconds: u64| UNIX_EPOCH + Duration::from_secs(seconds);
        let completed = vec![at(300), at(0), at(110), at(200), at(90_300), at(90_400)];
        let pace = Pace::of(completed).unwrap();
        assert_eq!((pace.s_per_scenario, pace.of), (100.0, 4));
        assert_eq!(Pace::of(vec![at(7)]), None);
        // Four simulators that finish together.
        let in_step = (0..10).flat_map(|round| [0, 1, 1, 2].map(|late| at(96 * round + late)));
        let pace = Pace::of(in_step.collect()).unwrap();
        assert!((22.0..25.0).contains(&pace.s_per_scenario), "{pace:?}");
    }
}
