//! `PAPER.json`: an experiment's settings and findings.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use dataset::corpus::claim::Claim;
use dataset::corpus::workshop::{CLAIM, Workshop, lock};
use dataset::files::json_file::{read_json, write_json};
use paper_experiment::{Range, StageTime, WeakerDetector};
use serde::{Deserialize, Serialize};
use trainer::TrainConfig;

use super::{OF_TRAINING, Place, RUNS};
use crate::failure::Failure;

const FILE: &str = "PAPER.json";
const MADE_BY: &str = "dtd paper";
/// Files and folders of the page.
const PAGE: [&str; 3] = ["paper.md", "results", "images"];

/// Settings that stay the same from call to call.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Settings {
    pub(super) scale: String,
    pub(super) plan_hash: String,
    /// Hash of the detector and its settings.
    pub(super) model_blake3: String,
    /// Version of this software.
    pub(super) dtd: String,
    pub(super) training: TrainConfig,
}

/// A stage, and the time of all calls but those that were killed in it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Stage {
    name: String,
    seconds: f64,
    is_done: bool,
}

/// The content of the file.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    made_by: String,
    settings: Settings,
    stages: Vec<Stage>,
    found: Found,
}

/// Findings of stages, for later ones.
#[derive(Debug, Default, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Found {
    /// Name of the detections of the detector.
    pub(super) detections: Option<String>,
    pub(super) weaker_detections: Option<String>,
    pub(super) weaker: Option<WeakerDetector>,
    /// The recommended estimator.
    pub(super) recommended: Option<String>,
    /// Standard deviation of the training flights to the side, metres.
    #[serde(default)]
    pub(super) lateral_spread_m: Option<f64>,
    pub(super) ranges: Vec<Range>,
}

/// The file, locked until this is dropped.
pub(super) struct Notes {
    path: PathBuf,
    settings: Settings,
    stages: Vec<Stage>,
    pub(super) found: Found,
    _claim: Claim,
}

impl Notes {
    /// The notes in a folder, which is created if it is missing. A folder of others, or of other settings, is rejected. Other settings of
    /// the training repeat its stages, unless trainings would be lost.
    pub(super) fn open(folder: &Path, settings: Settings) -> Result<Self, Failure> {
        let claim = lock(folder, folder, Duration::ZERO).map_err(Failure::of_corpus)?;
        let path = folder.join(FILE);
        let mut notes = Self {
            path,
            settings,
            stages: Vec::new(),
            found: Found::default(),
            _claim: claim.in_existing_folder(),
        };
        if notes.path.exists() {
            let written: Written =
                read_json(&notes.path, "notes of dtd paper").map_err(Failure::bad_input)?;
            notes.refuse_other(folder, &written.settings)?;
            notes.stages = written.stages;
            notes.found = written.found;
            let is_otherwise = written.settings.training != notes.settings.training;
            if is_otherwise {
                refuse_to_lose_runs(folder)?;
            }
            if is_otherwise || notes.lacks_a_run(folder) {
                notes.train_again()?;
            }
        } else {
            refuse_others(folder)?;
            notes.write()?;
        }
        Ok(notes)
    }

    fn refuse_other(&self, folder: &Path, earlier: &Settings) -> Result<(), Failure> {
        let (now, before) = (&self.settings, earlier);
        let difference = if now.scale != before.scale {
            format!("--scale {}, now it is {}", before.scale, now.scale)
        } else if now.plan_hash != before.plan_hash {
            "another sweep or frame rate".into()
        } else if now.dtd != before.dtd {
            format!("dtd {}, now it is {}", before.dtd, now.dtd)
        } else if now.model_blake3 != before.model_blake3 {
            "another detector".into()
        } else {
            return Ok(());
        };
        Err(Failure::bad_input_message(format!(
            "{} was started with {difference}; start the command as before, or name another --out",
            folder.display()
        )))
    }

    /// True if the run of a completed training is gone.
    fn lacks_a_run(&self, folder: &Path) -> bool {
        RUNS.iter().any(|(stage, run)| {
            self.done_in_s(stage).is_some() && !folder.join(run.name()).exists()
        })
    }

    /// Forgets what trainings gave. Stages keep their order.
    fn train_again(&mut self) -> Result<(), Failure> {
        let of_training = |stage: &&mut Stage| OF_TRAINING.contains(&stage.name.as_str());
        for stage in self.stages.iter_mut().filter(of_training) {
            if stage.is_done {
                eprintln!("paper: {}: to be repeated", stage.name);
            }
            (stage.seconds, stage.is_done) = (0.0, false);
        }
        self.write()
    }

    /// Time of a completed stage, seconds.
    pub(super) fn done_in_s(&self, name: &str) -> Option<f64> {
        let stage = self.stages.iter().find(|stage| stage.name == name)?;
        stage.is_done.then_some(stage.seconds)
    }

    /// Adds a stage's time.
    pub(super) fn add(&mut self, name: &str, took: Duration, is_done: bool) -> Result<(), Failure> {
        let known = self.stages.iter_mut().find(|stage| stage.name == name);
        match known {
            Some(stage) => {
                stage.seconds += took.as_secs_f64();
                stage.is_done = is_done;
            }
            None => self.stages.push(Stage {
                name: name.into(),
                seconds: took.as_secs_f64(),
                is_done,
            }),
        }
        self.write()
    }

    /// All stages and their times.
    pub(super) fn times(&self) -> Vec<StageTime> {
        let stages = self.stages.iter();
        stages
            .map(|stage| StageTime {
                stage: stage.name.clone(),
                seconds: stage.seconds,
            })
            .collect()
    }

    /// Name of the detections of the detector.
    pub(super) fn detections(&self) -> Result<String, Failure> {
        self.noted(self.found.detections.clone())
    }

