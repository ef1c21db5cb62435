//! What is to be exported.

use std::num::NonZeroU32;
use std::path::PathBuf;

use dataset::splits::Side;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::still::StillFormat;

/// A format of other tools.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// Pictures and `annotations.json` of COCO.
    Coco,
    /// Pictures by side, a text file of boxes for each, and `data.yaml`.
    Yolo,
    /// Long Parquet tables, videos and a dataset card, as `datasets.load_dataset` reads them.
    HuggingFace,
    /// Shards of samples for WebDataset.
    WebDataset,
    /// A file per scenario for Foxglove.
    Mcap,
}

impl Format {
    /// Its name.
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Coco => "coco",
            Self::Yolo => "yolo",
            Self::HuggingFace => "huggingface",
            Self::WebDataset => "webdataset",
            Self::Mcap => "mcap",
        }
    }

    /// Whether it has pictures as files of their own.
    fn has_stills(self) -> bool {
        match self {
            Self::Coco | Self::Yolo | Self::WebDataset => true,
            Self::HuggingFace | Self::Mcap => false,
        }
    }
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
    /// The form of its pictures; `None`: PNG, or none.
    pub stills: Option<StillFormat>,
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
    /// Folders of evaluated runs whose predictions are exported, too. What is in them counts, not where they are.
    #[serde(skip)]
    pub runs: Vec<PathBuf>,
    /// Licence of the export: an SPDX identifier or a URL.
    pub license: Option<String>,
}

impl ExportRequest {
    /// The form of pictures.
    pub(crate) fn stills(&self) -> StillFormat {
        self.stills.unwrap_or_default()
    }

    /// Refuses options that the format has no place for.
    pub(crate) fn check(&self) -> Result<()> {
        let not_in_format = |option, reason| {
            Err(Error::NotInFormat {
                option,
                format: self.format.word(),
                reason,
            })
        };
        if self.stills.is_some() && !self.format.has_stills() {
            return not_in_format("--pictures", "it contains the videos as they are");
        }
        if self.every.get() > 1 && self.format == Format::Mcap {
            return not_in_format("--every", "a picture of a video needs those before it");
        }
        if !self.runs.is_empty() && self.format != Format::HuggingFace {
            return not_in_format("--run", "it has no place for predictions");
        }
        Ok(())
    }
}
