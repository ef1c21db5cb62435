//! `detections/<model>.json`: the origin of the detections next to it, and of their registrations.

use std::path::PathBuf;

use dataset::corpus::ScenarioFolder;
use dataset::detections::{self, Provenance};
use dataset::json_file::read_json;
use dataset::open_scenario::OpenScenario;
use serde::{Deserialize, Serialize};

use super::cpu_time::CpuTime;
use super::mode::ModeSettings;
use super::{DetectOptions, Model};
use crate::error::Result;
use crate::registration::METHOD;
use crate::tiling::TilingSettings;

/// Where the detections of one model in one scenario come from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct DetectionRecord {
    /// File name of the model.
    pub model: String,
    /// What they were made from, and the hash of their table.
    #[serde(flatten)]
    pub provenance: Provenance,
    /// BLAKE3 hash of the profile next to the model, which defines its input and output; missing if there was none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub profile_blake3: Option<String>,
    /// Output layout and window size.
    pub detector: String,
    #[serde(flatten)]
    pub searching: Searching,
    /// Version of this software.
    pub dtd: String,
    /// Number of pictures.
    pub pictures: u64,
    /// Boxes in the table.
    pub detections: u64,
    /// Pictures without a box; missing in records of earlier versions.
    #[serde(default)]
    pub misses: u64,
    /// Windows that the model was run on; missing in records of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub windows: Option<u64>,
    /// Processor time of the search, with the registration; missing in records of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cpu_s: Option<CpuTime>,
    /// Total time of the workers, seconds.
    pub seconds: f64,
    /// How the views were registered; missing if they were not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub registration: Option<RegistrationRecord>,
}

/// How pictures were searched: detections made otherwise are replaced.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Searching {
    /// What counted as a hit.
    pub settings: TilingSettings,
    /// Which parts of which pictures; missing in records of earlier versions, which tracked nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub modes: Option<ModeSettings>,
}

impl Searching {
    pub(super) fn of(options: &DetectOptions) -> Self {
        Self {
            settings: options.settings,
            modes: Some(options.modes),
        }
    }
}

/// How the views of a scenario were registered.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct RegistrationRecord {
    /// Version of the measurement.
    pub method: u32,
    /// The view that the others are compared with.
    pub reference: String,
    /// Rows of the table.
    pub pairs: u64,
    /// Of these, those with a shift.
    pub answered: u64,
    /// Time that the measurement took, without decoding, seconds.
    pub seconds: f64,
}

/// What of a model's work on a scenario is there.
pub(super) enum Standing {
    /// No detections that can be used.
    Missing,
    /// Detections, but their views are still to be registered.
    Unregistered(Box<DetectionRecord>),
    /// All of it.
    Whole,
}

impl DetectionRecord {
    /// Path of the record of a model.
    pub(super) fn path(folder: &ScenarioFolder, model_hash: &str) -> PathBuf {
        detections::record_path(folder, model_hash)
    }

    /// What is there of this model's work with this profile, searched like this, made from the scenario's current videos.
    pub(super) fn standing(
        scenario: &OpenScenario,
        model: &Model,
        searching: &Searching,
    ) -> Result<Standing> {
        if scenario.detections(model.short_hash()).is_err() {
            // Missing, of other videos or damaged: detecting again repairs all of these.
            return Ok(Standing::Missing);
        }
        let path = Self::path(scenario.folder(), model.short_hash());
        let record: Self = read_json(&path, "record of detections")?;
        let is_same = record.provenance.model_blake3 == model.blake3
            && record.profile_blake3 == model.profile_blake3
            && record.searching == *searching;
        if !is_same {
            return Ok(Standing::Missing);
        }
        let method = record.registration.as_ref().map(|made| made.method);
        let is_registered = method == Some(METHOD)
            && matches!(scenario.registrations(model.short_hash()), Ok(Some(_)));
        Ok(if is_registered || scenario.record()?.views.len() < 2 {
            Standing::Whole
        } else {
            Standing::Unregistered(Box::new(record))
        })
    }
}
