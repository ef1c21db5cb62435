//! `[picture]`: size and rate of the images.

use dataset::numbers::frame_rate::{self, FrameRate};
use dataset::numbers::limits::PICTURE_SIDE_PX;
use dataset::plan::Picture;
use schemars::JsonSchema;
use serde::Deserialize;

use super::check::fault::{Checked, fault};

const MIN_SIDE_PX: u32 = PICTURE_SIDE_PX.least as u32;
const MAX_SIDE_PX: u32 = PICTURE_SIDE_PX.most as u32;

/// `[picture]`
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Picture")]
pub(super) struct PictureTable {
    /// Width, pixels; even.
    #[schemars(range(min = MIN_SIDE_PX, max = MAX_SIDE_PX), extend("multipleOf" = 2))]
    width_px: u32,
    /// Height, pixels; even.
    #[schemars(range(min = MIN_SIDE_PX, max = MAX_SIDE_PX), extend("multipleOf" = 2))]
    height_px: u32,
    /// Images per second of flight, 1/60 to 240: a number, or a fraction such as `"30000/1001"` or `"1/2"` (an image every two
    /// seconds) with terms up to 1,000,000.
    #[serde(deserialize_with = "frame_rate::text::deserialize")]
    #[schemars(schema_with = "frame_rate::text::schema")]
    frame_rate: FrameRate,
}

impl PictureTable {
    pub(super) fn checked(self) -> Checked<Picture> {
        let Self {
            width_px,
            height_px,
            frame_rate,
        } = self;
        for (name, side_px) in [("width_px", width_px), ("height_px", height_px)] {
            if !(MIN_SIDE_PX..=MAX_SIDE_PX).contains(&side_px) || side_px % 2 == 1 {
                return fault(
                    format!("picture.{name}"),
                    format!(
                        "{side_px} pixels cannot be recorded; expected an even number from {MIN_SIDE_PX} to {MAX_SIDE_PX}"
                    ),
                );
            }
        }
        Ok(Picture {
            width_px,
            height_px,
            frame_rate,
        })
    }
}
