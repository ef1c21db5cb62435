//! What is to be exported.

use std::num::NonZeroU32;

use dataset::splits::Side;
use serde::{Deserialize, Serialize};

use crate::still::StillFormat;

/// A format of other tools.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// Pictures and `annotations.json` of COCO.
    Coco,
    /// Pictures by side, a text file of boxes for each, and `data.yaml`.
    Yolo,
}

/// Which boxes an export contains.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BoxSource {
    /// Those projected from pose and calibration.
    Truth,
    /// Those that a model found; of confirmed tracks only.
    Detections,
}

/// What is to be exported, and how.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ExportRequest {
    /// The format.
    pub format: Format,
    /// The form of its pictures.
    pub stills: StillFormat,
    /// Scenarios; `None`: all.
    pub only: Option<Vec<String>>,
    /// Views; `None`: all.
    pub views: Option<Vec<String>>,
    /// A side of the split; `None`: all.
    pub side: Option<Side>,
    /// Every n-th tick, from tick 0.
    pub every: NonZeroU32,
    /// Which boxes.
    pub boxes: BoxSource,
    /// Model whose detections are meant, by its file name or hash; `None`: the only one that there is.
    pub detections: Option<String>,
}
