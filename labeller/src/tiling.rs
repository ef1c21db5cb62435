//! Small aircraft in large images: the paper's Auto Segmentation.
//!
//! A first pass covers the image, in tiles or at once (`crate::tiling::search_windows`). A window is centred on every hit, so that an
//! aircraft on the border of two tiles is complete, and the detector runs again; its boxes there count. Several aircraft get a window
//! each. From the paper's section on detection (S11, S12).

pub(crate) mod row_band;
pub(crate) mod search_windows;

use serde::{Deserialize, Serialize};

use crate::detector::{Detector, PictureView, ScoredBox, keep_best};
use crate::error::{Error, Result};
use row_band::RowBand;
use search_windows::{first_windows, window_around};

/// Minimum tile side, px; smaller tiles show too little around an aircraft.
const MIN_TILE_PX: u32 = 64;
/// Maximum tile side, px.
const MAX_TILE_PX: u32 = 16_384;

/// Thresholds and windows of the search. Records of earlier versions have further keys.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TilingSettings {
    /// Minimum score of hits in tiles, 0 to 1. Below [`TilingSettings::score`], because the aircraft may be cut there.
    pub tile_score: f64,
    /// Minimum score of detections in centred windows, 0 to 1.
    pub score: f64,
    /// A fainter box, down to this score, counts if it belongs to a track that others confirm.
    pub faint_score: f64,
    /// Boxes that overlap by more than this (intersection over union) are one aircraft, 0 to 1.
    pub merge_iou: f64,
    /// Maximum number of hits per image that get a second pass, the best first: limits the time spent on clutter.
    pub most_windows: usize,
    /// Tile side for models that take any size, px, rounded up to the stride; missing: the whole image at once. Fixed-size models have
    /// tiles of their window size.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tile_px: Option<u32>,
    /// Rows that the first pass covers; missing: all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rows: Option<RowBand>,
    /// Rows that the first pass covers at half the image's scale as well, where aircraft are large; missing: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub half_scale_rows: Option<RowBand>,
}

impl Default for TilingSettings {
    fn default() -> Self {
        Self {
            tile_score: 0.15,
            score: 0.4,
            faint_score: 0.15,
            merge_iou: 0.3,
            most_windows: 6,
            tile_px: None,
            rows: None,
            half_scale_rows: None,
        }
    }
}

impl TilingSettings {
    /// Checks the size of the tiles.
    pub(crate) fn check(&self) -> Result<()> {
        let sides = MIN_TILE_PX..=MAX_TILE_PX;
        match self.tile_px.filter(|side_px| !sides.contains(side_px)) {
            None => Ok(()),
            Some(found) => Err(Error::Option {
                name: "--tile",
                found: found.to_string(),
                expected: "64 to 16384".into(),
            }),
        }
    }

    /// The score of the faintest boxes that may count.
    pub(crate) fn least_score(&self) -> f64 {
        self.faint_score.min(self.score)
    }

    /// Checks that some of the rows are in an image of this height.
    fn check_rows(&self, height_px: u32) -> Result<()> {
        let mut bands = [self.rows, self.half_scale_rows].into_iter().flatten();
        match bands.find(|band| band.top_px >= height_px) {
            Some(band) => Err(Error::Option {
                name: "--rows",
                found: band.to_string(),
                expected: format!("a first row below {height_px}, the height of the images"),
            }),
            None => Ok(()),
        }
    }
}

/// An aircraft that was found in an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// The box in the original frame, with the confidence of the second pass.
    pub found: ScoredBox,
    /// Number of the window of the first pass (row-major, from 0) that saw it.
    pub tile: u32,
}

/// Results of whole-image searches.
pub(crate) struct PictureSearch {
    /// All aircraft, best first, with faint ones.
    pub(crate) sightings: Vec<Sighting>,
    /// Number of places that the first pass found.
    pub(crate) hits: usize,
}

/// Finds all aircraft in an image, best first.
pub fn find_aircraft(
    detector: &mut dyn Detector,
    picture: &PictureView<'_>,
    settings: &TilingSettings,
) -> Result<Vec<Sighting>> {
    let mut found = search_picture(detector, picture, settings)?.sightings;
    found.retain(|sighting| sighting.found.score >= settings.score);
    Ok(found)
}

/// Searches the whole image, faint boxes included.
pub(crate) fn search_picture(
    detector: &mut dyn Detector,
    picture: &PictureView<'_>,
    settings: &TilingSettings,
) -> Result<PictureSearch> {
    let hits = first_pass(detector, picture, settings)?;
    let (size, picture_px) = (
        detector.window_size(),
        [picture.width_px, picture.height_px],
    );
    let windows: Vec<_> = hits
        .iter()
        .map(|hit| window_around(&hit.found.pixel_box, picture_px, size))
        .collect();
    let answers = detector.detect(picture, &windows, settings.least_score())?;
    let sightings = hits
        .iter()
        .zip(answers)
        .filter_map(|(hit, boxes)| confirm(hit, boxes))
        .collect();
    Ok(PictureSearch {
        sightings: keep_best(
            sightings,
            settings.merge_iou,
            settings.most_windows,
            |sighting| sighting.found,
        ),
        hits: hits.len(),
    })
}

/// Hits in the tiles, best first, in the coordinates of the frame.
fn first_pass(
    detector: &mut dyn Detector,
    picture: &PictureView<'_>,
    settings: &TilingSettings,
) -> Result<Vec<Sighting>> {
    let size = detector.window_size();
    settings.check_rows(picture.height_px)?;
    let windows = |rows, shrink| {
        let picture_px = [picture.width_px, picture.height_px];
        first_windows(picture_px, size, settings.tile_px, rows, shrink)
    };
    let shrink = detector.first_pass_shrink();
    let mut tiles = windows(settings.rows, shrink);
    if settings.half_scale_rows.is_some() {
        tiles.extend(windows(settings.half_scale_rows, shrink.max(2)));
    }
    let answers = detector.detect(picture, &tiles, settings.tile_score)?;
    let mut hits = Vec::new();
    for (tile, boxes) in (0..).zip(answers) {
        hits.extend(boxes.into_iter().map(|found| Sighting { found, tile }));
    }
    Ok(keep_best(
        hits,
        settings.merge_iou,
        settings.most_windows,
        |sighting| sighting.found,
    ))
}

/// The best second-pass box that overlaps the hit which requested it. Other aircraft in the window have their own hits.
fn confirm(hit: &Sighting, boxes: Vec<ScoredBox>) -> Option<Sighting> {
    let tile = hit.tile;
    boxes
        .into_iter()
        .filter(|found| found.pixel_box.iou(&hit.found.pixel_box) > 0.0)
        .max_by(|a, b| a.score.total_cmp(&b.score))
        .map(|found| Sighting { found, tile })
}

#[cfg(test)]
pub(crate) mod tests;
