//! Image boxes: ground truth or detected.

use dataset::conditions::sight::Sight;
use dataset::tables::pixel_box::PixelBox;
use serde::{Deserialize, Serialize};

/// A box, in pixels as everywhere in this project: (0, 0) is the centre of the top-left pixel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct LabelledBox {
    pub(crate) pixel_box: PixelBox,
    /// Detection score.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) score: Option<f64>,
    /// Visibility, if it is ground truth.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) truth: Option<TruthFigures>,
}

/// Ground-truth visibility.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct TruthFigures {
    pub(crate) visible_fraction: f64,
    pub(crate) truncation: f64,
    pub(crate) transmission: f64,
    pub(crate) sight: Sight,
    /// True if a detector is expected to find the aircraft: most of it is in the image.
    pub(crate) is_expected: bool,
    /// Only in scenarios with traffic, like the next.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) aircraft_number: Option<u32>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) occluded_fraction: Option<f64>,
}

impl TruthFigures {
    /// True if neither a detection nor a miss counts in an evaluation.
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
