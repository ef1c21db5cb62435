//! `[picture]`: size and rate of the pictures.

use dataset::frame_rate::FrameRate;
use dataset::limits::PICTURE_SIDE_PX;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::fault::{Checked, fault};
use super::frame_rate_text;

const LEAST_SIDE_PX: u32 = PICTURE_SIDE_PX.least as u32;
const MOST_SIDE_PX: u32 = PICTURE_SIDE_PX.most as u32;

/// `[picture]`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Picture {
    /// Width, pixels; even.
    #[schemars(range(min = LEAST_SIDE_PX, max = MOST_SIDE_PX), extend("multipleOf" = 2))]
    pub width_px: u32,
    /// Height, pixels; even.
    #[schemars(range(min = LEAST_SIDE_PX, max = MOST_SIDE_PX), extend("multipleOf" = 2))]
    pub height_px: u32,
    /// Pictures per second of flight.
    #[serde(with = "frame_rate_text")]
    #[schemars(schema_with = "frame_rate_text::schema")]
    pub frame_rate: FrameRate,
}

impl Picture {
    pub(super) fn check(&self) -> Checked<()> {
        for (name, side_px) in [("width_px", self.width_px), ("height_px", self.height_px)] {
            if !(LEAST_SIDE_PX..=MOST_SIDE_PX).contains(&side_px) || side_px % 2 == 1 {
                return fault(
                    format!("picture.{name}"),
                    format!(
                        "{side_px} pixels cannot be recorded; expected an even number from {LEAST_SIDE_PX} to {MOST_SIDE_PX}"
                    ),
                );
            }
        }
        Ok(())
    }
}
