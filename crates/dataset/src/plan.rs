//! `plan.json`: a corpus's scenarios, fully specified.
//!
//! The generator makes a plan from a sweep. It is written into the corpus and frozen there: a corpus can only be finished with the same
//! plan, or with one that only adds scenarios.

mod camera;
mod check;
mod difference;
mod hashes;
mod image_format;
mod planned_scenarios;
mod scenario;

use std::io::Write;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::corpus::calibration::CameraEntry;
use crate::corpus::{Corpus, is_plan};
use crate::error::{Error, Result};
use crate::files::json_file::{parse_json, write_atomically};
use crate::files::outside_file::{self, FileKind};
use crate::files::own_path::own_path;
use crate::geometry::imaging::Imaging;
use crate::geometry::runway::Runway;
use crate::video::VideoSettings;

pub use camera::{Aim, Jitter, PlannedCamera};
pub use difference::{Change, Difference};
pub use hashes::plan_hash;
pub use hashes::{ConfigHasher, HashMismatch};
pub use image_format::Picture;
pub use planned_scenarios::PlannedScenarios;
pub use scenario::{LiveStart, Parameters, PlannedScenario};

/// Version of the file format of `plan.json`. Version 1 numbered its scenarios.
pub(crate) const PLAN_VERSION: u32 = 2;

/// Description in messages.
const WHAT: &str = "plan";

/// All scenarios of the corpus, fully specified.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// [`PLAN_VERSION`] when this was written.
    pub plan_version: u32,
    /// BLAKE3 over the identifiers and hashes of all scenarios.
    pub plan_hash: String,
    /// Name of the corpus.
    pub corpus: String,
    /// BLAKE3 hash of [`Corpus::SWEEP`], the text that this is the expansion of, so that a change of either is noticed. Not part of
    /// `plan_hash`.
    pub sweep_blake3: String,
    /// Properties shared by all scenarios.
    pub common: Common,
    /// The scenarios, in recording order.
    pub scenarios: Vec<PlannedScenario>,
}

/// Properties shared by all scenarios.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Common {
    /// Aircraft type; absent if scenarios differ.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub aircraft: Option<String>,
    /// The runway it lands on.
    pub runway: Runway,
    /// Name of the camera rig.
    pub rig: String,
    /// Cameras of the rig.
    pub cameras: Vec<PlannedCamera>,
    /// Size and rate of the images.
    pub picture: Picture,
    /// Video settings.
    pub video: VideoSettings,
}

/// The part that plans of all versions have.
#[derive(Deserialize)]
struct Version {
    plan_version: Option<u32>,
}

impl Version {
    fn of(text: &[u8], path: &Path) -> Result<u32> {
        let form: Self = parse_json(text, path, WHAT)?;
        Ok(form.plan_version.unwrap_or(1))
    }
}

impl Common {
    /// The cameras of the rig with their identifiers: nominal poses and lenses, in straight light. A scenario's calibration includes its
    /// placement errors, aims and air.
    pub fn cameras(&self) -> Vec<(String, CameraEntry)> {
        let camera = |camera: &PlannedCamera| {
            let imaging = Imaging {
                distortion: camera.distortion,
                ..Imaging::default()
            };
            let jitter = Jitter::default();
            let entry = camera.calibrated(&self.runway, self.picture, None, &jitter, &imaging);
            (camera.id.clone(), entry)
        };
        self.cameras.iter().map(camera).collect()
    }
}

impl Plan {
    /// A plan with these scenarios, expanded from a sweep's text.
    pub fn new(
        corpus: String,
        sweep: &str,
        common: Common,
        scenarios: Vec<PlannedScenario>,
    ) -> Self {
        Self {
            plan_version: PLAN_VERSION,
            plan_hash: plan_hash(scenarios.iter().map(PlannedScenario::id_and_hash)),
            corpus,
            sweep_blake3: blake3::hash(sweep.as_bytes()).to_string(),
            common,
            scenarios,
        }
    }

