//! A detector for the tests of this crate: it finds bright blobs.

use dataset::tables::pixel_box::PixelBox;

use crate::detector::{Detector, PictureView, ScoredBox, Window, WindowSize};

/// Finds the box around all bright pixels of each connected run of columns in a window.
pub(crate) struct BlobFinder {
    pub(crate) windows_seen: usize,
    size: WindowSize,
    /// Shrink factor of the first pass.
    pub(crate) first_pass_shrink: u32,
}

const BRIGHT: u8 = 128;
/// A blob that is nowhere as bright as this has a low score.
const PLAIN: u8 = 220;
const LOW_SCORE: f64 = 0.3;
const BLOB_WINDOW_PX: u32 = 640;

impl Default for BlobFinder {
    fn default() -> Self {
        Self {
            windows_seen: 0,
            size: WindowSize::square(BLOB_WINDOW_PX),
            first_pass_shrink: 1,
        }
    }
}

impl BlobFinder {
    /// A finder that accepts windows of any size.
    pub(crate) fn of_any_size() -> Self {
        Self {
            windows_seen: 0,
            size: WindowSize::Any { multiple_px: 32 },
            first_pass_shrink: 1,
        }
    }
}

/// Paints a box of whole pixels white.
pub(crate) fn paint_blob(rgb: &mut [u8], width_px: u32, blob: &PixelBox) {
    paint_grey_blob(rgb, width_px, blob, 255);
}

/// Paints a box of whole pixels grey.
pub(crate) fn paint_grey_blob(rgb: &mut [u8], width_px: u32, blob: &PixelBox, grey: u8) {
    let [left, top, right, bottom] = blob.edges().map(|edge| (edge + 0.5) as usize);
    for row in top..bottom {
        let line = row * width_px as usize;
        rgb[(line + left) * 3..(line + right) * 3].fill(grey);
    }
}

impl Detector for BlobFinder {
    fn window_size(&self) -> WindowSize {
        self.size
    }

    fn detect(
        &mut self,
        picture: &PictureView<'_>,
        windows: &[Window],
        score_floor: f64,
    ) -> crate::Result<Vec<Vec<ScoredBox>>> {
        self.windows_seen += windows.len();
        Ok(windows
            .iter()
            .map(|window| {
                let mut found = blobs_in(picture, *window);
                found.retain(|found| found.score >= score_floor);
                found
            })
            .collect())
    }

    fn first_pass_shrink(&self) -> u32 {
        self.first_pass_shrink
    }

    fn description(&self) -> String {
        "finder of bright blobs".into()
    }
}

fn blobs_in(picture: &PictureView<'_>, window: Window) -> Vec<ScoredBox> {
    let end = |start: u32, side: u32, length: u32| (start + side * window.shrink).min(length);
    let rows = window.top_px..end(window.top_px, window.height_px, picture.height_px);
    let green =
        |column: u32, row: u32| picture.rgb[((row * picture.width_px + column) * 3 + 1) as usize];
    // Bright rows of each column, then neighbouring bright columns as one blob.
    let mut blobs: Vec<([u32; 4], u8)> = Vec::new();
    for column in window.left_px..end(window.left_px, window.width_px, picture.width_px) {
        let bright = || rows.clone().filter(|row| green(column, *row) >= BRIGHT);
        let (Some(top), Some(bottom)) = (bright().next(), bright().next_back()) else {
            continue;
        };
        let brightest = bright().map(|row| green(column, row)).max().unwrap_or(0);
        match blobs.last_mut() {
            Some((blob, most)) if blob[2] + 1 == column => {
                *blob = [blob[0], blob[1].min(top), column, blob[3].max(bottom)];
                *most = brightest.max(*most);
            }
            _ => blobs.push(([column, top, column, bottom], brightest)),
        }
    }
    let scored = |(blob, brightest): ([u32; 4], u8)| {
        let [left, top, right, bottom] = blob.map(f64::from);
        ScoredBox {
            pixel_box: PixelBox::from_edges(left - 0.5, top - 0.5, right + 0.5, bottom + 0.5),
            score: if brightest >= PLAIN { 1.0 } else { LOW_SCORE },
        }
    };
    blobs.into_iter().map(scored).collect()
}
