//! Paths and committed scenarios of the corpus folder.
//!
//! ```text
//! corpus/
//!   corpus.toml  plan.json  splits.json
//!   scenarios/1700-foggy-r3/
//!     scenario.json  calibration.json  frames.parquet  boxes_truth.parquet
//!     views/<camera>.mp4  detections/<model>.parquet  detections/<model>.json
//!     registrations/<model>.parquet  health/<model>.parquet  backgrounds/<model>.parquet
//!     MANIFEST.b3  DONE.json
//! ```

pub mod calibration;
pub mod claim;
mod destination;
pub mod detections;
pub mod effective_weather;
pub mod model_identity;
pub mod open_scenario;
pub mod scenario;
pub mod seal;
pub mod set_aside;
pub mod splits;
pub mod workshop;

use std::collections::BTreeSet;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::corpus::claim::{CLAIMS, Claim, Claimed, Holder};
use crate::corpus::seal::{MANIFEST, Seal};
use crate::corpus::splits::Splits;
use crate::error::{Error, Result};
use crate::files::corpus_names;
use crate::files::corpus_names::{CALIBRATION, DETECTIONS, SCENARIOS, WHOLE_CORPUS};
use crate::files::folder;
use crate::files::own_path::{own_path, refuse_link};

pub use crate::files::corpus_names::PARTIAL_SUFFIX;
pub(crate) use destination::check_path;
pub use destination::{check_place, foreign_entries, is_plan, own_folder_around};

/// A scenario's change takes milliseconds, an upload takes longer; a process that takes longer than this may hang.
const OTHERS_TAKE: Duration = Duration::from_secs(30);

/// A corpus on disk.
#[derive(Debug, Clone)]
pub struct Corpus {
    root: PathBuf,
    /// Identifiers of scenarios that are treated as absent.
    left_out: BTreeSet<String>,
}

/// A committed scenario that cannot be opened.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DamagedScenario {
    /// Identifier of the scenario.
    pub id: String,
    /// The fault.
    pub reason: String,
}

/// A scenario's folder.
#[derive(Debug, Clone)]
pub struct ScenarioFolder {
    corpus: Corpus,
    root: PathBuf,
}

impl Corpus {
    /// The expanded plan.
    pub const PLAN: &str = "plan.json";
    /// The split by trajectory.
    pub const SPLITS: &str = "splits.json";
    /// The sweep as its author wrote it.
    pub const SWEEP: &str = "corpus.toml";
    /// The files that belong to the whole corpus, in the order of writing.
    pub const FILES: [&str; 3] = [Self::PLAN, Self::SPLITS, Self::SWEEP];

    /// Returns true for a corpus with a plan or a split. A folder that only has scenarios may belong to a different program.
    pub fn is_at(root: &Path) -> bool {
        root.join(SCENARIOS).is_dir()
            && [Self::PLAN, Self::SPLITS]
                .iter()
                .any(|name| root.join(name).is_file())
    }

    /// Opens an existing corpus.
    pub fn open(root: &Path) -> Result<Self> {
        check_path(root)?;
        let scenarios = root.join(SCENARIOS);
        match scenarios.metadata() {
            Ok(about) if about.is_dir() => {}
            Err(error) if error.kind() == ErrorKind::PermissionDenied => {
                return Err(Error::io("look at", &scenarios)(error));
            }
            _ => {
                return Err(Error::NotACorpus {
                    path: root.to_owned(),
                });
            }
        }
        own_path(root, SCENARIOS)?;
        Ok(Self::at(root))
    }

    /// Opens a corpus, creating missing folders.
    pub fn create(root: &Path) -> Result<Self> {
        check_path(root)?;
        let scenarios = own_path(root, SCENARIOS)?;
        fs::create_dir_all(&scenarios).map_err(Error::io("create", &scenarios))?;
        Ok(Self::at(root))
    }

    fn at(root: &Path) -> Self {
        Self {
            root: root.to_owned(),
            left_out: BTreeSet::new(),
        }
    }

