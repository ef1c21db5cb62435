//! Size and rate of the corpus's images.

use serde::{Deserialize, Serialize};

use crate::numbers::frame_rate::{self, FrameRate};
use crate::numbers::limits::{self, Check, check_fields};

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
        check_fields!(check, self, {
            width_px: limits::PICTURE_SIDE_PX,
            height_px: limits::PICTURE_SIDE_PX,
        });
    }
}
