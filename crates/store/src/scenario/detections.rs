//! Transfer of a scenario's detections, registrations and health. They are not sealed: each model has its own, tables and record
//! belong together, and the record's hashes of the tables reveal damage. The record commits: it is sent last, and replaced only if it is
//! still the one that was judged. Uploads replace only older or incomplete detections; downloads replace none but damaged ones.

use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use dataset::corpus::ScenarioFolder;
use dataset::corpus::detections::{
    FOLDER, FOLDERS, Provenance, models_of, provenance, record_path,
};
use dataset::corpus::seal::{self, SealedFile, hash_file, is_within};
use dataset::files::json_file::write_atomically;
use dataset::files::outside_file::{self, FileKind};
use dataset::files::own_path::own_path;
use futures_util::future::BoxFuture;
use object_store::UpdateVersion;

use super::content_name::file_name;
use super::fetch::claim;
use super::send::size_of;
use crate::corpus_store::{CorpusStore, ObjectInfo, Objects, scenario_file};
use crate::error::{Result, StoreError};
use crate::patience::Transfer;

/// Maximum number of times that another process may replace the same detections before an upload gives up.
const MAX_COMMITS: u32 = 8;

/// The result for the detections of a scenario.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct MovedDetections {
    /// Models whose detections were transferred.
    pub moved: Vec<String>,
    /// Of these, those that replaced others, which were older.
    pub replaced: Vec<String>,
    /// Of these, those that replaced damaged ones.
    pub mended: Vec<String>,
    /// Models whose detections were left alone, and why.
    pub left: Vec<LeftDetections>,
}

/// Detections that were left alone.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LeftDetections {
    /// The model.
    pub model: String,
    /// The reason.
    pub reason: String,
}

impl MovedDetections {
    fn leave(&mut self, model: &str, reason: impl ToString) {
        self.left.push(LeftDetections {
            model: model.into(),
            reason: reason.to_string(),
        });
    }

    /// Leaves detections that the store has damaged.
    fn leave_lost(&mut self, model: &str, fault: impl fmt::Display) {
        self.leave(model, format!("damaged in the store: {fault}. {MEND}"));
    }
}

/// Advice for detections that are damaged in the store.
const MEND: &str = "`dtd push` from a folder that has them sends them again; without one, detect again with that model and push";

/// The record of a model's detections, within the scenario.
fn record_of(model: &str) -> String {
    format!("{FOLDER}/{model}.json")
}

