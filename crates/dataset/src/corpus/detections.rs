//! `detections/`, `registrations/`, `health/` and `backgrounds/`: a model's detections in a scenario's videos, where the same aircraft is
//! in two views, the condition of the cameras, and what they saw around the aircraft.
//!
//! They are not sealed: each model with its settings has its own. `detections/<model>.json`, where `<model>` is the start of the hash of
//! both ([`ModelIdentity`]), records the detector, its videos, and the hashes of the table next to it and of the tables of the same name in
//! the other folders, if there are any, so a reader can check that they belong together ([`Provenance`]). They change together like sealed
//! files of a seal: each table is written as `<model>.parquet.new`, the record takes effect, and readers look for the tables by their
//! hashes under both names.

mod choice;
mod table;

use std::collections::BTreeMap;
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::corpus::ScenarioFolder;
use crate::corpus::claim::Claim;
use crate::corpus::model_identity::{ModelIdentity, NamedDetections};
use crate::corpus::open_scenario::OpenScenario;
use crate::corpus::seal::sealed::{ATTEMPTS, FileState, find};
use crate::corpus::seal::{SealedFile, hash_file, with_new_suffix};
use crate::error::{Error, Result};
use crate::files::folder;
use crate::files::json_file::write_json;
use crate::files::new_file::{clear_leftovers, sync};
use crate::files::outside_file::{self, FileKind};
use crate::files::own_path::own_path;
use crate::tables::backgrounds::ViewBackground;
use crate::tables::health::ViewHealth;
use crate::tables::image_rows::ImageRow;
use crate::tables::registrations::Registration;

pub use crate::files::corpus_names::{
    BACKGROUNDS, DETECTIONS as FOLDER, HEALTH, MODEL_FOLDERS as FOLDERS, REGISTRATIONS,
};
pub use choice::{NoChoice, choose};
pub use table::{Detection, Detections, Miss, MissReason, Row, SearchMode};

/// The part of the record of detections that every reader needs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Provenance {
    /// The detector that made them.
    #[serde(flatten)]
    pub detector: ModelIdentity,
    /// Hash of the scenario's parameters, as in its seal.
    pub config_hash: String,
    /// BLAKE3 hashes of the searched videos, by view, as in the manifest.
    pub videos_blake3: BTreeMap<String, String>,
    /// BLAKE3 hash of the table.
    pub table_blake3: String,
    /// BLAKE3 hash of the table of registrations; missing if there is none, as with one view.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub registrations_blake3: Option<String>,
    /// BLAKE3 hash of the table of health; missing if there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub health_blake3: Option<String>,
    /// BLAKE3 hash of the table of backgrounds; missing if there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub backgrounds_blake3: Option<String>,
}

impl Provenance {
    /// The tables that belong to it, named within the scenario, with their hashes.
    pub fn tables(&self, model: &str) -> Vec<SealedFile> {
        let table = |parent| {
            Some(SealedFile {
                name: table_name(parent, model),
                blake3: self.hash_of(parent)?.clone(),
            })
        };
        FOLDERS.into_iter().filter_map(table).collect()
    }

    /// The hash of the table in one of [`FOLDERS`].
    fn hash_of(&self, parent: &str) -> Option<&String> {
        match parent {
            REGISTRATIONS => self.registrations_blake3.as_ref(),
            HEALTH => self.health_blake3.as_ref(),
            BACKGROUNDS => self.backgrounds_blake3.as_ref(),
            _ => Some(&self.table_blake3),
        }
    }
}

/// The cameras that a scenario's views were registered with.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RegisteredWith {
    /// The cameras of `calibration.json`.
    Calibration,
    /// Cameras fitted by the run with this BLAKE3 hash.
    Run(String),
}

impl fmt::Display for RegisteredWith {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Calibration => f.write_str("the cameras of calibration.json"),
            Self::Run(blake3) => {
                let start: String = blake3.chars().take(12).collect();
                write!(f, "the cameras of run {start}")
            }
        }
    }
}

/// The part of the record about registrations.
#[derive(Deserialize)]
struct RecordedRegistration {
    registration: Option<RegistrationCameras>,
}

#[derive(Deserialize)]
struct RegistrationCameras {
    cameras_of_run: Option<String>,
}

fn table_name(folder: &str, model: &str) -> String {
    format!("{folder}/{model}.parquet")
}

/// A table that a model's record names, as a reader found it: its current path and its content.
pub type FoundTable = (PathBuf, Vec<u8>);

/// Path of the record of the model's detections.
pub fn record_path(folder: &ScenarioFolder, model: &str) -> PathBuf {
    folder.root().join(FOLDER).join(format!("{model}.json"))
}

