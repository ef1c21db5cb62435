//! Transfer of a scenario's detections and their registrations. They are not sealed: each model has its own, tables and record
//! belong together, and the record's hashes of the tables reveal damage. Uploads replace only older detections; downloads replace
//! none but damaged ones.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::time::SystemTime;

use dataset::corpus::ScenarioFolder;
use dataset::detections::{FOLDER, Provenance, REGISTRATIONS, models_of, provenance, record_path};
use dataset::own_path::own_path;
use dataset::seal::{SealedFile, hash_file, is_within};
use futures_util::future::BoxFuture;

use crate::corpus_store::{CorpusStore, ObjectInfo, scenario_file};
use crate::error::Result;
use crate::fetch::claim;
use crate::patience::Watch;

/// The result for the detections of a scenario.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct MovedDetections {
    /// Models whose detections were transferred.
    pub moved: Vec<String>,
    /// Of these, those that replaced others, which were older or damaged.
    pub replaced: Vec<String>,
    /// Models whose detections were left alone, and why.
    pub left: Vec<LeftDetections>,
}

/// Detections that were left alone.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LeftDetections {
    /// The model.
    pub model: String,
    /// Why.
    pub reason: String,
}

impl MovedDetections {
    fn leave(&mut self, model: &str, reason: impl ToString) {
        self.left.push(LeftDetections {
            model: model.into(),
            reason: reason.to_string(),
        });
    }
}

/// The record of a model's detections, within the scenario.
fn record_of(model: &str) -> String {
    format!("{FOLDER}/{model}.json")
}

impl CorpusStore {
    /// Whether the store has all detections of a scenario's folder, byte for byte.
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
                let tables = [FOLDER, REGISTRATIONS];
                let tables = tables.map(|parent| format!("{parent}/{model}.parquet"));
                tables.into_iter().chain([record_of(model)])
            };
            for name in models.iter().flat_map(files_of) {
                let path = own_path(folder.root(), &name)?;
                if !path.exists() {
                    continue;
                }
                let blake3 = hash_file(&path)?;
                if !self
                    .has(folder, &SealedFile { name, blake3 }, &there)
                    .await?
                {
                    return Ok(false);
                }
            }
            Ok(true)
        })
    }

    /// Uploads the detections of a scenario that the store lacks, or has older.
    pub fn push_detections<'a>(
        &'a self,
        folder: &'a ScenarioFolder,
        watch: &'a dyn Watch,
    ) -> BoxFuture<'a, Result<MovedDetections>> {
        Box::pin(async move {
            let mut result = MovedDetections::default();
            let models = models_of(folder)?;
            if models.is_empty() {
                return Ok(result);
            }
            let there = self.objects(&folder.id()).await?;
            for model in models {
                let ours = match sound(folder, &model) {
                    Ok(ours) => ours,
                    Err(damage) => {
                        result.leave(&model, damage);
                        continue;
                    }
                };
                let record = SealedFile {
                    blake3: hash_file(&record_path(folder, &model))?,
                    name: record_of(&model),
                };
                // The record commits, there as here.
                let mut files = ours.tables(&model);
                files.push(record.clone());
                let mut same = true;
                for file in &files {
                    same &= self.has(folder, file, &there).await?;
                }
                if same {
                    continue;
                }
                if let Some(theirs) = there.get(&record.name) {
                    let path = record_path(folder, &model);
                    let ours = fs::metadata(&path).and_then(|found| found.modified());
                    let ours = ours.map_err(dataset::Error::io("look at", &path))?;
                    if theirs.modified > ours {
                        result.leave(
                        &model,
                        "the store has others, which are newer; move these away and `dtd fetch`, or detect again",
                    );
                        continue;
                    }
                    result.replaced.push(model.clone());
                }
                for file in &files {
                    self.send_if_missing(folder, file, &there, watch).await?;
                }
                result.moved.push(model);
            }
            Ok(result)
        })
    }

    /// Downloads the detections that a committed scenario has and the folder lacks. Existing ones in the folder stay as they are.
    pub fn fetch_detections<'a>(
        &'a self,
        folder: &'a ScenarioFolder,
        watch: &'a dyn Watch,
    ) -> BoxFuture<'a, Result<MovedDetections>> {
        Box::pin(async move {
            let mut result = MovedDetections::default();
            let there = self.objects(&folder.id()).await?;
            // Held while something is written.
            let mut claimed = None;
            for model in models_in(&there) {
                let record = record_of(&model);
                let half = "the store has half of them: a table or the record is missing";
                let name = scenario_file(&folder.id(), &record);
                let Some(theirs) = self.read(&name).await? else {
                    result.leave(&model, half);
                    continue;
                };
                let Ok(provenance) = serde_json::from_slice::<Provenance>(&theirs) else {
                    result.leave(
                        &model,
                        "the store's record of them does not say what they were made from",
                    );
                    continue;
                };
                let mut files = provenance.tables(&model);
                if !files.iter().all(|table| there.contains_key(&table.name)) {
                    result.leave(&model, half);
                    continue;
                }
                let record_blake3 = blake3::hash(&theirs).to_string();
                let stand = || standing(folder, &model, &record_blake3, there.get(&record));
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
                // The record commits, here as there.
                files.push(SealedFile {
                    name: record,
                    blake3: record_blake3,
                });
                let mut failed = None;
                for SealedFile { name, blake3 } in &files {
                    let target = own_path(folder.root(), name)?;
                    let name = scenario_file(&folder.id(), name);
                    match self.bring(&name, &target, blake3, watch).await {
                        Err(error @ crate::StoreError::Damaged { .. }) => {
                            failed = Some(error);
                            break;
                        }
                        brought => brought?,
                    }
                }
                match failed {
                    Some(error) => result.leave(&model, error),
                    None => {
                        if mends {
                            result.replaced.push(model.clone());
                        }
                        result.moved.push(model);
                    }
                }
            }
            Ok(result)
        })
    }
}

/// How a model's detections in the folder relate to those of the store.
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
        None if !table_there => Standing::Missing { mends: false },
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

/// The provenance of detections whose tables match their record, made from this scenario.
fn sound(folder: &ScenarioFolder, model: &str) -> dataset::Result<Provenance> {
    let scenario = folder.open()?;
    scenario.detections(model)?;
    scenario.registrations(model)?;
    provenance(folder, model)?
        .ok_or_else(|| dataset::Error::corpus(&record_path(folder, model), "is missing"))
}

fn modified(path: &Path) -> Option<SystemTime> {
    fs::metadata(path).ok()?.modified().ok()
}

/// The models with detections among the objects of a scenario.
fn models_in(there: &BTreeMap<String, ObjectInfo>) -> Vec<String> {
    let mut models: Vec<String> = there
        .keys()
        .map(Path::new)
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
