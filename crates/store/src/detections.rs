//! Transfer of detections, registrations, health and backgrounds. They are not sealed: each model has its own, tables and record belong
//! together, and the record's hashes show whether the tables are whole. Detections that the other side lacks are added; different ones
//! stay, unless they are damaged.
//!
//! The record `detections/<model>.json` commits: it is sent last. A copy with its hash in the name is sent before, so that a changed
//! record shows. Records from earlier versions have no such copy until they are pushed again.

use std::path::{Path, PathBuf};

use dataset::corpus::ScenarioFolder;
use dataset::corpus::detections::{
    FOLDER, FOLDERS, Provenance, models_of, provenance, record_path,
};
use dataset::corpus::seal::{SealedFile, hash_bytes, hash_file, is_within};
use dataset::files::json_file::write_atomically;
use dataset::files::outside_file::{self, FileKind};
use dataset::files::own_path::own_path;

use crate::client::{Connection, Objects, scenario_file};
use crate::download::claim;
use crate::error::{Result, StoreError};
use crate::mirror::MirrorReport;
use crate::stored::{Evidence, content_name, file_name};

/// Advice for detections that are damaged in the store.
const MEND: &str = "`dtd push` from a folder that has them sends them again; without one, detect again with that model and push";

fn record_file(model: &str, content: &[u8]) -> SealedFile {
    SealedFile {
        name: format!("{FOLDER}/{model}.json"),
        blake3: hash_bytes(content),
    }
}

/// The store's detections before an upload.
enum Before {
    Nothing,
    /// Ours, not whole.
    Damaged,
    /// Different ones, not whole.
    DamagedOthers,
}

/// Tables that belong to a record in the store; an error says why they are damaged.
fn files_there(
    model: &str,
    record: &[u8],
    there: &Objects,
) -> std::result::Result<Vec<SealedFile>, String> {
    let own = record_file(model, record);
    let is_copy = |object: &&String| **object != own.name && file_name(object) == own.name;
    let mut copies = there.0.keys().filter(is_copy).peekable();
    if copies.peek().is_some() && !copies.any(|object| *object == content_name(&own)) {
        return Err("their record was changed after it was sent".into());
    }
    let Ok(provenance) = serde_json::from_slice::<Provenance>(record) else {
        return Err("their record is not valid".into());
    };
    let tables = provenance.tables(model);
    match tables.iter().find(|table| there.locate(table).is_none()) {
        Some(lost) => Err(format!("{} is missing", lost.name)),
        None => Ok(tables),
    }
}