    /// True if this text is the sweep that the plan was expanded from, by its hash.
    pub fn is_of_sweep(&self, sweep: &[u8]) -> bool {
        blake3::hash(sweep).to_string() == self.sweep_blake3
    }

    /// A corpus's plan; `None` if it has none.
    ///
    /// # Errors
    /// It cannot be read, or is not a plan of this version.
    pub fn of_corpus(corpus: &Corpus) -> Result<Option<Self>> {
        let path = own_path(corpus.root(), Corpus::PLAN)?;
        Error::if_there(Self::read(&path))
    }

    /// Reads a `plan.json`.
    pub fn read(path: &Path) -> Result<Self> {
        let text = outside_file::read(path, FileKind::PLAN.unlinked())?;
        Self::parse(&text, path)
    }

    /// Reads a `plan.json` text; messages name it as `path`.
    pub fn parse(text: &[u8], path: &Path) -> Result<Self> {
        let advised = |error: Error| match error {
            Error::Json { source, .. } => Error::corpus(
                path,
                format!(
                    "is not a valid {WHAT}: {source}; move it away, and `dtd generate` with the same sweep writes it again"
                ),
            ),
            error => error,
        };
        let found = Version::of(text, path).map_err(advised)?;
        if found != PLAN_VERSION {
            return Err(Error::corpus(
                path,
                format!(
                    "has plan version {found}, expected {PLAN_VERSION}: this corpus was made by another version of dtd, which alone can add to it; make a new corpus, or use that version"
                ),
            ));
        }
        let plan: Self = parse_json(text, path, WHAT).map_err(advised)?;
        match check::fault(&plan) {
            None => Ok(plan),
            Some(fault) => Err(Error::corpus(path, fault)),
        }
    }

    /// Reads a `plan.json` text that can be written again; `None` if it is damaged.
    ///
    /// # Errors
    /// A different version of the command made it.
    pub fn parse_undamaged(text: &[u8], path: &Path) -> Result<Option<Self>> {
        let is_of_other_version = || {
            let found = Version::of(text, path);
            is_plan(text) && found.is_ok_and(|found| found != PLAN_VERSION)
        };
        match Self::parse(text, path) {
            Err(error) if error.is_bad_content() && !is_of_other_version() => Ok(None),
            parsed => parsed.map(Some),
        }
    }

    /// Writes a `plan.json`, one line per scenario.
    pub fn write(&self, path: &Path) -> Result<()> {
        let text = self.to_json().map_err(|source| Error::Json {
            what: WHAT,
            path: path.to_owned(),
            source,
        })?;
        write_atomically(path, &text)
    }

    fn to_json(&self) -> serde_json::Result<Vec<u8>> {
        let head = serde_json::json!({
            "plan_version": self.plan_version,
            "plan_hash": self.plan_hash,
            "corpus": self.corpus,
            "common": self.common,
            "sweep_blake3": self.sweep_blake3,
        });
        let mut text = serde_json::to_vec_pretty(&head)?;
        text.truncate(text.len() - "\n}".len());
        text.extend_from_slice(b",\n  \"scenarios\": [");
        for (index, scenario) in self.scenarios.iter().enumerate() {
            text.extend_from_slice(if index == 0 { b"\n    " } else { b",\n    " });
            serde_json::to_writer(&mut text, scenario)?;
        }
        writeln!(text, "\n  ]\n}}").map_err(serde_json::Error::io)?;
        Ok(text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plan_of_the_numbered_kind_is_refused_with_what_to_do() {
        let text = br#"{"plan_hash":"0","corpus":"old","scenarios":[]}"#;
        let message = Plan::parse(text, Path::new("plan.json"))
            .unwrap_err()
            .to_string();
        assert!(
            message.contains("has plan version 1, expected 2"),
            "{message}"
        );
    }
}