impl CorpusStore {
    /// Returns true if the store has all detections of a scenario's folder, byte for byte.
    pub fn has_detections_of<'a>(
        &'a self,
        folder: &'a ScenarioFolder,
    ) -> BoxFuture<'a, Result<bool>> {
        Box::pin(async move {
            let models = models_of(folder)?;
            if models.is_empty() {
                return Ok(true);
            }
            let there = self.objects(&folder.id()).await?;
            let files_of = |model: &String| {
                let tables = FOLDERS.map(|parent| format!("{parent}/{model}.parquet"));
                tables.into_iter().chain([record_of(model)])
            };
            for name in models.iter().flat_map(files_of) {
                let path = own_path(folder.root(), &name)?;
                if !path.exists() {
                    continue;
                }
                let blake3 = hash_file(&path)?;
                let file = SealedFile { name, blake3 };
                if !self.has(folder, &file, &there).await? {
                    return Ok(false);
                }
            }
            Ok(true)
        })
    }

    /// Returns true if the store has exactly this file.
    async fn has(
        &self,
        folder: &ScenarioFolder,
        file: &SealedFile,
        there: &Objects,
    ) -> Result<bool> {
        let bytes = size_of(&seal::current_path(folder.root(), &file.name)?)?;
        let id = folder.id();
        let whole = self.whole_object(&id, file, Some(bytes), None, there);
        Ok(whole.await?.is_ok())
    }

    /// Uploads the detections of a scenario that the store lacks, or has older.
    pub(crate) fn push_detections<'a>(
        &'a self,
        folder: &'a ScenarioFolder,
        transfer: &'a Transfer<'_>,
    ) -> BoxFuture<'a, Result<MovedDetections>> {
        Box::pin(async move {
            let mut result = MovedDetections::default();
            let models = models_of(folder)?;
            if models.is_empty() {
                return Ok(result);
            }
            let mut there = self.objects(&folder.id()).await?;
            for model in models {
                let mut rounds_left = MAX_COMMITS;
                while !self
                    .push_model(folder, &model, &there, &mut result, transfer)
                    .await?
                {
                    there = self.objects(&folder.id()).await?;
                    rounds_left -= 1;
                    if rounds_left == 0 {
                        result.leave(&model, "others replace them all the time; push again");
                        break;
                    }
                }
            }
            Ok(result)
        })
    }

    /// Uploads one model's detections. Returns `false` if another process committed others in the meantime.
    async fn push_model(
        &self,
        folder: &ScenarioFolder,
        model: &str,
        there: &Objects,
        result: &mut MovedDetections,
        transfer: &Transfer<'_>,
    ) -> Result<bool> {
        let ours = match sound(folder, model) {
            Ok(ours) => ours,
            Err(damage) => {
                result.leave(model, damage);
                return Ok(true);
            }
        };
        let id = folder.id();
        let path = record_path(folder, model);
        let record = outside_file::read(&path, FileKind::json("record of detections").unlinked())?;
        let name = record_of(model);
        let theirs = self.read_object(&scenario_file(&id, &name)).await?;
        let tables = ours.tables(model);
        let mut is_whole = true;
        for table in &tables {
            is_whole &= self.has(folder, table, there).await?;
        }
        let mut are_damaged = false;
        if let Some((content, object)) = &theirs {
            let is_same = *content == record;
            if is_same && is_whole {
                return Ok(true);
            }
            are_damaged = is_same || !tables_there(content, model, there);
            let ours = fs::metadata(&path).and_then(|found| found.modified());
            let ours = ours.map_err(dataset::Error::io("look at", &path))?;
            if !is_same && SystemTime::from(object.last_modified) > ours && !are_damaged {
                result.leave(
                    model,
                    "the store has others, which are newer; move these away and `dtd fetch`, or detect again",
                );
                return Ok(true);
            }
        }
        for table in &tables {
            self.send_if_missing(folder, table, None, there, transfer)
                .await?;
        }
        let is_replacement = theirs.is_some();
        let version = theirs.map(|(_, object)| UpdateVersion {
            e_tag: object.e_tag,
            version: object.version,
        });
        let replaced = self.replace_version(&id, &name, &record, version.as_ref());
        if !replaced.await? {
            return Ok(false);
        }
        result.moved.push(model.to_owned());
        if are_damaged {
            result.mended.push(model.to_owned());
        } else if is_replacement {
            result.replaced.push(model.to_owned());
        }
        Ok(true)
    }

    /// Downloads the detections that a committed scenario has and the folder lacks. Existing ones in the folder stay as they are.
    pub fn fetch_detections<'a>(
        &'a self,
        folder: &'a ScenarioFolder,
        transfer: &'a Transfer<'_>,
    ) -> BoxFuture<'a, Result<MovedDetections>> {
        Box::pin(async move {
            let mut result = MovedDetections::default();
            let there = self.objects(&folder.id()).await?;
            // Held while something is written.
            let mut claimed = None;
            for model in models_in(&there) {
                let record = record_of(&model);
                let name = scenario_file(&folder.id(), &record);
                let Some(theirs) = self.read(&name).await? else {
                    result.leave_lost(&model, "their record is missing");
                    continue;
                };
                let Ok(provenance) = serde_json::from_slice::<Provenance>(&theirs) else {
                    result.leave_lost(&model, "their record is not valid");
                    continue;
                };
                let tables = provenance.tables(&model);
                if let Some(lost) = tables.iter().find(|table| there.locate(table).is_none()) {
                    result.leave_lost(&model, format!("{} is missing", lost.name));
                    continue;
                }
                let record_blake3 = blake3::hash(&theirs).to_string();
                let stand = || {
                    let theirs = there.0.get(&record);
                    standing(folder, &model, &record_blake3, &tables, theirs)
                };
                let mut standing = stand()?;
                if matches!(standing, Standing::Missing { .. }) && claimed.is_none() {
                    claimed = Some(claim(folder).await?);
                    // The process that we waited for may have written them.
                    standing = stand()?;
                }
                let mends = match standing {
                    Standing::Missing { mends } => mends,
                    Standing::Same => continue,
                    Standing::Others(reason) => {
                        result.leave(&model, reason);
                        continue;
                    }
                };
                let mut failed = None;
                for table in &tables {
                    let target = own_path(folder.root(), &table.name)?;
                    match self
                        .bring(&folder.id(), table, &target, &there, transfer)
                        .await
                    {
                        Err(StoreError::Faulty { faults, .. }) => {
                            failed = Some(faults);
                            break;
                        }
                        brought => brought?,
                    }
                }
                if failed.is_none() {
                    // The record commits, here as there.
                    write_atomically(&own_path(folder.root(), &record)?, &theirs)?;
                }
                match failed {
                    Some(faults) => result.leave_lost(&model, faults),
                    None => {
                        if mends {
                            result.mended.push(model.clone());
                        }
                        result.moved.push(model);
                    }
                }
            }
            Ok(result)
        })
    }
}

