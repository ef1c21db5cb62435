//! `detections/<model>.json`: what made the detections beside it.

use std::path::PathBuf;

use dataset::corpus::ScenarioFolder;
use dataset::json_file::read_json;
use serde::{Deserialize, Serialize};

use super::Model;
use crate::error::Result;
use crate::tiling::TilingSettings;

/// Where the detections of one model in one scenario come from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DetectionRecord {
    /// File name of the model.
    pub model: String,
    /// BLAKE3 hash of the model file.
    pub model_blake3: String,
    /// Form of its answers and size of its windows.
    pub detector: String,
    /// What counted as a hit.
    pub settings: TilingSettings,
    /// Version of this software.
    pub dtd: String,
    /// Hash of the scenario's parameters, as in `scenario.json`.
    pub config_hash: String,
    /// Pictures that were looked at.
    pub pictures: u64,
    /// Rows of the table.
    pub detections: u64,
    /// Time that the workers took, seconds.
    pub seconds: f64,
}

impl DetectionRecord {
    /// Path of the record of a model.
    pub fn path(folder: &ScenarioFolder, model_hash: &str) -> PathBuf {
        folder
            .detections_folder()
            .join(format!("{model_hash}.json"))
    }

    /// Whether the scenario holds detections of this model with these settings.
    pub(super) fn is_there(
        folder: &ScenarioFolder,
        model: &Model,
        settings: &TilingSettings,
        config_hash: &str,
    ) -> Result<bool> {
        let path = Self::path(folder, model.short_hash());
        if !path.exists() || !folder.detections_path(model.short_hash()).exists() {
            return Ok(false);
        }
        let record: Self = read_json(&path, "record of detections")?;
        Ok(record.model_blake3 == model.blake3
            && record.settings == *settings
            && record.config_hash == config_hash)
    }
}