/// The models with detections in this scenario, by the names of their files; sorted.
pub fn models_of(folder: &ScenarioFolder) -> Result<Vec<String>> {
    let path = own_path(folder.root(), FOLDER)?;
    let mut models = Vec::new();
    for name in Error::if_there(folder::names(&path))?.unwrap_or_default() {
        let name = Path::new(&name);
        let ending = name.extension().and_then(|ending| ending.to_str());
        if let (Some("parquet" | "json"), Some(model)) = (ending, name.file_stem()) {
            models.push(model.to_string_lossy().into_owned());
        }
    }
    models.sort();
    models.dedup();
    Ok(models)
}

/// Reads the provenance of the model's detections, if there are any.
///
/// # Errors
/// The record lacks something that a reader needs.
pub fn provenance(folder: &ScenarioFolder, model: &str) -> Result<Option<Provenance>> {
    let record = record(folder, model)?;
    record.map(|bytes| parse(&bytes, folder, model)).transpose()
}

/// The cameras that the views were registered with; `None` if they were not.
///
/// # Errors
/// The record cannot be read.
pub fn registered_with(folder: &ScenarioFolder, model: &str) -> Result<Option<RegisteredWith>> {
    let Some(bytes) = record(folder, model)? else {
        return Ok(None);
    };
    let record: RecordedRegistration =
        serde_json::from_slice(&bytes).map_err(|error| without_origin(&error, folder, model))?;
    let registration = record.registration;
    Ok(registration.map(|made| match made.cameras_of_run {
        Some(blake3) => RegisteredWith::Run(blake3),
        None => RegisteredWith::Calibration,
    }))
}

/// The model's file name and the name of the detections, as shown to users. The model is missing if the record cannot be read.
pub fn named(folder: &ScenarioFolder, name: &str) -> NamedDetections {
    let provenance = provenance(folder, name).ok().flatten();
    NamedDetections {
        model: provenance.and_then(|provenance| provenance.detector.model),
        hash: name.to_owned(),
    }
}

/// The table in one of [`FOLDERS`] with the hash that a model's record names; `None` if there is no record or it names none. `is_source`
/// checks whether it was made from the current files.
///
/// # Errors
/// It was made from other files, or does not match its record.
pub(crate) fn table(
    folder: &ScenarioFolder,
    model: &str,
    parent: &str,
    is_source: impl Fn(&Provenance) -> bool,
) -> Result<Option<FoundTable>> {
    let name = table_name(parent, model);
    let table = folder.root().join(&name);
    let again = "run `dtd detect` on the corpus with that model again";
    for _ in 0..ATTEMPTS {
        let Some(bytes) = record(folder, model)? else {
            return Ok(None);
        };
        let provenance = parse(&bytes, folder, model)?;
        let Some(hash) = provenance.hash_of(parent) else {
            return Ok(None);
        };
        if !is_source(&provenance) {
            return Err(Error::corpus(
                &table,
                format!("was made from other videos than the scenario has now; {again}"),
            ));
        }
        let found = find(folder.root(), &name, hash, |path| {
            let bytes = outside_file::read(path, FileKind::TABLE.unlinked())?;
            Ok((blake3::hash(&bytes).to_string(), (path.to_owned(), bytes)))
        })?;
        let fault = match found {
            FileState::Whole(table) => return Ok(Some(table)),
            // A different process replaced them in the meantime.
            _ if record(folder, model)?.as_ref() != Some(&bytes) => continue,
            FileState::Missing => "is missing, though there is a record of it",
            FileState::Other => "is not what its record says: its hash differs",
        };
        return Err(Error::corpus(&table, format!("{fault}; {again}")));
    }
    Err(Error::Changing {
        path: folder.root().to_owned(),
    })
}

/// Tables that [`replace`] writes next to the record.
#[derive(Debug, Clone, Copy)]
pub struct NewTables<'a> {
    /// The model's detections.
    pub detections: &'a Detections,
    /// Shifts of the aircraft between two views; `None` if they were not measured.
    pub registrations: Option<&'a [Registration]>,
    /// Condition of the cameras; `None` if it was not measured.
    pub health: Option<&'a [ViewHealth]>,
    /// Background of each camera; `None` if they were not kept.
    pub backgrounds: Option<&'a [ViewBackground]>,
}

impl<'a> NewTables<'a> {
    /// Detections whose views were not registered.
    pub fn unregistered(detections: &'a Detections) -> Self {
        Self {
            detections,
            registrations: None,
            health: None,
            backgrounds: None,
        }
    }

    fn has(&self, parent: &str) -> bool {
        match parent {
            REGISTRATIONS => self.registrations.is_some(),
            HEALTH => self.health.is_some(),
            BACKGROUNDS => self.backgrounds.is_some(),
            _ => true,
        }
    }

    /// Writes the table in one of [`FOLDERS`].
    fn write(&self, parent: &str, path: &Path) -> Result<()> {
        match parent {
            REGISTRATIONS => Registration::write(self.registrations.unwrap_or_default(), path),
            HEALTH => ViewHealth::write(self.health.unwrap_or_default(), path),
            BACKGROUNDS => ViewBackground::write(self.backgrounds.unwrap_or_default(), path),
            _ => self.detections.write(path),
        }
    }
}

