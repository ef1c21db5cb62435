//! `failed/<id>.json`: scenarios that failed all attempts, with the reasons. The next run reads them, reports them, and tries again. For a
//! corpus in an object store the records are also kept there, visible to everyone.

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::corpus::Corpus;
use crate::error::{Error, Result};
use crate::files::folder;
use crate::files::json_file::{read_json, write_atomically, write_json};
use crate::files::outside_file::{self, FileKind};
use crate::files::own_path::own_path;

/// Folder of the records within a corpus.
pub const FOLDER: &str = "failed";
/// Attempts to write the record while other processes remove the folder.
const ATTEMPTS: u32 = 100;

/// Record of the scenario that was set aside.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetAside {
    /// Identifier of the scenario.
    pub id: String,
    /// Hash of the scenario's parameters.
    pub config_hash: String,
    /// Reasons why each attempt failed, in order.
    pub reasons: Vec<String>,
}

impl SetAside {
    /// A scenario's record, if there is a readable one: it is informational, and no result depends on it.
    pub fn read(corpus: &Corpus, id: &str) -> Option<Self> {
        let path = own_path(corpus.root(), Self::name(id)).ok()?;
        if !path.exists() {
            return None;
        }
        read_json(&path, "record of a failed scenario")
            .inspect_err(|error| tracing::warn!(%error, "ignored"))
            .ok()
    }

    /// All readable records, by identifier.
    ///
    /// # Errors
    /// The folder cannot be listed.
    pub fn all(corpus: &Corpus) -> Result<BTreeMap<String, Self>> {
        let folder = own_path(corpus.root(), FOLDER)?;
        let mut records = BTreeMap::new();
        for name in Error::if_there(folder::names(&folder))?.unwrap_or_default() {
            if let Some(id) = name.strip_suffix(".json")
                && let Some(record) = Self::read(corpus, id)
            {
                records.insert(id.to_owned(), record);
            }
        }
        Ok(records)
    }

    /// Writes the record, with the reasons of earlier runs before its own.
    pub fn write(mut self, corpus: &Corpus) -> Result<()> {
        if let Some(earlier) = Self::read(corpus, &self.id) {
            self.reasons.splice(0..0, earlier.reasons);
        }
        let path = path(corpus, &self.id);
        in_folder(corpus, || write_json(&path, &self))
    }

    /// The record's file content.
    pub fn text(corpus: &Corpus, id: &str) -> Result<Vec<u8>> {
        let path = path(corpus, id);
        outside_file::read(&path, FileKind::json("record of a failed scenario"))
    }

    /// Adopts a record that was written elsewhere, unless the local one has more reasons: a different machine may have continued, or not
    /// have this record.
    pub fn adopt(corpus: &Corpus, id: &str, text: &[u8]) -> Result<()> {
        let count = |record: Option<Self>| record.map_or(0, |record| record.reasons.len());
        let there: Option<Self> = serde_json::from_slice(text).ok();
        if count(Self::read(corpus, id)) > count(there) {
            return Ok(());
        }
        let path = path(corpus, id);
        in_folder(corpus, || write_atomically(&path, text))
    }

    /// Name of the record within the corpus.
    pub fn name(id: &str) -> String {
        format!("{FOLDER}/{id}.json")
    }

    /// Deletes the record: the scenario is complete.
    pub fn clear(corpus: &Corpus, id: &str) {
        if fs::remove_file(path(corpus, id)).is_ok() {
            // Succeeds only for the last record.
            let _ = fs::remove_dir(corpus.root().join(FOLDER));
        }
    }
}

/// Writes into the folder of the records, which is removed with the last record: other processes may do that at any moment.
fn in_folder(corpus: &Corpus, write: impl Fn() -> Result<()>) -> Result<()> {
    let folder = own_path(corpus.root(), FOLDER)?;
    let mut written = Ok(());
    for _ in 0..ATTEMPTS {
        fs::create_dir_all(&folder).map_err(Error::io("create", &folder))?;
        written = write();
        if !written.as_ref().is_err_and(Error::is_not_found) {
            break;
        }
    }
    written
}

fn path(corpus: &Corpus, id: &str) -> PathBuf {
    corpus.root().join(SetAside::name(id))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reasons_add_up_over_runs_and_go_with_the_scenario() {
        let folder = tempfile::tempdir().unwrap();
        let corpus = Corpus::create(folder.path()).unwrap();
        let record = |reason: &str| SetAside {
            id: "0001".into(),
            config_hash: "hash".into(),
            reasons: vec![reason.into()],
        };
        assert_eq!(SetAside::read(&corpus, "0001"), None);
        record("fog").write(&corpus).unwrap();
        record("storm").write(&corpus).unwrap();
        assert_eq!(
            SetAside::read(&corpus, "0001").unwrap().reasons,
            ["fog", "storm"]
        );
        let elsewhere = |reasons: &[&str]| {
            let mut record = record("");
            record.reasons = reasons.iter().map(|&reason| reason.into()).collect();
            serde_json::to_vec(&record).unwrap()
        };
        let reasons = || SetAside::read(&corpus, "0001").unwrap().reasons;
        assert_eq!(SetAside::all(&corpus).unwrap()["0001"].reasons, reasons());
        SetAside::adopt(&corpus, "0001", &elsewhere(&["hail"])).unwrap();
        assert_eq!(reasons(), ["fog", "storm"]);
        SetAside::adopt(&corpus, "0001", &elsewhere(&["fog", "storm", "hail"])).unwrap();
        assert_eq!(reasons(), ["fog", "storm", "hail"]);
        SetAside::clear(&corpus, "0001");
        assert!(!folder.path().join(FOLDER).exists());
    }
}
