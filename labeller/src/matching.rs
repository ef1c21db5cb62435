//! Comparison of detected boxes with the ground truth.

pub(crate) mod false_boxes;
pub(crate) mod statistics;

use dataset::tables::pixel_box::PixelBox;

/// A box that overlaps the true one by at least this much (intersection over union) has found it. Low, because an aircraft at 10 NM
/// is 7 pixels high, and a box that is one pixel off is still useful.
pub(crate) const HIT_IOU: f64 = 0.25;

/// A detected box, compared with the true one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Match {
    /// The aircraft was found.
    Hit,
    /// The box touches the aircraft, but says neither where it is nor how large: no hit, and no false alarm.
    Loose,
    /// Something else.
    Elsewhere,
}

impl Match {
    /// Compares a detected box with the true one.
    pub fn of(found: &PixelBox, truth: &PixelBox) -> Self {
        match found.iou(truth) {
            iou if iou >= HIT_IOU => Self::Hit,
            iou if iou > 0.0 => Self::Loose,
            _ => Self::Elsewhere,
        }
    }
}

#[cfg(test)]
mod tests;
