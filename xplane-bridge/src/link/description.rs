//! Description of a capture link's server: plugin, sources of images, and the window that shows them.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Minimum window margin around images for frame codes, pixels.
pub(crate) const MARGIN_PX: u32 = 16;

/// A way from a drawn frame to its pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PixelKind {
    /// The simulator draws them for the link: the stand-in.
    Link,
    /// The plugin reads the frame back through OpenGL: X-Plane 11 in OpenGL mode.
    Gl,
    /// The client grabs the simulator's window off the screen.
    Screen,
}

/// Image size, pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct PictureSize {
    /// Width, pixels.
    pub width_px: u32,
    /// Height, pixels.
    pub height_px: u32,
}

impl PictureSize {
    /// Bytes of such an image.
    pub(crate) fn rgb_bytes(self) -> usize {
        self.width_px as usize * self.height_px as usize * 3
    }

    /// The smallest window whose margins around such images have room for frame codes.
    pub(crate) fn with_margins(self) -> Self {
        Self {
            width_px: self.width_px + 2 * MARGIN_PX,
            height_px: self.height_px + 2 * MARGIN_PX,
        }
    }

    /// True if such images can be taken in a window of this size: the same size, or one with room for frame codes if it
    /// `may_have_margins`.
    pub(crate) fn fits(self, window: Self, may_have_margins: bool) -> bool {
        window == self || may_have_margins && self.margins_in(window).is_some()
    }

    /// Window margins around such images, left and right, above and below, if they have room for frame codes.
    pub(crate) fn margins_in(self, window: Self) -> Option<[u32; 2]> {
        let margin = |window_px: u32, picture_px: u32| {
            let both_px = window_px.checked_sub(picture_px)?;
            (both_px.is_multiple_of(2) && both_px >= 2 * MARGIN_PX).then_some(both_px / 2)
        };
        Some([
            margin(window.width_px, self.width_px)?,
            margin(window.height_px, self.height_px)?,
        ])
    }

    pub(crate) fn window_advice(self, may_have_margins: bool) -> String {
        if may_have_margins {
            format!(
                "Start X-Plane with --window={} (the margins number its frames, which is fastest) or with --window={self}",
                self.with_margins()
            )
        } else {
            format!(
                "Start X-Plane with --window={self}, exactly this size (a larger window only serves a dtd on X-Plane's computer that grabs \
                 the screen)"
            )
        }
    }
}

impl fmt::Display for PictureSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.width_px, self.height_px)
    }
}

/// The simulator's window.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SimulatorWindow {
    /// Title, as the window manager has it.
    pub title: String,
    /// Left edge of the drawn area on the desktop, physical pixels.
    pub x_px: i32,
    /// Top edge of the drawn area on the desktop, physical pixels.
    pub y_px: i32,
    /// Width of the drawn area, physical pixels.
    pub width_px: u32,
    /// Height of the drawn area, physical pixels.
    pub height_px: u32,
    /// Physical pixels per unit of the desktop's coordinates: 1, or 1.5, 2, ... on a scaled display.
    pub scale: f64,
}

impl SimulatorWindow {
    pub(crate) fn size(&self) -> PictureSize {
        PictureSize {
            width_px: self.width_px,
            height_px: self.height_px,
        }
    }
}

impl fmt::Display for SimulatorWindow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            title,
            x_px,
            y_px,
            width_px,
            height_px,
            ..
        } = self;
        write!(f, "{title:?}, {width_px}x{height_px} at ({x_px}, {y_px})")
    }
}
