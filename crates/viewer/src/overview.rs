//! Overview of the corpus, scenario by scenario: finished, being recorded, failed, planned, damaged. It is read again for every request,
//! because a corpus in the making changes.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::time::SystemTime;

use dataset::corpus::detections::models_of;
use dataset::corpus::scenario::ScenarioRecord;
use dataset::corpus::seal::faults_at_a_glance;
use dataset::corpus::seal::sealed::Sealed;
use dataset::corpus::set_aside::SetAside;
use dataset::corpus::splits::{Side, Splits};
use dataset::corpus::{Corpus, PARTIAL_SUFFIX, ScenarioFolder};
use dataset::error::Error;
use dataset::files::file_name;
use dataset::files::folder;
use dataset::files::own_path::own_path;
use dataset::plan::{Plan, PlannedScenario};
use dataset::video::recorded_pictures;
use serde::Serialize;

use crate::library::Library;
use crate::problems::Problems;

/// The whole corpus.
#[derive(Debug, Serialize)]
pub(crate) struct Overview {
    /// Folder name.
    corpus: String,
    /// The folder.
    folder: String,
    dtd: &'static str,
    scenarios: Vec<Row>,
    /// Names of the runs.
    runs: Vec<String>,
    /// Errors while reading.
    problems: Vec<String>,
}

/// Scenario progress.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
enum State {
    /// The recording has not begun.
    #[default]
    Planned,
    /// An unfinished folder is there.
    Recording,
    /// All attempts failed.
    Failed,
    /// The files contradict their seal.
    Damaged,
    /// Complete, without labels.
    Recorded,
    /// Labelled, without detections.
    Labelled,
    /// Labelled and searched.
    Detected,
}

/// A scenario.
#[derive(Debug, Default, Serialize)]
struct Row {
    id: String,
    state: State,
    weather: Option<String>,
    /// Differences between the weather at the aircraft and the planned weather; empty unless the scenario is marked.
    weather_differs: Vec<String>,
    time_of_day: Option<String>,
    trajectory: Option<String>,
    side: Option<Side>,
    /// Recorded ticks, or planned ones.
    ticks: Option<u32>,
    views: Vec<String>,
    /// File names of the models with detections, or hashes where the name is not known.
    models: Vec<String>,
    /// Images in an unfinished recording, by the view with the fewest.
    recorded_ticks: Option<u64>,
    /// Seconds since a file of an unfinished recording changed.
    unchanged_s: Option<u64>,
    /// Reason for its failure, or damage.
    faults: Vec<String>,
}

impl Row {
    fn new(id: &str, state: State) -> Self {
        Self {
            id: id.to_owned(),
            state,
            ..Self::default()
        }
    }

    fn add_plan(&mut self, planned: &PlannedScenario) {
        let PlannedScenario {
            weather,
            time_of_day,
            trajectory,
            ticks,
            ..
        } = planned;
        self.weather.get_or_insert_with(|| weather.clone());
        self.time_of_day.get_or_insert_with(|| time_of_day.clone());
        self.trajectory.get_or_insert_with(|| trajectory.clone());
        self.ticks.get_or_insert(*ticks);
    }

    fn add_record(&mut self, record: ScenarioRecord) {
        let differences = record.weather_marks();
        self.weather_differs = differences.iter().map(ToString::to_string).collect();
        self.weather = Some(record.weather_name().to_owned());
        self.time_of_day = Some(record.time_of_day().to_owned());
        self.trajectory = Some(record.trajectory);
        self.ticks = Some(record.ticks);
        self.views = record.views;
    }
}

