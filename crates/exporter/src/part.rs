//! State of one scenario in an export: kept as JSON while the export is being made, so that it can be resumed.

use dataset::conditions::sight::Sight;
use dataset::corpus::calibration::CameraEntry;
use dataset::corpus::splits::Side;
use dataset::tables::pixel_box::PixelBox;
use serde::{Deserialize, Serialize};

/// The pictures of a scenario.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Part {
    pub(crate) scenario: String,
    pub(crate) weather: String,
    pub(crate) time_of_day: String,
    pub(crate) side: Option<Side>,
    pub(crate) views: Vec<ViewPart>,
}

/// The pictures of a view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct ViewPart {
    pub(crate) view: String,
    pub(crate) camera: CameraEntry,
    pub(crate) pictures: Vec<Picture>,
}

/// A picture that was written.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Picture {
    pub(crate) tick: u32,
    pub(crate) time_ns: i64,
    /// Distance to touchdown, if the scenario is labelled.
    pub(crate) dtd_m: Option<f64>,
    /// Relative to the folder of the export, with forward slashes.
    pub(crate) file: String,
    pub(crate) boxes: Vec<LabelledBox>,
    /// The model's detections, if the boxes are the ground truth and there are detections of one model.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) found: Vec<LabelledBox>,
}

/// A box, in pixels as everywhere in this project: (0, 0) is the centre of the top-left pixel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct LabelledBox {
    pub(crate) pixel_box: PixelBox,
    /// Of a detection.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) score: Option<f64>,
    /// Of a true box: part of the aircraft in the picture, part of the box outside it, contrast that remains.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) truth: Option<TruthFigures>,
}

/// Visibility of a ground-truth box.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct TruthFigures {
    pub(crate) visible_fraction: f64,
    pub(crate) truncation: f64,
    pub(crate) transmission: f64,
    pub(crate) sight: Sight,
    /// True if a detector is expected to find it: most of it is in the picture.
    pub(crate) is_expected: bool,
}

impl TruthFigures {
    /// True if neither a detection of it nor a miss counts in an evaluation.
    pub(crate) fn is_ignored(&self) -> bool {
        !self.is_expected || self.sight != Sight::Open
    }
}

impl LabelledBox {
    /// Left, top, width, height with the origin at the outer corner of the top-left pixel, as COCO and YOLO have it.
    pub(crate) fn corner_and_size(&self) -> [f64; 4] {
        let [left, top, right, bottom] = self.pixel_box.edges();
        [left + 0.5, top + 0.5, right - left, bottom - top]
    }
}