impl Connection<'_> {
    /// True if the store has all detections in the folder, byte for byte; they are read.
    pub async fn has_detections_of(&self, folder: &ScenarioFolder) -> Result<bool> {
        let id = folder.id();
        let there = self.objects(&id).await?;
        for model in models_of(folder)? {
            let kind = FileKind::json("record of detections").unlinked();
            let record = record_path(folder, &model);
            if record.exists() {
                let ours = outside_file::read(&record, kind)?;
                let name = scenario_file(&id, &format!("{FOLDER}/{model}.json"));
                if self.read(&name).await? != Some(ours) {
                    return Ok(false);
                }
            }
            for parent in FOLDERS {
                let name = format!("{parent}/{model}.parquet");
                let path = own_path(folder.root(), &name)?;
                if !path.exists() {
                    continue;
                }
                let blake3 = hash_file(&path)?;
                let file = SealedFile { name, blake3 };
                let looked = self.look(&id, &file, Evidence::Content, &there);
                if looked.await?.is_err() {
                    return Ok(false);
                }
            }
        }
        Ok(true)
    }

    /// Uploads detections that the store lacks or has damaged.
    pub(crate) async fn push_detections(
        &self,
        folder: &ScenarioFolder,
        report: &mut MirrorReport,
    ) -> Result<()> {
        for model in models_of(folder)? {
            self.push_model(folder, &model, report).await?;
        }
        Ok(())
    }

    async fn push_model(
        &self,
        folder: &ScenarioFolder,
        model: &str,
        report: &mut MirrorReport,
    ) -> Result<()> {
        let ours = match sound(folder, model) {
            Ok(ours) => ours,
            Err(damage) => {
                report.leave(folder, model, damage);
                return Ok(());
            }
        };
        let id = folder.id();
        let kind = FileKind::json("record of detections").unlinked();
        let record = outside_file::read(&record_path(folder, model), kind)?;
        let own = record_file(model, &record);
        let commit = scenario_file(&id, &own.name);
        let copy = content_name(&own);
        let mut files = ours.tables(model);
        files.push(own.clone());
        let mut retries = self.retries();
        let (mut fault, mut before_push) = (None, None);
        loop {
            let there = self.objects(&id).await?;
            let theirs = self.read_object(&commit).await?;
            let mut lost = Vec::new();
            for file in &files {
                // The record itself is no copy of it.
                let is_there = *file != own || there.0.contains_key(&copy);
                let looked = self.look(&id, file, Evidence::Content, &there).await?;
                if !is_there || looked.is_err() {
                    lost.push(file);
                }
            }
            let is_same = theirs.as_ref().map(|(content, _)| *content == record);
            if is_same == Some(true) && lost.is_empty() {
                let name = format!("{id}/{model}");
                match before_push {
                    None => return Ok(()),
                    Some(Before::Nothing) => {}
                    Some(Before::Damaged) => report.mended_detections.push(name.clone()),
                    Some(Before::DamagedOthers) => report.replaced_detections.push(name.clone()),
                }
                report.detections.push(name);
                return Ok(());
            }
            if let Some((content, _)) = &theirs
                && is_same == Some(false)
                && files_there(model, content, &there).is_ok()
            {
                let place = format!("{}/{commit}", self.store.name());
                report.leave(
                    folder,
                    model,
                    format!(
                        "the store has different ones; to keep the store's, move these away and fetch them; to replace them, delete {place} \
                         and push again"
                    ),
                );
                return Ok(());
            }
            // What this call has sent or committed is not there, or others have replaced it.
            if let Some(fault) = fault.take() {
                self.wait(&mut retries, fault).await?;
            }
            for file in lost {
                self.send(folder, file).await?;
            }
            let version = theirs.as_ref().map(|(_, object)| object);
            self.replace(&commit, &record, version).await?;
            before_push.get_or_insert(match is_same {
                None => Before::Nothing,
                Some(false) if !there.0.contains_key(&copy) => Before::DamagedOthers,
                Some(_) => Before::Damaged,
            });
            fault = Some(self.store.not_kept(&commit));
        }
    }

    /// Downloads detections that a committed scenario has and the folder lacks. Existing ones in the folder stay as they are.
    ///
    /// # Errors
    /// The store or the disk fails. Damaged detections are reported.
    pub async fn fetch_detections(
        &self,
        folder: &ScenarioFolder,
        report: &mut MirrorReport,
    ) -> Result<()> {
        let there = self.objects(&folder.id()).await?;
        for model in models_in(&there) {
            if let Err(fault) = self.fetch_model(folder, &model, &there, report).await? {
                let reason = format!("damaged in the store: {fault}. {MEND}");
                report.leave(folder, &model, reason);
            }
        }
        Ok(())
    }

    /// Downloads a model's detections; the inner error says why they are damaged in the store.
    async fn fetch_model(
        &self,
        folder: &ScenarioFolder,
        model: &str,
        there: &Objects,
        report: &mut MirrorReport,
    ) -> Result<std::result::Result<(), String>> {
        let id = folder.id();
        let name = format!("{FOLDER}/{model}.json");
        let Some(record) = self.read(&scenario_file(&id, &name)).await? else {
            return Ok(Err("their record is missing".into()));
        };
        let tables = match files_there(model, &record, there) {
            Ok(tables) => tables,
            Err(fault) => return Ok(Err(fault)),
        };
        let mut standing = standing(folder, model, &record, &tables)?;
        let mut _claim = None;
        if matches!(standing, Standing::Missing { .. }) {
            _claim = Some(claim(folder).await?);
            // The process that we waited for may have written them.
            standing = self::standing(folder, model, &record, &tables)?;
        }
        let is_damaged = match standing {
            Standing::Same => return Ok(Ok(())),
            Standing::Different(advice) => {
                report.leave(folder, model, advice);
                return Ok(Ok(()));
            }
            Standing::Missing { is_damaged } => is_damaged,
        };
        for table in &tables {
            let target = own_path(folder.root(), &table.name)?;
            match self.bring(&id, table, &target, there).await {
                Err(StoreError::Faulty { faults, .. }) => return Ok(Err(faults.to_string())),
                brought => brought?,
            }
        }
        // The record commits, here as there.
        write_atomically(&own_path(folder.root(), &name)?, &record)?;
        let name = format!("{id}/{model}");
        if is_damaged {
            report.mended_detections.push(name.clone());
        }
        report.detections.push(name);
        Ok(Ok(()))
    }
}

/// A model's detections in the folder compared with those in the store.
enum Standing {
    Same,
    /// There are none, or the same, but damaged.
    Missing {
        is_damaged: bool,
    },
    /// There are different ones, with advice.
    Different(&'static str),
}

fn standing(
    folder: &ScenarioFolder,
    model: &str,
    record: &[u8],
    tables: &[SealedFile],
) -> Result<Standing> {
    let local = record_path(folder, model);
    if !local.exists() {
        // Tables without a record: an interrupted download left them, or someone else.
        for parent in FOLDERS {
            let name = format!("{parent}/{model}.parquet");
            let path = own_path(folder.root(), &name)?;
            if path.exists() {
                let blake3 = hash_file(&path)?;
                if !tables.contains(&SealedFile { name, blake3 }) {
                    return Ok(Standing::Different(
                        "here is a table without its record; move it away to fetch the store's",
                    ));
                }
            }
        }
        return Ok(Standing::Missing { is_damaged: false });
    }
    Ok(if hash_file(&local)? != hash_bytes(record) {
        Standing::Different("the store has different ones; move these away to fetch them")
    } else if sound(folder, model).is_ok() {
        Standing::Same
    } else {
        let is_damaged = folder.detections_path(model).exists();
        Standing::Missing { is_damaged }
    })
}

/// Provenance of detections whose tables match their record, made from this scenario.
fn sound(folder: &ScenarioFolder, model: &str) -> dataset::Result<Provenance> {
    let scenario = folder.open()?;
    scenario.detections(model)?;
    scenario.registrations(model)?;
    scenario.health(model)?;
    scenario.backgrounds(model)?;
    provenance(folder, model)?
        .ok_or_else(|| dataset::Error::corpus(&record_path(folder, model), "is missing"))
}

/// Models with detections among a scenario's objects.
fn models_in(there: &Objects) -> Vec<String> {
    let names = there
        .0
        .keys()
        .map(|object| PathBuf::from(file_name(object)));
    let mut models: Vec<String> = names
        .filter(|name| name.parent() == Some(Path::new(FOLDER)) && is_within(name))
        .filter(|name| {
            name.extension()
                .is_some_and(|it| it == "parquet" || it == "json")
        })
        .filter_map(|name| Some(name.file_stem()?.to_str()?.to_owned()))
        .collect();
    models.sort();
    models.dedup();
    models
}