/// A model's detections in the folder compared with those in the store.
enum Standing {
    /// They are the same.
    Same,
    /// There are none, or the same, but damaged.
    Missing { mends: bool },
    /// There are others, with advice.
    Others(&'static str),
}

fn standing(
    folder: &ScenarioFolder,
    model: &str,
    their_record_blake3: &str,
    their_tables: &[SealedFile],
    theirs: Option<&ObjectInfo>,
) -> Result<Standing> {
    let local = record_path(folder, model);
    let ours = local.exists().then(|| hash_file(&local)).transpose()?;
    let table_there = folder.detections_path(model).exists();
    Ok(match ours {
        Some(ours) if ours == their_record_blake3 => match sound(folder, model) {
            Ok(_) => Standing::Same,
            // The same detections, damaged here.
            Err(_) => Standing::Missing { mends: table_there },
        },
        None if has_no_others(folder, model, their_tables)? => Standing::Missing { mends: false },
        _ => {
            let is_newer = theirs.zip(modified(&local));
            Standing::Others(
                match is_newer.map(|(theirs, ours)| theirs.modified > ours) {
                    Some(true) => {
                        "the store has others, which are newer; move these away to fetch them"
                    }
                    Some(false) => {
                        "the store has others, which are older; `dtd push` replaces them there"
                    }
                    None => "here is a table without its record; move it away to fetch the store's",
                },
            )
        }
    })
}

/// True if the folder has no tables of a model except the remains of an interrupted download.
fn has_no_others(
    folder: &ScenarioFolder,
    model: &str,
    their_tables: &[SealedFile],
) -> Result<bool> {
    for parent in FOLDERS {
        let name = format!("{parent}/{model}.parquet");
        let path = own_path(folder.root(), &name)?;
        if !path.exists() {
            continue;
        }
        let blake3 = hash_file(&path)?;
        if !their_tables.contains(&SealedFile { name, blake3 }) {
            return Ok(false);
        }
    }
    Ok(true)
}

/// The provenance of detections whose tables match their record, made from this scenario.
fn sound(folder: &ScenarioFolder, model: &str) -> dataset::Result<Provenance> {
    let scenario = folder.open()?;
    scenario.detections(model)?;
    scenario.registrations(model)?;
    scenario.health(model)?;
    provenance(folder, model)?
        .ok_or_else(|| dataset::Error::corpus(&record_path(folder, model), "is missing"))
}

fn modified(path: &Path) -> Option<SystemTime> {
    fs::metadata(path).ok()?.modified().ok()
}

/// True if a listing has all tables that a record names. False for an unreadable record.
fn tables_there(record: &[u8], model: &str, there: &Objects) -> bool {
    let provenance = serde_json::from_slice::<Provenance>(record);
    provenance.is_ok_and(|provenance| {
        let tables = provenance.tables(model);
        tables.iter().all(|table| there.locate(table).is_some())
    })
}

/// The models with detections among the objects of a scenario.
fn models_in(there: &Objects) -> Vec<String> {
    let mut models: Vec<String> = there
        .0
        .keys()
        .map(|object| PathBuf::from(file_name(object)))
        .filter(|name| name.parent() == Some(Path::new(FOLDER)) && is_within(name))
        .filter(|name| {
            let ending = name.extension().and_then(|ending| ending.to_str());
            matches!(ending, Some("parquet" | "json"))
        })
        .filter_map(|name| Some(name.file_stem()?.to_str()?.to_owned()))
        .collect();
    models.sort();
    models.dedup();
    models
}