    /// This corpus without its damaged scenarios, and those: for readers of the whole corpus, which a damaged scenario would end.
    ///
    /// # Errors
    /// The corpus cannot be listed, or the disk fails.
    pub fn without_damaged(&self) -> Result<(Self, Vec<DamagedScenario>)> {
        let mut sound = self.clone();
        let mut damaged = Vec::new();
        for scenario in self.scenarios()? {
            match scenario.open() {
                Ok(_) => {}
                Err(error) if error.is_damage() => {
                    sound.left_out.insert(scenario.id());
                    damaged.push(DamagedScenario {
                        id: scenario.id(),
                        reason: error.to_string(),
                    });
                }
                Err(error) => return Err(error),
            }
        }
        Ok((sound, damaged))
    }

    /// This corpus without these scenarios.
    #[must_use]
    pub fn without(mut self, ids: impl IntoIterator<Item = String>) -> Self {
        self.left_out.extend(ids);
        self
    }

    /// The folder of the corpus.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Path of [`Self::SWEEP`].
    pub fn sweep_path(&self) -> PathBuf {
        self.root.join(Self::SWEEP)
    }

    /// Path of [`Self::PLAN`].
    pub fn plan_path(&self) -> PathBuf {
        self.root.join(Self::PLAN)
    }

    /// Path of [`Self::SPLITS`].
    pub fn splits_path(&self) -> PathBuf {
        self.root.join(Self::SPLITS)
    }

    /// The claim to hold while changing files of the whole corpus. Waits for other writers.
    ///
    /// # Errors
    /// A different process holds it for too long ([`Error::Held`]), or the corpus cannot be written.
    pub fn claim(&self) -> Result<Claim> {
        Claim::wait_in(&self.claims(), WHOLE_CORPUS, &self.root, OTHERS_TAKE)
    }

    /// Reads the split by trajectory.
    ///
    /// # Errors
    /// It does not exist, leaks, or is a symbolic link.
    pub fn splits(&self) -> Result<Splits> {
        Splits::read(&own_path(&self.root, Self::SPLITS)?)
    }

    /// A committed scenario's folder.
    pub fn scenario(&self, id: &str) -> ScenarioFolder {
        self.folder(id)
    }

    /// The folder where a scenario is recorded before it is committed.
    pub fn partial_scenario(&self, id: &str) -> ScenarioFolder {
        self.folder(&format!("{id}{PARTIAL_SUFFIX}"))
    }

    fn claims(&self) -> PathBuf {
        self.root.join(CLAIMS)
    }

    fn folder(&self, name: &str) -> ScenarioFolder {
        ScenarioFolder {
            corpus: self.clone(),
            root: self.root.join(SCENARIOS).join(name),
        }
    }

    /// All committed scenarios, sorted by identifier. A folder without seal and scenario files does not count; one whose seal is damaged or
    /// lost does, and is rejected when it is opened, so that it does not hide the others, unless it is left out
    /// ([`Self::without_damaged`]).
    pub fn scenarios(&self) -> Result<Vec<ScenarioFolder>> {
        let mut committed = Vec::new();
        for scenario in self.folders()? {
            match scenario.seal() {
                Ok(None) if !scenario.has_files() => {}
                Ok(_) => committed.push(scenario),
                Err(error) if error.is_damage() => committed.push(scenario),
                Err(error) => return Err(error),
            }
        }
        Ok(committed)
    }

    /// All folders that may be scenarios, sorted: those without the suffix for unfinished ones.
    pub fn folders(&self) -> Result<Vec<ScenarioFolder>> {
        let folder = own_path(&self.root, SCENARIOS)?;
        let mut found = Vec::new();
        for id in folder::names(&folder)? {
            let scenario = self.folder(&id);
            if !id.ends_with(PARTIAL_SUFFIX)
                && scenario.root.is_dir()
                && !self.left_out.contains(&id)
            {
                found.push(scenario);
            }
        }
        found.sort_by(|a, b| a.root.cmp(&b.root));
        Ok(found)
    }
}

