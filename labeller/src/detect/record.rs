//! `detections/<model>.json`: the origin of the detections next to it.

use std::path::PathBuf;

use dataset::corpus::ScenarioFolder;
use dataset::detections::{self, Provenance};
use dataset::json_file::read_json;
use dataset::open_scenario::OpenScenario;
use serde::{Deserialize, Serialize};

use super::Model;
use crate::error::Result;
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
    /// What counted as a hit.
    pub settings: TilingSettings,
    /// Version of this software.
    pub dtd: String,
    /// Number of pictures.
    pub pictures: u64,
    /// Rows of the table.
    pub detections: u64,
    /// Total time of the workers, seconds.
    pub seconds: f64,
}

impl DetectionRecord {
    /// Path of the record of a model.
    pub(super) fn path(folder: &ScenarioFolder, model_hash: &str) -> PathBuf {
        detections::record_path(folder, model_hash)
    }

    /// Whether the scenario has detections of this model with this profile and these settings, made from its current videos.
    pub(super) fn is_there(
        scenario: &OpenScenario,
        model: &Model,
        settings: &TilingSettings,
    ) -> Result<bool> {
        if scenario.detections(model.short_hash()).is_err() {
            // Missing, of other videos or damaged: detecting again repairs all of these.
            return Ok(false);
        }
        let path = Self::path(scenario.folder(), model.short_hash());
        let record: Self = read_json(&path, "record of detections")?;
        Ok(record.provenance.model_blake3 == model.blake3
            && record.profile_blake3 == model.profile_blake3
            && record.settings == *settings)
    }
}
