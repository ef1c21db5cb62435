//! Stored results of searches, from which an interrupted evaluation resumes.
//!
//! ```text
//! OUT/
//!   evaluation.json  report.html
//!   searched/<mode>/<scenario>.parquet                 detections, as in a corpus
//!   searched/<mode>/<scenario>.registrations.parquet   with several views
//!   searched/<mode>/<scenario>.json                    what they were made from; written last
//! ```
//!
//! A table is valid if its record names its hash and the current search and videos.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use dataset::corpus::claim::Claim;
use dataset::corpus::detections::Detections;
use dataset::corpus::open_scenario::OpenScenario;
use dataset::corpus::workshop;
use dataset::files::json_file::{read_json, write_json};
use dataset::files::outside_file::{self, FileKind};
use dataset::files::own_path::{own_path, resolved};
use dataset::tables::image_rows::ImageRow;
use dataset::tables::registrations::Registration;
use labeller::{CpuTime, Findings, Mode};
use serde::{Deserialize, Serialize};

use crate::error::Result;
use crate::mode;

const SEARCHED: &str = "searched";
/// All figures.
pub(crate) const EVALUATION: &str = "evaluation.json";
/// The page.
pub const REPORT: &str = "report.html";

/// An evaluation's folder, held until this is dropped.
pub(crate) struct SearchStore {
    root: PathBuf,
    _claim: Claim,
}

/// `<scenario>.json`.
#[derive(Serialize, Deserialize, PartialEq)]
struct Record {
    /// Hash of model, settings and version.
    search: String,
    config_hash: String,
    videos_blake3: BTreeMap<String, String>,
    cpu_s: CpuTime,
    detections_blake3: String,
    registrations_blake3: String,
}

impl SearchStore {
    /// Takes a folder for an evaluation: a new or empty one, or one that has held an evaluation.
    pub(crate) fn take(root: &Path, corpus: &Path) -> Result<Self> {
        let (place, judged) = (workshop::resolve(root)?, resolved(corpus)?);
        if place.starts_with(&judged) {
            return Err(workshop::reserved(root, &judged).into());
        }
        // The report is written last but one: alone, it belongs to a different evaluation.
        let has_own = [SEARCHED, EVALUATION].map(|own| root.join(own).exists());
        let is_own = |name: &str| match name {
            SEARCHED | EVALUATION => true,
            REPORT => has_own.contains(&true),
            other => other.starts_with('.'),
        };
        workshop::refuse_strangers(root, "is not the folder of an evaluation:", is_own)?;
        let searched = own_path(root, SEARCHED)?;
        for mode in Mode::ALL {
            own_path(&searched, mode::key(mode))?;
        }
        Ok(Self {
            root: root.to_owned(),
            _claim: workshop::lock(&searched, root, Duration::ZERO)?,
        })
    }

    /// Earlier findings of this search in a scenario.
    pub(crate) fn load(
        &self,
        mode: Mode,
        search: &str,
        scenario: &OpenScenario,
    ) -> Result<Option<Findings>> {
        let pictures = scenario.record()?.pictures();
        let [record, detections, registrations] = self.paths(mode, &scenario.id());
        let Ok(record) = read_json::<Record>(&record, "record of a search") else {
            return Ok(None);
        };
        let is_current = record.search == search
            && record.config_hash == scenario.seal().config_hash
            && record.videos_blake3 == scenario.videos_blake3();
        let table = |path: &Path, blake3: &str| {
            let content = outside_file::read(path, FileKind::TABLE).ok()?;
            (blake3::hash(&content).to_string() == blake3).then_some(content)
        };
        let tables = is_current
            .then(|| {
                let found = table(&detections, &record.detections_blake3)?;
                Some((found, table(&registrations, &record.registrations_blake3)?))
            })
            .flatten();
        let Some((found, registered)) = tables else {
            return Ok(None);
        };
        Ok(Some(Findings {
            detections: Detections::parse(found, &detections, pictures)?,
            registrations: Registration::parse(registered, &registrations, pictures)?,
            cpu_s: record.cpu_s,
        }))
    }

    /// Stores the findings.
    pub(crate) fn keep(
        &self,
        mode: Mode,
        search: &str,
        scenario: &OpenScenario,
        findings: &Findings,
    ) -> Result<()> {
        let [record, detections, registrations] = self.paths(mode, &scenario.id());
        let folder = self.root.join(SEARCHED).join(mode::key(mode));
        fs::create_dir_all(&folder).map_err(dataset::Error::io("create", &folder))?;
        findings.detections.write(&detections)?;
        Registration::write(&findings.registrations, &registrations)?;
        let hash = dataset::corpus::seal::hash_file;
        let made = Record {
            search: search.to_owned(),
            config_hash: scenario.seal().config_hash.clone(),
            videos_blake3: scenario.videos_blake3(),
            cpu_s: findings.cpu_s,
            detections_blake3: hash(&detections)?,
            registrations_blake3: hash(&registrations)?,
        };
        Ok(write_json(&record, &made)?)
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.root.join(name)
    }

    fn paths(&self, mode: Mode, scenario: &str) -> [PathBuf; 3] {
        let folder = self.root.join(SEARCHED).join(mode::key(mode));
        ["json", "parquet", "registrations.parquet"]
            .map(|ending| folder.join(format!("{scenario}.{ending}")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Error;

    fn take(root: &Path) -> Result<SearchStore> {
        SearchStore::take(root, Path::new("judged-corpus"))
    }

    #[test]
    fn a_folder_of_others_is_refused_and_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        drop(take(&out).unwrap());
        fs::write(out.join(EVALUATION), "{}").unwrap();
        drop(take(&out).unwrap());
        fs::write(out.join("thesis.tex"), "").unwrap();
        let error = take(&out).err().unwrap().to_string();
        assert!(error.contains("holds thesis.tex"), "{error}");
        let file = folder.path().join("file");
        fs::write(&file, "").unwrap();
        assert!(take(&file).is_err());
        let inside = SearchStore::take(&out, folder.path()).err().unwrap();
        assert!(
            inside.to_string().contains("name a folder outside"),
            "{inside}"
        );
    }

    #[test]
    fn two_evaluations_into_one_folder_exclude_each_other() {
        let folder = tempfile::tempdir().unwrap();
        let held = take(folder.path()).unwrap();
        let error = take(folder.path()).err().unwrap();
        assert!(
            matches!(&error, Error::Dataset(error) if error.is_passing()),
            "{error}"
        );
        drop(held);
        take(folder.path()).unwrap();
    }
}