impl Claim {
    /// Takes a claim in a corpus, or names its holder.
    pub fn take(corpus: &Corpus, name: &str) -> Result<Claimed> {
        Self::take_in(&corpus.claims(), name)
    }

    /// The process that a claim's file names, without locking it; it may have been killed.
    pub fn holder(corpus: &Corpus, name: &str) -> Option<Holder> {
        Holder::of_file(&corpus.claims().join(name))
    }

    /// Deletes the claims of killed processes in a corpus, and no other files there.
    pub fn tidy(corpus: &Corpus) {
        Self::tidy_in(&corpus.claims());
    }
}

impl ScenarioFolder {
    /// The folder itself.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Identifier of the scenario: the folder's name.
    pub fn id(&self) -> String {
        self.root
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned()
    }

    /// True if it has scenario files.
    fn has_files(&self) -> bool {
        let mut names = Self::FILES.into_iter().chain([MANIFEST, "views"]);
        names.any(|name| self.root.join(name).exists())
    }

    /// Path of `scenario.json`.
    pub fn record_path(&self) -> PathBuf {
        self.root.join(Self::RECORD)
    }

    /// Path of `calibration.json`.
    pub fn calibration_path(&self) -> PathBuf {
        self.root.join(CALIBRATION)
    }

    /// Path of `frames.parquet`.
    pub fn frames_path(&self) -> PathBuf {
        self.current_path(Self::FRAMES)
    }

    fn current_path(&self, name: &str) -> PathBuf {
        seal::current_path(&self.root, name).unwrap_or_else(|_| self.root.join(name))
    }

    /// Path of `boxes_truth.parquet`.
    pub fn truth_boxes_path(&self) -> PathBuf {
        self.current_path(Self::TRUTH_BOXES)
    }

    /// Path of `aircraft.parquet`.
    pub fn aircraft_path(&self) -> PathBuf {
        self.current_path(Self::AIRCRAFT)
    }

    /// Path of the view's video, sealed or not.
    pub fn video_path(&self, view: &str) -> PathBuf {
        self.root.join("views").join(format!("{view}.mp4"))
    }

    /// Path of the model's detections.
    pub fn detections_path(&self, model_hash: &str) -> PathBuf {
        self.root
            .join(DETECTIONS)
            .join(format!("{model_hash}.parquet"))
    }

    /// A scenario's files except videos, detections with their tables, and seal.
    pub const FILES: [&str; 5] = corpus_names::FILES;
    /// Name of the record.
    pub const RECORD: &str = corpus_names::RECORD;
    /// Name of the table of ticks.
    pub const FRAMES: &str = corpus_names::FRAMES;
    /// Name of the table of ground-truth boxes.
    pub const TRUTH_BOXES: &str = corpus_names::TRUTH_BOXES;
    /// Name of the table of all aircraft, which scenarios with traffic have.
    pub const AIRCRAFT: &str = corpus_names::AIRCRAFT;

    /// The folder's seal, if it is complete.
    pub fn seal(&self) -> Result<Option<Seal>> {
        refuse_link(&self.root)?;
        if self.root.is_dir() {
            seal::read_seal(&self.root)
        } else {
            Ok(None)
        }
    }

    /// The claim to hold while changing the scenario. Waits for other writers.
    ///
    /// # Errors
    /// A different process holds it for too long ([`Error::Held`]), or the corpus cannot be written.
    pub fn claim(&self) -> Result<Claim> {
        Claim::wait_in(&self.corpus.claims(), &self.id(), &self.root, OTHERS_TAKE)
    }

    /// The right to search the scenario, which several processes share; others may read and label it meanwhile. Does not wait.
    pub fn claim_search(&self) -> Result<Claimed> {
        Claim::take(&self.corpus, &format!("detect-{}", self.id()))
    }
}
