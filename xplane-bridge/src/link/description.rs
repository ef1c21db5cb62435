//! The server of a capture link: its plugin, the sources of its images, and the window that shows them.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::pixels::{MARGIN_PX, margins_around};

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
    /// The simulator writes files with its own screenshot command, which the plugin sends.
    Screenshot,
}

/// Size of an image, pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct PictureSize {
    /// Width, pixels.
    pub width_px: u32,
    /// Height, pixels.
    pub height_px: u32,
}

impl PictureSize {
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
        window == self || may_have_margins && margins_around(self, window).is_some()
    }

    /// The windows for such images, as advice.
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

/// The window that shows what the simulator draws.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SimulatorWindow {
    /// Its title, as the window manager has it.
    pub title: String,
    /// Left edge of what is drawn on the desktop, physical pixels.
    pub x_px: i32,
    /// Top edge of what is drawn on the desktop, physical pixels.
    pub y_px: i32,
    /// Width of what is drawn, physical pixels.
    pub width_px: u32,
    /// Height of what is drawn, physical pixels.
    pub height_px: u32,
    /// Physical pixels per unit of the desktop's coordinates: 1, or 1.5, 2, ... on a scaled display.
    pub scale: f64,
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