/// Replaces the detections that a model made from `source`, and their tables in the other folders. `record` produces the file written next
/// to them, which must contain the given provenance.
pub fn replace<R: Serialize>(
    claim: &Claim,
    source: &OpenScenario,
    detector: &ModelIdentity,
    model: &str,
    tables: NewTables<'_>,
    record: impl FnOnce(Provenance) -> R,
) -> Result<()> {
    let folder = source.folder();
    let mut parents = Vec::new();
    for parent in FOLDERS {
        let path = own_path(folder.root(), parent)?;
        if tables.has(parent) || path.exists() {
            fs::create_dir_all(&path).map_err(Error::io("create", &path))?;
            clear_leftovers(&path);
            parents.push(path);
        }
    }
    // Readers may still need tables that a killed process committed.
    settle(claim, folder, model)?;
    let paths = FOLDERS.map(|parent| folder.root().join(table_name(parent, model)));
    let mut hashes = [const { None }; FOLDERS.len()];
    for ((parent, path), hash) in FOLDERS.into_iter().zip(&paths).zip(&mut hashes) {
        if tables.has(parent) {
            let new = with_new_suffix(path);
            tables.write(parent, &new)?;
            *hash = Some(hash_file(&new)?);
        }
    }
    let is_written = hashes.each_ref().map(Option::is_some);
    let [
        table_blake3,
        registrations_blake3,
        health_blake3,
        backgrounds_blake3,
    ] = hashes;
    let provenance = Provenance {
        detector: detector.clone(),
        config_hash: source.seal().config_hash.clone(),
        videos_blake3: source.videos_blake3(),
        table_blake3: table_blake3.expect("detections are always written"),
        registrations_blake3,
        health_blake3,
        backgrounds_blake3,
    };
    // This file commits the change.
    write_json(&record_path(folder, model), &record(provenance))?;
    for (table, is_written) in paths.iter().zip(is_written) {
        if is_written {
            let new = with_new_suffix(table);
            fs::rename(new, table).map_err(Error::io("rename into place", table))?;
        } else if table.exists() {
            fs::remove_file(table).map_err(Error::io("remove", table))?;
        }
    }
    parents.iter().try_for_each(|parent| sync(parent))
}

/// True if tables may still wait for their place although their record is committed. Readers find them nevertheless.
pub fn is_unsettled(folder: &ScenarioFolder, model: &str) -> bool {
    let mut tables = (FOLDERS.iter()).map(|parent| folder.root().join(table_name(parent, model)));
    tables.any(|table| with_new_suffix(&table).exists())
}

/// Renames the tables that the record refers to.
///
/// # Errors
/// The disk fails.
pub fn settle(_claim: &Claim, folder: &ScenarioFolder, model: &str) -> Result<()> {
    let provenance = match provenance(folder, model) {
        Ok(Some(provenance)) => provenance,
        Ok(None) => return Ok(()),
        // Tables with a damaged record are unreadable, so they may be replaced. If the record cannot be read for now, they may not.
        Err(error) if error.is_bad_content() => return Ok(()),
        Err(error) => return Err(error),
    };
    for SealedFile { name, blake3 } in provenance.tables(model) {
        let table = own_path(folder.root(), &name)?;
        let new = with_new_suffix(&table);
        if new.exists() && hash_file(&new)? == blake3 {
            fs::rename(&new, &table).map_err(Error::io("rename into place", &table))?;
        }
    }
    Ok(())
}

fn record(folder: &ScenarioFolder, model: &str) -> Result<Option<Vec<u8>>> {
    let path = own_path(
        folder.root(),
        Path::new(FOLDER).join(format!("{model}.json")),
    )?;
    let kind = FileKind::json("record of detections").unlinked();
    Error::if_there(outside_file::read(&path, kind))
}

fn parse(bytes: &[u8], folder: &ScenarioFolder, model: &str) -> Result<Provenance> {
    let provenance: Provenance =
        serde_json::from_slice(bytes).map_err(|error| without_origin(&error, folder, model))?;
    let detector = &provenance.detector;
    if !detector.has_name(model) {
        let hash = &detector.model_blake3;
        let found = match &detector.profile_blake3 {
            None => {
                format!("has the model_blake3 {hash:?}, expected 64 hexadecimal digits that begin")
            }
            Some(profile) => format!(
                "has the model_blake3 {hash:?} and the profile_blake3 {profile:?}, expected 64 hexadecimal digits each, whose hash begins"
            ),
        };
        let advice = "remove it and run `dtd detect` on the corpus with that model again";
        return Err(Error::corpus(
            &record_path(folder, model),
            format!("{found} with {model}, its name; {advice}"),
        ));
    }
    Ok(provenance)
}

fn without_origin(error: &serde_json::Error, folder: &ScenarioFolder, model: &str) -> Error {
    Error::corpus(
        &record_path(folder, model),
        format!(
            "does not say what its table was made from ({error}); run `dtd detect` on the corpus with that model again"
        ),
    )
}
