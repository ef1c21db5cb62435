//! Images in memory and positions in them.

use std::fmt;
use std::ops::Range;

use serde::{Deserialize, Serialize};

use crate::link::PictureSize;

/// A rectangle in an image or on a screen, pixels from its top left.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Rectangle {
    /// Leftmost column.
    pub x_px: u32,
    /// Topmost row.
    pub y_px: u32,
    /// Number of columns.
    pub width_px: u32,
    /// Number of rows.
    pub height_px: u32,
}

impl Rectangle {
    /// The rectangle from this pixel to just before (`right_px`, `bottom_px`).
    pub(crate) fn between(x_px: u32, y_px: u32, right_px: u32, bottom_px: u32) -> Self {
        Self {
            x_px,
            y_px,
            width_px: right_px.saturating_sub(x_px),
            height_px: bottom_px.saturating_sub(y_px),
        }
    }

    pub(crate) fn size(self) -> PictureSize {
        PictureSize {
            width_px: self.width_px,
            height_px: self.height_px,
        }
    }

    /// The column after the last.
    pub(crate) fn right_px(self) -> u32 {
        self.x_px + self.width_px
    }

    /// The row after the last.
    pub(crate) fn bottom_px(self) -> u32 {
        self.y_px + self.height_px
    }

    /// The bytes of each of its rows in an image of this width.
    pub(crate) fn rows(self, width_px: u32) -> impl Iterator<Item = Range<usize>> {
        (self.y_px..self.bottom_px()).map(move |y| {
            let byte = |x: u32| (y * width_px + x) as usize * 3;
            byte(self.x_px)..byte(self.right_px())
        })
    }

    /// The rest without a margin all around.
    pub(super) fn inside(self, margin_px: u32) -> Self {
        Self {
            x_px: self.x_px + margin_px,
            y_px: self.y_px + margin_px,
            width_px: self.width_px.saturating_sub(2 * margin_px),
            height_px: self.height_px.saturating_sub(2 * margin_px),
        }
    }
}

impl fmt::Display for Rectangle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            x_px,
            y_px,
            width_px,
            height_px,
        } = self;
        write!(f, "{width_px}x{height_px} at ({x_px}, {y_px})")
    }
}

/// An image: red, green, blue, one byte each, row by row from the top left.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RgbPicture {
    /// Number of columns.
    pub width_px: u32,
    /// Number of rows.
    pub height_px: u32,
    /// The bytes, rows without gaps.
    pub rgb: Vec<u8>,
}

impl RgbPicture {
    /// A black image.
    pub fn black(width_px: u32, height_px: u32) -> Self {
        Self {
            width_px,
            height_px,
            rgb: vec![0; width_px as usize * height_px as usize * 3],
        }
    }

    pub(super) fn size(&self) -> PictureSize {
        PictureSize {
            width_px: self.width_px,
            height_px: self.height_px,
        }
    }

    /// Resizes it; its content is undefined until it is filled.
    pub(super) fn resize(&mut self, width_px: u32, height_px: u32) {
        (self.width_px, self.height_px) = (width_px, height_px);
        self.rgb.resize(self.size().rgb_bytes(), 0);
    }

    /// Pixels of row `y_px` from column `from_px` to just before `to_px`.
    pub(super) fn pixels(&self, from_px: u32, to_px: u32, y_px: u32) -> &[[u8; 3]] {
        let row = (y_px * self.width_px) as usize;
        &self.rgb.as_chunks().0[row + from_px as usize..row + to_px as usize]
    }

    /// Mutable [`Self::pixels`].
    pub(super) fn pixels_mut(&mut self, from_px: u32, to_px: u32, y_px: u32) -> &mut [[u8; 3]] {
        let row = (y_px * self.width_px) as usize;
        &mut self.rgb.as_chunks_mut().0[row + from_px as usize..row + to_px as usize]
    }
}
