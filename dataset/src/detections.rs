//! `detections/`: what a model detected in the videos of a scenario.
//!
//! Detections are not sealed: each model has its own. `<model>.json` records what made the table next to it, from which videos, and
//! the table's hash, so a reader can check that they belong together ([`Provenance`]). They change together like the files of a
//! seal: the table is written as `<model>.parquet.new`, the record takes effect, and readers look for the table by its hash under
//! both names.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::claim::Claim;
use crate::corpus::ScenarioFolder;
use crate::error::{Error, Result};
use crate::json_file::write_json;
use crate::new_file::{clear_leftovers, sync};
use crate::open_scenario::OpenScenario;
use crate::outside_file::{self, FileKind};
use crate::own_path::own_path;
use crate::pixel_box::{Detection, write_detections};
use crate::seal::{hash_file, with_new_suffix};
use crate::sealed::{ATTEMPTS, Found, find};

/// Folder of the detections within a scenario.
pub const FOLDER: &str = "detections";

/// The part of the record of detections that every reader needs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Provenance {
    /// BLAKE3 hash of the model file.
    pub model_blake3: String,
    /// Hash of the scenario's parameters, as in its seal.
    pub config_hash: String,
    /// BLAKE3 hashes of the searched videos, by view, as in the manifest.
    pub videos_blake3: BTreeMap<String, String>,
    /// BLAKE3 hash of the table.
    pub table_blake3: String,
}

/// Path of the record of a model's detections.
pub fn record_path(folder: &ScenarioFolder, model: &str) -> PathBuf {
    folder.detections_folder().join(format!("{model}.json"))
}

/// The models with detections in this scenario, by the names of their files; sorted.
pub fn models_of(folder: &ScenarioFolder) -> Result<Vec<String>> {
    let path = own_path(folder.root(), FOLDER)?;
    let entries = match fs::read_dir(&path) {
        Ok(entries) => entries,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(Error::io("list", &path)(error)),
    };
    let mut models = Vec::new();
    for entry in entries {
        let name = PathBuf::from(entry.map_err(Error::io("list", &path))?.file_name());
        let ending = name.extension().and_then(|ending| ending.to_str());
        if let (Some("parquet" | "json"), Some(model)) = (ending, name.file_stem()) {
            models.push(model.to_string_lossy().into_owned());
        }
    }
    models.sort();
    models.dedup();
    Ok(models)
}

/// Reads the provenance of a model's detections, if there are any.
///
/// # Errors
/// The record lacks something that a reader needs.
pub fn provenance(folder: &ScenarioFolder, model: &str) -> Result<Option<Provenance>> {
    let record = record(folder, model)?;
    record.map(|bytes| parse(&bytes, folder, model)).transpose()
}

/// The table of a model's detections: its current path and its content. `is_source` checks whether they were made from the current
/// files.
///
/// # Errors
/// There is none, it was made from something else, or it does not match its record.
pub(crate) fn table(
    folder: &ScenarioFolder,
    model: &str,
    is_source: impl Fn(&Provenance) -> bool,
) -> Result<(PathBuf, Vec<u8>)> {
    let table = folder.detections_path(model);
    let again = "run `dtd detect` on the corpus with that model again";
    for _ in 0..ATTEMPTS {
        let Some(bytes) = record(folder, model)? else {
            return Err(Error::corpus(
                &record_path(folder, model),
                "is missing: run `dtd detect` on the corpus with that model first",
            ));
        };
        let provenance = parse(&bytes, folder, model)?;
        if !is_source(&provenance) {
            return Err(Error::corpus(
                &table,
                format!("was made from other videos than the scenario has now; {again}"),
            ));
        }
        let name = format!("{FOLDER}/{model}.parquet");
        let found = find(folder.root(), &name, &provenance.table_blake3, |path| {
            let bytes = outside_file::read(path, FileKind::TABLE.unlinked())?;
            Ok((blake3::hash(&bytes).to_string(), (path.to_owned(), bytes)))
        })?;
        let fault = match found {
            Found::Whole(table) => return Ok(table),
            // Another process replaced them in the meantime.
            _ if record(folder, model)?.as_ref() != Some(&bytes) => continue,
            Found::Missing => "is missing, though there is a record of it",
            Found::Other => "is not what its record says: its hash differs",
        };
        return Err(Error::corpus(&table, format!("{fault}; {again}")));
    }
    Err(Error::Changing {
        path: folder.root().to_owned(),
    })
}

/// Replaces the detections that a model made from `source`. `record` produces the file written next to the table, which must
/// contain the given provenance.
pub fn replace<R: Serialize>(
    _claim: &Claim,
    source: &OpenScenario,
    model_blake3: &str,
    model: &str,
    detections: &[Detection],
    record: impl FnOnce(Provenance) -> R,
) -> Result<()> {
    let folder = source.folder();
    let parent = own_path(folder.root(), FOLDER)?;
    fs::create_dir_all(&parent).map_err(Error::io("create", &parent))?;
    clear_leftovers(&parent);
    // Readers may still need the table of a committed change that a killed process left.
    settle(folder, model)?;
    let table = folder.detections_path(model);
    let new = with_new_suffix(&table);
    write_detections(&new, detections)?;
    let provenance = Provenance {
        model_blake3: model_blake3.to_owned(),
        config_hash: source.seal().config_hash.clone(),
        videos_blake3: source.videos_blake3(),
        table_blake3: hash_file(&new)?,
    };
    // This file commits the change.
    write_json(&record_path(folder, model), &record(provenance))?;
    fs::rename(&new, &table).map_err(Error::io("rename into place", &table))?;
    sync(&parent)
}

/// Renames the table that the record refers to.
fn settle(folder: &ScenarioFolder, model: &str) -> Result<()> {
    let table = folder.detections_path(model);
    let new = with_new_suffix(&table);
    if let Ok(Some(provenance)) = provenance(folder, model)
        && new.exists()
        && hash_file(&new)? == provenance.table_blake3
    {
        fs::rename(&new, &table).map_err(Error::io("rename into place", &table))?;
    }
    Ok(())
}

fn record(folder: &ScenarioFolder, model: &str) -> Result<Option<Vec<u8>>> {
    let path = own_path(
        folder.root(),
        Path::new(FOLDER).join(format!("{model}.json")),
    )?;
    match outside_file::read(&path, FileKind::json("record of detections").unlinked()) {
        Ok(bytes) => Ok(Some(bytes)),
        Err(error) if error.is_not_found() => Ok(None),
        Err(error) => Err(error),
    }
}

fn parse(bytes: &[u8], folder: &ScenarioFolder, model: &str) -> Result<Provenance> {
    let provenance: Provenance = serde_json::from_slice(bytes).map_err(|error| {
        Error::corpus(
            &record_path(folder, model),
            format!("does not say what its table was made from ({error}); run `dtd detect` on the corpus with that model again"),
        )
    })?;
    let hash = &provenance.model_blake3;
    let is_hash = hash.len() == blake3::OUT_LEN * 2
        && hash
            .bytes()
            .all(|digit| matches!(digit, b'0'..=b'9' | b'a'..=b'f'));
    if !is_hash || model.is_empty() || !hash.starts_with(model) {
        return Err(Error::corpus(
            &record_path(folder, model),
            format!(
                "has the model_blake3 {hash:?}, expected 64 hexadecimal digits that begin with {model}, its name; run `dtd detect` on the \
                 corpus with that model again"
            ),
        ));
    }
    Ok(provenance)
}
