//! `[picture]`: size and rate of the pictures.

use dataset::frame_rate::FrameRate;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::fault::{Checked, fault};
use super::frame_rate_text;

/// Pictures beyond this are a slip of the finger.
const LEAST_SIDE_PX: u32 = 64;
const MOST_SIDE_PX: u32 = 8_192;

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
        let rate = self.frame_rate;
        let highest_hz = frame_rate_text::HIGHEST_HZ;
        if 1.0 / rate.period_s() > f64::from(highest_hz) {
            return fault(
                "picture.frame_rate",
                format!("{rate} is too fast; expected at most {highest_hz} per second"),
            );
        }
        Ok(())
    }
}
