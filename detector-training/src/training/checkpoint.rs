//! A training on disk, so that a killed one can resume.
//!
//! `<step>.network` and `<step>.optimizer` contain the numbers, `checkpoint.json` says which of them are current. It is replaced
//! last and atomically, so a kill while saving leaves the previous checkpoint.

use std::fs;
use std::path::{Path, PathBuf};

use burn::module::Module;
use burn::optim::ModuleOptimizer;
use burn::store::{ModuleRecord, RecordError};
use dataset::corpus::workshop::{self, CLAIM};
use dataset::files::json_file::{read_json, write_atomically, write_json};
use serde::{Deserialize, Serialize};

use super::training_config::TrainingConfig;
use crate::error::{Error, Result};
use crate::network::Network;
use crate::samples::HardPlaces;

const STATE: &str = "checkpoint.json";
/// Hash of the model that the training is about to write.
const MODEL: &str = "model.b3";
const PARTS: [&str; 2] = ["network", "optimizer"];

/// Rejects a folder that contains anything but a checkpoint: it is deleted when the training is done.
pub(crate) fn refuse_strangers(folder: &Path) -> Result<()> {
    let what = "is the checkpoint folder, but";
    let is_own = |name: &str| is_own(&folder.join(name));
    Ok(workshop::refuse_strangers(folder, what, is_own)?)
}

/// Notes the hash of the model before it is written, so that a training that is killed before its report knows it again.
pub(crate) fn note_model(folder: &Path, hash: &str) -> Result<()> {
    Ok(write_atomically(&folder.join(MODEL), hash.as_bytes())?)
}

/// The hash of the model that a training in this folder wrote, or was about to write.
pub(crate) fn noted_model(folder: &Path) -> Option<String> {
    fs::read_to_string(folder.join(MODEL)).ok()
}

/// Removes a finished training's checkpoint.
pub(crate) fn clear(folder: &Path) -> Result<()> {
    for path in content(folder)? {
        if is_own(&path) {
            fs::remove_file(&path).map_err(dataset::Error::io("remove", &path))?;
        }
    }
    Ok(fs::remove_dir(folder).map_err(dataset::Error::io("remove", folder))?)
}

fn content(folder: &Path) -> Result<Vec<PathBuf>> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let failed = |error| Error::from(dataset::Error::io("list", folder)(error));
    fs::read_dir(folder)
        .map_err(failed)?
        .map(|entry| Ok(entry.map_err(failed)?.path()))
        .collect()
}

/// True if the file is named like a checkpoint file, finished or partly written.
fn is_own(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let is_part = PARTS.iter().any(|part| {
        let step = name.strip_suffix(part).and_then(|n| n.strip_suffix('.'));
        step.is_some_and(|step| step.parse::<u64>().is_ok())
    });
    let is_note = [STATE, MODEL].iter().any(|note| {
        name == *note || name.starts_with(&format!(".{note}.")) && name.ends_with(".tmp")
    });
    path.is_file() && (is_part || is_note || name == CLAIM)
}

/// Training progress.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Position {
    /// Steps of the optimiser.
    pub step: u64,
    /// Crops seen.
    pub crops: u64,
    /// Time spent, seconds.
    pub seconds: f64,
}

/// Training state in a checkpoint.
pub(crate) struct Saved {
    pub(crate) network: Network,
    pub(crate) optimizer: ModuleOptimizer,
    pub(crate) position: Position,
    pub(crate) hard: HardPlaces,
}

/// Content of `checkpoint.json`.
#[derive(Debug, Serialize, Deserialize)]
struct State {
    position: Position,
    config: TrainingConfig,
    hard_places: HardPlaces,
}

/// A training's checkpoint folder.
pub(crate) struct Checkpoint<'a> {
    folder: PathBuf,
    config: &'a TrainingConfig,
}

impl<'a> Checkpoint<'a> {
    pub(crate) fn new(folder: &Path, config: &'a TrainingConfig) -> Self {
        Self {
            folder: folder.to_owned(),
            config,
        }
    }

    fn state_path(&self) -> PathBuf {
        self.folder.join(STATE)
    }

    /// Paths of the network and the optimizer after these steps.
    fn parts(&self, step: u64) -> [PathBuf; 2] {
        PARTS.map(|part| self.folder.join(format!("{step}.{part}")))
    }

    fn refused(&self, fault: &str) -> Error {
        Error::Input(format!("run {}: {fault}", self.folder.display()))
    }

    fn fault(&self, error: RecordError) -> Error {
        self.refused(&format!(
            "cannot read or write the checkpoint: {error}; delete the folder to train from the start"
        ))
    }

    /// Writes the training and removes the previous checkpoint.
    pub(crate) fn save(&self, training: &Saved) -> Result<()> {
        fs::create_dir_all(&self.folder).map_err(dataset::Error::io("create", &self.folder))?;
        let current = self.parts(training.position.step);
        let [network, optimizer] = &current;
        let fault = |error| self.fault(error);
        let record = training.network.clone().into_record();
        record.save(network).map_err(fault)?;
        training.optimizer.save(optimizer).map_err(fault)?;
        write_json(
            &self.state_path(),
            &State {
                position: training.position,
                config: self.config.clone(),
                hard_places: training.hard.clone(),
            },
        )?;
        for path in content(&self.folder)? {
            let ending = path.extension().unwrap_or_default();
            if PARTS.iter().any(|part| ending == *part) && !current.contains(&path) {
                fs::remove_file(&path).map_err(dataset::Error::io("remove", &path))?;
            }
        }
        Ok(())
    }

    /// The training of the folder, or the given one if there is none.
    pub(crate) fn load(&self, mut fresh: Saved) -> Result<Saved> {
        if !self.state_path().exists() {
            return Ok(fresh);
        }
        let state: State = read_json(&self.state_path(), "detector checkpoint")?;
        if state.config != *self.config {
            return Err(self.refused(&format!(
                "holds an unfinished training with other settings ({:?}); repeat those to resume it, or delete the folder",
                state.config
            )));
        }
        let [network, optimizer] = self.parts(state.position.step);
        let fault = |error| self.fault(error);
        let record = ModuleRecord::load(network).map_err(fault)?;
        fresh.network = fresh.network.try_load_record(record).map_err(fault)?;
        fresh.optimizer = fresh.optimizer.load(optimizer).map_err(fault)?;
        fresh.position = state.position;
        fresh.hard = state.hard_places;
        Ok(fresh)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_checkpoint_goes_and_what_somebody_else_put_there_keeps_a_training_from_beginning() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("model.checkpoint");
        refuse_strangers(&folder).unwrap();
        fs::create_dir(&folder).unwrap();
        for name in [CLAIM, STATE, "120.network", "120.optimizer"] {
            fs::write(folder.join(name), "").unwrap();
        }
        refuse_strangers(&folder).unwrap();
        for strange in ["notes.txt", "x.network", "claims"] {
            fs::write(folder.join(strange), "").unwrap();
            let refused = refuse_strangers(&folder).unwrap_err().to_string();
            assert!(refused.contains(strange), "{refused}");
            fs::remove_file(folder.join(strange)).unwrap();
        }
        clear(&folder).unwrap();
        assert!(!folder.exists());
    }
}
