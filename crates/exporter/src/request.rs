//! Request for an export.

use std::num::NonZeroU32;
use std::path::PathBuf;

use dataset::corpus::splits::Side;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
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
    /// WebDataset with crops around the aircraft, all scenarios of a side mixed.
    Crops,
    /// A file per scenario for Foxglove.
    Mcap,
}

/// Format abilities.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Abilities {
    /// Name of the format.
    pub(crate) word: &'static str,
    /// True if it has images as separate files.
    pub(crate) has_stills: bool,
    /// True if it has a place for the licence.
    pub(crate) has_license: bool,
    /// True if its samples are in shards.
    pub(crate) has_shards: bool,
    /// True if it has a place for predictions.
    pub(crate) has_predictions: bool,
    /// True if it can leave out ticks; a video's image needs those before it.
    pub(crate) has_every: bool,
    /// Boxes that it has.
    pub(crate) boxes: BoxUse,
}

/// Uses of boxes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum BoxUse {
    /// All boxes, each with its score or its visibility.
    All,
    /// Certain boxes only: the format cannot say that an aircraft may be hidden or is mostly outside the image.
    Certain,
    /// Boxes of confirmed tracks, each with a crop around it.
    Crops,
}

impl Abilities {
    /// A format of still images: every n-th tick, all boxes, no licence.
    pub(crate) fn of_stills(word: &'static str) -> Self {
        Self {
            word,
            has_stills: true,
            has_license: false,
            has_shards: false,
            has_predictions: false,
            has_every: true,
            boxes: BoxUse::All,
        }
    }

    /// A format of videos.
    pub(crate) fn of_videos(word: &'static str) -> Self {
        Self {
            has_stills: false,
            ..Self::of_stills(word)
        }
    }
}

/// Box source.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BoxSource {
    /// Ground-truth boxes, projected from pose and calibration.
    Truth,
    /// A model's detections, from confirmed tracks only.
    Detections,
}

/// Default crop size, px: the smallest window in which the detector looks at an aircraft.
pub(crate) const USUAL_CROP_PX: [u32; 2] = [160, 160];

/// Default number of shards: loaders give each worker a whole one, and fail if a worker gets none.
const USUAL_SHARDS: NonZeroU32 = NonZeroU32::new(16).unwrap();

/// Content, format and options of an export.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ExportRequest {
    /// The format.
    pub format: Format,
    /// Image format; `None`: PNG, or no images.
    pub stills: Option<StillFormat>,
    /// Scenarios; `None`: all.
    pub only: Option<Vec<String>>,
    /// Views; `None`: all.
    pub views: Option<Vec<String>>,
    /// A side of the split; `None`: all.
    pub side: Option<Side>,
    /// Every n-th tick is exported, from tick 0.
    pub every: NonZeroU32,
    /// Boxes to export. Crops are around them.
    pub boxes: BoxSource,
    /// Width and height of crops, pixels; `None`: [`USUAL_CROP_PX`], or no crops.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crop_px: Option<[u32; 2]>,
    /// Minimum number of shards per side, if it has as many samples; `None`: [`USUAL_SHARDS`], or no shards.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shards: Option<NonZeroU32>,
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
            every: NonZeroU32::MIN,
            boxes: BoxSource::Truth,
            crop_px: None,
            shards: None,
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

    /// Minimum number of shards per side.
    pub(crate) fn shards(&self) -> u32 {
        self.shards.unwrap_or(USUAL_SHARDS).get()
    }

    /// Refuses options that the format has no place for.
    pub(crate) fn check(&self, can: &Abilities) -> Result<()> {
        let is_of_crops = can.boxes == BoxUse::Crops;
        let refused = [
            (self.stills.is_some() && !can.has_stills)
                .then_some(("--pictures", "it contains videos")),
            (self.every.get() > 1 && !can.has_every)
                .then_some(("--every", "an image of a video needs those before it")),
            (self.crop_px.is_some() && !is_of_crops)
                .then_some(("--crop-px", "its images are whole")),
            (self.shards.is_some() && !can.has_shards).then_some(("--shards", "it has none")),
            (!self.runs.is_empty() && !can.has_predictions)
                .then_some(("--run", "it has no place for predictions")),
            (self.license.is_some() && !can.has_license)
                .then_some(("--license", "it has no place for it")),
        ];
        match refused.into_iter().flatten().next() {
            None => Ok(()),
            Some((option, reason)) => Err(Error::Request(format!(
                "{} has no use for {option}: {reason}; leave it out, or choose another format",
                can.word
            ))),
        }
    }
}