pub(crate) fn read(library: &Library) -> Overview {
    let corpus = &library.corpus;
    let mut problems = Problems::default();
    let plan = problems.or_none(Plan::of_corpus(corpus));
    let splits = match corpus.splits() {
        // A corpus without a plan as well was not made by `dtd generate`.
        Err(_) if plan.is_none() => None,
        splits => problems.or_none(splits.map(Some)),
    };
    let failed = problems.or_none(SetAside::all(corpus));
    let folders = problems.or_none(corpus.folders());
    let partial = problems.or_none(partial_ids(corpus));
    let mut rows: BTreeMap<String, Row> = BTreeMap::new();
    for folder in folders {
        let row = finished(&folder);
        rows.insert(row.id.clone(), row);
    }
    let planned = || plan.iter().flat_map(|plan| &plan.scenarios);
    let ids: BTreeSet<&str> = planned()
        .map(|planned| planned.id.as_str())
        .chain(failed.keys().map(String::as_str))
        .chain(partial.iter().map(String::as_str))
        .collect();
    for id in ids {
        let row = rows
            .entry(id.to_owned())
            .or_insert_with(|| unfinished(corpus, id, partial.contains(id)));
        if let (State::Planned | State::Recording, Some(failed)) = (row.state, failed.get(id)) {
            row.faults.clone_from(&failed.reasons);
            if row.state == State::Planned {
                row.state = State::Failed;
            }
        }
    }
    for planned in planned() {
        if let Some(row) = rows.get_mut(&planned.id) {
            row.add_plan(planned);
        }
    }
    for row in rows.values_mut() {
        row.side = side_of(splits.as_ref(), &row.id);
    }
    let root = corpus.root();
    let real = root.canonicalize().unwrap_or_else(|_| root.to_owned());
    let name = real.file_name().unwrap_or(real.as_os_str());
    Overview {
        corpus: name.to_string_lossy().into_owned(),
        folder: real.display().to_string(),
        dtd: env!("CARGO_PKG_VERSION"),
        scenarios: rows.into_values().collect(),
        runs: library.runs.iter().map(|run| run.name.clone()).collect(),
        problems: problems.0,
    }
}

fn side_of(splits: Option<&Splits>, id: &str) -> Option<Side> {
    Some(splits?.scenarios.get(id)?.side)
}

/// A folder that is in its place.
fn finished(folder: &ScenarioFolder) -> Row {
    let id = folder.id();
    let row = file_name::check_id(&id)
        .map_err(|error| Error::corpus(folder.root(), error))
        .and_then(|()| sealed(folder));
    row.unwrap_or_else(|error| Row {
        faults: vec![error.to_string()],
        ..Row::new(&id, State::Damaged)
    })
}

fn sealed(folder: &ScenarioFolder) -> dataset::Result<Row> {
    let Some(sealed) = Sealed::read(folder.root())? else {
        return Err(Error::corpus(
            folder.root(),
            "has no DONE.json: it was never finished; make it with `dtd generate`",
        ));
    };
    folder.check_identity(&sealed)?;
    let mut row = Row::new(&folder.id(), State::Recorded);
    row.add_record(ScenarioRecord::read(&sealed.check("scenario.json")?)?);
    for model in models_of(folder)? {
        row.models
            .push(dataset::corpus::detections::named(folder, &model).to_string());
    }
    row.faults = faults_at_a_glance(folder.root())?;
    if !row.faults.is_empty() {
        row.state = State::Damaged;
    } else if !row.models.is_empty() {
        row.state = State::Detected;
    } else if sealed.hash_of(ScenarioFolder::TRUTH_BOXES).is_some() {
        row.state = State::Labelled;
    }
    Ok(row)
}

/// Identifiers of the folders that are being filled.
fn partial_ids(corpus: &Corpus) -> dataset::Result<BTreeSet<String>> {
    let folder = own_path(corpus.root(), "scenarios")?;
    let names = folder::names(&folder)?.into_iter();
    Ok(names
        .filter_map(|name| Some(name.strip_suffix(PARTIAL_SUFFIX)?.to_owned()))
        .collect())
}

fn unfinished(corpus: &Corpus, id: &str, is_begun: bool) -> Row {
    let mut row = Row::new(id, State::Planned);
    if !is_begun {
        return row;
    }
    row.state = State::Recording;
    let folder = corpus.partial_scenario(id);
    let Ok(views) = own_path(folder.root(), "views") else {
        return row;
    };
    let mut changed = changed_at(folder.root());
    for entry in fs::read_dir(&views).into_iter().flatten().flatten() {
        let path = entry.path();
        changed = changed.max(changed_at(&path));
        if let Some(view) = path.file_stem() {
            row.views.push(view.to_string_lossy().into_owned());
        }
        // A finished video has all images of its scenario.
        if let Ok(Some(pictures)) = recorded_pictures(&path) {
            let least = row.recorded_ticks.unwrap_or(u64::MAX);
            row.recorded_ticks = Some(pictures.min(least));
        }
    }
    row.views.sort();
    row.unchanged_s = changed
        .and_then(|changed| SystemTime::now().duration_since(changed).ok())
        .map(|since| since.as_secs());
    row
}

fn changed_at(path: &Path) -> Option<SystemTime> {
    path.symlink_metadata().ok()?.modified().ok()
}
