//! Request for an export.

use std::num::NonZeroU32;
use std::path::PathBuf;

use dataset::corpus::splits::Side;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::formats::{BoxUse, TickChoice};
use crate::still::StillFormat;

/// A format of other tools.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// Images and `annotations.json` of COCO.
    Coco,
    /// Images by side, a text file of boxes for each, and `data.yaml`.
    Yolo,
    /// Long Parquet tables, videos and a dataset card, as `datasets.load_dataset` reads them.
    HuggingFace,
    /// Shards of samples for WebDataset.
    WebDataset,
    /// The same, with crops around the aircraft, all scenarios of a side mixed.
    Crops,
    /// A file per scenario for Foxglove.
    Mcap,
    /// LeRobotDataset v3.0: an episode per scenario, with its videos.
    LeRobot,
}

impl Format {
    /// The reason why images of the selection are left out, as a clause about them.
    pub fn left_out(self) -> &'static str {
        if self.has_crops() {
            "of ticks at which a view has no box"
        } else {
            "whose aircraft may be hidden by a cloud or is mostly outside, which the format cannot say"
        }
    }

    /// True if it has a place for boxes.
    pub fn has_boxes(self) -> bool {
        self.abilities().boxes != BoxUse::None
    }

    fn has_crops(self) -> bool {
        self.abilities().boxes == BoxUse::Crops
    }
}

/// Ticks of an export.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Ticks {
    /// Every n-th, from tick 0.
    Every(NonZeroU32),
    /// This many per second, each the nearest to its time.
    PerSecond(NonZeroU32),
}

impl Ticks {
    /// All of them.
    pub const ALL: Self = Self::Every(NonZeroU32::MIN);
}

/// Source of the boxes of an export.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BoxSource {
    /// Ground-truth boxes, projected from pose and calibration.
    Truth,
    /// Detections of a model, from confirmed tracks only.
    Detections,
}

/// Width and height of a crop, pixels, if none is requested: the smallest window in which the detector looks at an aircraft.
pub(crate) const USUAL_CROP_PX: [u32; 2] = [160, 160];

/// Content, format and options of an export.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ExportRequest {
    /// The format.
    pub format: Format,
    /// The form of its images; `None`: PNG, or none.
    pub stills: Option<StillFormat>,
    /// Scenarios; `None`: all.
    pub only: Option<Vec<String>>,
    /// Views; `None`: all.
    pub views: Option<Vec<String>>,
    /// A side of the split; `None`: all.
    pub side: Option<Side>,
    /// Ticks to export.
    pub ticks: Ticks,
    /// Boxes to export. Crops are around them.
    pub boxes: BoxSource,
    /// Width and height of crops, pixels; `None`: [`USUAL_CROP_PX`], or no crops.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crop_px: Option<[u32; 2]>,
    /// Seed for the order of crops; `None`: 0, or the order of the corpus.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// Model whose detections are meant, by its file name or hash; `None`: the only one that there is.
    pub detections: Option<String>,
    /// Folders of evaluated runs whose predictions are exported as well. Their content identifies the request, not their path.
    #[serde(skip)]
    pub runs: Vec<PathBuf>,
    /// Licence of the export: an SPDX identifier or a URL.
    pub license: Option<String>,
}

impl ExportRequest {
    /// Everything, with the ground-truth boxes.
    pub fn whole(format: Format) -> Self {
        Self {
            format,
            stills: None,
            only: None,
            views: None,
            side: None,
            ticks: Ticks::ALL,
            boxes: BoxSource::Truth,
            crop_px: None,
            seed: None,
            detections: None,
            runs: Vec::new(),
            license: None,
        }
    }

    /// The form of images.
    pub(crate) fn stills(&self) -> StillFormat {
        self.stills.unwrap_or_default()
    }

    /// Width and height of crops, pixels.
    pub(crate) fn crop_px(&self) -> [u32; 2] {
        self.crop_px.unwrap_or(USUAL_CROP_PX)
    }

    /// Refuses options that the format has no place for.
    pub(crate) fn check(&self) -> Result<()> {
        let can = self.format.abilities();
        let not_in_format = |option, reason| {
            Err(Error::NotInFormat {
                option,
                format: can.word,
                reason,
            })
        };
        if self.stills.is_some() && !can.has_stills {
            return not_in_format("--pictures", "it contains videos");
        }
        match (can.ticks, self.ticks) {
            (TickChoice::AnyRate, _) | (_, Ticks::ALL) => {}
            (TickChoice::All, Ticks::Every(_)) => {
                return not_in_format("--every", "an image of a video needs those before it");
            }
            (TickChoice::EveryNth, Ticks::Every(_)) => {}
            (_, Ticks::PerSecond(_)) => {
                return not_in_format("--rate", "it states the time of every image");
            }
        }
        if !self.format.has_crops() {
            if self.crop_px.is_some() {
                return not_in_format("--crop-px", "its images are whole");
            }
            if self.seed.is_some() {
                return not_in_format("--seed", "it has the order of the corpus");
            }
        }
        if !self.format.has_boxes() {
            let no_boxes = "it has no place for boxes";
            if self.boxes == BoxSource::Detections {
                return not_in_format("--boxes detections", no_boxes);
            }
            if self.detections.is_some() {
                return not_in_format("--detections", no_boxes);
            }
        }
        if !self.runs.is_empty() && self.format != Format::HuggingFace {
            return not_in_format("--run", "it has no place for predictions");
        }
        Ok(())
    }
}
