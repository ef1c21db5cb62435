//! A decoded image's brightness, where the decoder left it.

use ffmpeg_next::frame;

use super::has_planes_of_bytes;

/// A plane of brightness: rows of bytes, with gaps between them.
#[derive(Debug, Clone, Copy)]
pub struct Luma<'a> {
    /// Grey levels, row after row.
    pub levels: &'a [u8],
    /// Bytes from one row to the next.
    pub stride: usize,
    /// Columns.
    pub width_px: usize,
    /// Rows.
    pub height_px: usize,
}

impl<'a> Luma<'a> {
    /// A plane without gaps.
    pub fn of(levels: &'a [u8], width_px: usize) -> Self {
        Self {
            levels,
            stride: width_px,
            width_px,
            height_px: levels.len() / width_px.max(1),
        }
    }

    /// Brightness of a decoded image; `None` if it is not coded in planes of bytes.
    pub(crate) fn of_frame(coded: &'a frame::Video) -> Option<Self> {
        has_planes_of_bytes(coded.format()).then(|| Self {
            levels: coded.data(0),
            stride: coded.stride(0),
            width_px: coded.width() as usize,
            height_px: coded.height() as usize,
        })
    }

    /// A row, without the gap after it.
    pub fn row(&self, row: usize) -> &'a [u8] {
        let start = row * self.stride;
        &self.levels[start..start + self.width_px]
    }
}