    /// A finding that a stage must have noted.
    pub(super) fn noted<T>(&self, value: Option<T>) -> Result<T, Failure> {
        value.ok_or_else(|| {
            Failure::bad_input_message(format!(
                "{} lacks what its stages found; name another --out",
                self.path.display()
            ))
        })
    }

    fn write(&self) -> Result<(), Failure> {
        let written = Written {
            made_by: MADE_BY.into(),
            settings: self.settings.clone(),
            stages: self.stages.clone(),
            found: self.found.clone(),
        };
        write_json(&self.path, &written).map_err(Failure::bad_input)
    }
}

/// Rejects a folder with trainings, finished or not, that others would replace.
fn refuse_to_lose_runs(folder: &Path) -> Result<(), Failure> {
    let runs = RUNS.iter().flat_map(|(_, run)| {
        let run = folder.join(run.name());
        [Workshop::beside(&run), run]
    });
    let trained: Vec<String> = (runs.filter(|run| run.exists()))
        .map(|run| run.display().to_string())
        .collect();
    if trained.is_empty() {
        return Ok(());
    }
    Err(Failure::bad_input_message(format!(
        "{} was started with other settings of the training; start the command as before, or move {} away to train again on the same \
         corpus",
        folder.display(),
        trained.join(" and ")
    )))
}

/// Rejects a folder with anything that would be replaced.
fn refuse_others(folder: &Path) -> Result<(), Failure> {
    let own: BTreeSet<&str> = Place::ALL
        .map(Place::name)
        .into_iter()
        .chain(PAGE)
        .collect();
    let entries = fs::read_dir(folder).map_err(dataset::Error::io("list", folder))?;
    for entry in entries {
        let name = entry
            .map_err(dataset::Error::io("list", folder))?
            .file_name();
        let name = name.to_string_lossy();
        let is_own = own.contains(name.as_ref()) || name.starts_with(Place::RANGES_OF);
        if name != CLAIM && is_own {
            return Err(Failure::bad_input_message(format!(
                "{} contains {name}, which `dtd paper` did not write; name another --out",
                folder.display()
            )));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verbs::paper::CORPUS;

    fn settings(scale: &str) -> Settings {
        Settings {
            scale: scale.into(),
            plan_hash: "0".into(),
            model_blake3: "1".into(),
            dtd: "0.1.0".into(),
            training: TrainConfig::demo(),
        }
    }

    fn refusal(folder: &Path, settings: Settings) -> String {
        match Notes::open(folder, settings) {
            Err(Failure::BadInput(error)) => error.to_string(),
            _ => panic!("not refused"),
        }
    }

    #[test]
    fn what_a_stage_took_is_added_up_until_it_is_done_and_read_by_the_next_call() {
        let folder = tempfile::tempdir().unwrap();
        let mut notes = Notes::open(folder.path(), settings("small")).unwrap();
        notes.add("corpus", Duration::from_secs(2), false).unwrap();
        assert_eq!(notes.done_in_s("corpus"), None);
        notes.found.detections = Some("abc".into());
        notes.add("corpus", Duration::from_secs(3), true).unwrap();
        drop(notes);
        let notes = Notes::open(folder.path(), settings("small")).unwrap();
        assert_eq!(notes.done_in_s("corpus"), Some(5.0));
        assert_eq!(notes.detections().unwrap(), "abc");
    }

    #[test]
    fn other_settings_of_the_training_keep_the_corpus_once_the_runs_are_moved_away() {
        let folder = tempfile::tempdir().unwrap();
        let mut notes = Notes::open(folder.path(), settings("small")).unwrap();
        for stage in [&[CORPUS][..], &OF_TRAINING].concat() {
            notes.add(stage, Duration::from_secs(1), true).unwrap();
        }
        drop(notes);
        let other = Settings {
            training: TrainConfig::default(),
            ..settings("small")
        };
        for name in ["run-other-flights", "run-scenarios-drawn.partial"] {
            let run = folder.path().join(name);
            fs::create_dir(&run).unwrap();
            let said = refusal(folder.path(), other.clone());
            assert!(said.contains(&format!("move {}", run.display())), "{said}");
            fs::remove_dir(&run).unwrap();
        }
        for again in 0..2 {
            let mut notes = Notes::open(folder.path(), other.clone()).unwrap();
            assert_eq!(notes.done_in_s(CORPUS), Some(1.0));
            for stage in OF_TRAINING {
                // A training whose run was moved away is repeated as well.
                assert_eq!(notes.done_in_s(stage), None, "{stage}, {again}");
                notes.add(stage, Duration::from_secs(2), true).unwrap();
            }
        }
        for (_, run) in RUNS {
            fs::create_dir(folder.path().join(run.name())).unwrap();
        }
        let notes = Notes::open(folder.path(), other).unwrap();
        let done = OF_TRAINING.map(|stage| notes.done_in_s(stage));
        assert_eq!(done, [Some(2.0); 3], "their runs are there");
    }

    #[test]
    fn other_settings_and_folders_of_others_are_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        drop(Notes::open(folder.path(), settings("small")).unwrap());
        let refused = |folder: &Path, scale| refusal(folder, settings(scale));
        let said = refused(folder.path(), "full");
        assert!(said.contains("--scale small, now it is full"), "{said}");
        let mine = tempfile::tempdir().unwrap();
        fs::write(mine.path().join("notes.txt"), "").unwrap();
        drop(Notes::open(mine.path(), settings("small")).unwrap());
        let others = tempfile::tempdir().unwrap();
        fs::create_dir(others.path().join("corpus")).unwrap();
        let said = refused(others.path(), "small");
        assert!(said.contains("corpus"), "{said}");
        assert!(!others.path().join(FILE).exists());
    }
}
