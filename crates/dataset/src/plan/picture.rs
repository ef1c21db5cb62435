//! Size and rate of the images of a corpus.

use serde::{Deserialize, Serialize};

use crate::numbers::frame_rate::{self, FrameRate};
use crate::numbers::limits::{self, Check};

/// Size and rate of the images, the same for all scenarios and views.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Picture {
    /// Width, pixels; even.
    pub width_px: u32,
    /// Height, pixels; even.
    pub height_px: u32,
    /// Images per second of flight.
    #[serde(with = "frame_rate::text")]
    pub frame_rate: FrameRate,
}

impl Picture {
    /// Checks for numbers outside their limits.
    pub fn check(&self, check: &mut Check) {
        for (name, side_px) in [("width_px", self.width_px), ("height_px", self.height_px)] {
            check.number(name, side_px, limits::PICTURE_SIDE_PX);
        }
    }
}
