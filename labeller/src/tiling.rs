//! Small aircraft in large images: the paper's Auto Segmentation.
//!
//! A first pass covers the image, in tiles or at once (`crate::tiling::search_windows`). A window is centred on every hit, so that an
//! aircraft on the border of two tiles is complete, and the detector runs again; its boxes there count. Several aircraft get a window
//! each. From the paper's section on detection (S11, S12).

#[cfg(test)]
pub(crate) mod blob_finder;
pub(crate) mod row_band;
pub(crate) mod search_windows;

use dataset::tables::pixel_box::PixelBox;
use serde::{Deserialize, Serialize};

use crate::detector::{Detector, PictureView, ScoredBox, WindowSize, keep_best};
use crate::error::{Error, Result};
use row_band::RowBand;
use search_windows::{first_windows, window_around};

/// Maximum number of second-pass windows that can be configured.
const MAX_WINDOWS: usize = 1_000;
/// Smaller tiles show too little around an aircraft, pixels.
const MIN_TILE_PX: u32 = 64;
/// Larger than any image's side, pixels.
const MAX_TILE_PX: u32 = 16_384;

/// Thresholds and windows of the search.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TilingSettings {
    /// Minimum score of a hit in a tile, 0 to 1. Below [`TilingSettings::score`], because the aircraft may be cut there.
    pub tile_score: f64,
    /// Minimum score of a detection in a centred window, 0 to 1.
    pub score: f64,
    /// A fainter box, down to this score, counts if it belongs to a track that others confirm.
    pub faint_score: f64,
    /// Boxes that overlap by more than this (intersection over union) are one aircraft, 0 to 1.
    pub merge_iou: f64,
    /// Maximum number of hits per image that get a second pass, the best first: limits the time spent on clutter.
    pub most_windows: usize,
    /// Side of the tiles, pixels, rounded up to the model's stride, for a model that takes any size; missing: the whole image at
    /// once. Models of a fixed size have tiles of that size.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tile_px: Option<u32>,
    /// Overlap of neighbouring tiles, pixels.
    #[serde(default)]
    pub overlap_px: u32,
    /// Rows that the first pass covers; missing: all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rows: Option<RowBand>,
    /// Rows that the first pass covers at half the image's scale as well, where aircraft are large; missing: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
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
            overlap_px: 0,
            rows: None,
            half_scale_rows: None,
        }
    }
}

impl TilingSettings {
    /// Checks all ranges.
    pub fn check(&self) -> Result<()> {
        let ratios = [
            ("tile_score", self.tile_score),
            ("score", self.score),
            ("faint_score", self.faint_score),
            ("merge_iou", self.merge_iou),
        ];
        for (name, value) in ratios {
            if !(0.0..=1.0).contains(&value) {
                return Err(Error::Option {
                    name,
                    found: value.to_string(),
                    expected: "a number from 0 to 1".into(),
                });
            }
        }
        if !(1..=MAX_WINDOWS).contains(&self.most_windows) {
            return Err(Error::Option {
                name: "most_windows",
                found: self.most_windows.to_string(),
                expected: "1 to 1000".into(),
            });
        }
        let tiles = MIN_TILE_PX..=MAX_TILE_PX;
        if let Some(found) = self.tile_px.filter(|side_px| !tiles.contains(side_px)) {
            return Err(Error::Option {
                name: "--tile",
                found: found.to_string(),
                expected: "64 to 16384".into(),
            });
        }
        let empty = self.bands().find(|band| band.top_px >= band.bottom_px);
        if let Some(RowBand { top_px, bottom_px }) = empty {
            return Err(Error::Option {
                name: "--rows",
                found: format!("{top_px}:{bottom_px}"),
                expected: "a first row above the last".into(),
            });
        }
        Ok(())
    }

    /// The score of the faintest boxes that may count.
    pub(crate) fn least_score(&self) -> f64 {
        self.faint_score.min(self.score)
    }

    /// The rows of both scales, as far as they are limited.
    fn bands(&self) -> impl Iterator<Item = RowBand> {
        [self.rows, self.half_scale_rows].into_iter().flatten()
    }

    /// Checks that some of the rows are in an image of this height.
    fn check_rows(&self, height_px: u32) -> Result<()> {
        match self.bands().find(|band| band.top_px >= height_px) {
            Some(band) => Err(Error::Option {
                name: "--rows",
                found: band.to_string(),
                expected: format!("a first row below {height_px}, the height of the images"),
            }),
            None => Ok(()),
        }
    }

    /// Checks that tiles of a model leave something between their overlaps.
    pub(crate) fn check_overlap(&self, size: WindowSize) -> Result<()> {
        let tile_px = match (size, self.tile_px) {
            (WindowSize::Any { .. }, None) if self.overlap_px == 0 => return Ok(()),
            (WindowSize::Any { .. }, None) => {
                return Err(Error::Option {
                    name: "--overlap",
                    found: self.overlap_px.to_string(),
                    expected: "0, or --tile as well: this model searches the whole image at once"
                        .into(),
                });
            }
            (WindowSize::Any { .. }, Some(tile_px)) => tile_px,
            (fixed, _) => fixed.usual_px().into_iter().min().unwrap_or_default(),
        };
        if self.overlap_px > tile_px / 2 {
            return Err(Error::Option {
                name: "--overlap",
                found: self.overlap_px.to_string(),
                expected: format!("at most half the side of a tile, {}", tile_px / 2),
            });
        }
        Ok(())
    }
}

/// An aircraft that was found in an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// The box in the original frame.
    pub pixel_box: PixelBox,
    /// Confidence of the second pass, 0 to 1.
    pub score: f64,
    /// Number of the window of the first pass (row-major, from 0) that saw it.
    pub tile: u32,
}

/// Results of a search of a whole image.
pub(crate) struct Found {
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
    found.retain(|sighting| sighting.score >= settings.score);
    Ok(found)
}

/// The same, with what the first pass found.
pub(crate) fn search_picture(
    detector: &mut dyn Detector,
    picture: &PictureView<'_>,
    settings: &TilingSettings,
) -> Result<Found> {
    let hits = first_pass(detector, picture, settings)?;
    let (size, picture_px) = (
        detector.window_size(),
        [picture.width_px, picture.height_px],
    );
    let windows: Vec<_> = hits
        .iter()
        .map(|hit| window_around(&hit.pixel_box, picture_px, size))
        .collect();
    let answers = detector.detect(picture, &windows, settings.least_score())?;
    let sightings = hits
        .iter()
        .zip(answers)
        .filter_map(|(hit, boxes)| confirm(hit, boxes))
        .collect();
    Ok(Found {
        sightings: keep_best(
            sightings,
            settings.merge_iou,
            settings.most_windows,
            Sighting::scored,
        ),
        hits: hits.len(),
    })
}

impl Sighting {
    pub(crate) fn of(found: ScoredBox, tile: u32) -> Self {
        Self {
            pixel_box: found.pixel_box,
            score: found.score,
            tile,
        }
    }

    pub(crate) fn scored(&self) -> ScoredBox {
        ScoredBox {
            pixel_box: self.pixel_box,
            score: self.score,
        }
    }
}

/// Hits in the tiles, best first, in the coordinates of the frame.
fn first_pass(
    detector: &mut dyn Detector,
    picture: &PictureView<'_>,
    settings: &TilingSettings,
) -> Result<Vec<Sighting>> {
    let size = detector.window_size();
    settings.check_overlap(size)?;
    settings.check_rows(picture.height_px)?;
    let windows = |rows, shrink| {
        let picture_px = [picture.width_px, picture.height_px];
        let (tile_px, overlap_px) = (settings.tile_px, settings.overlap_px);
        first_windows(picture_px, size, tile_px, overlap_px, rows, shrink)
    };
    let shrink = detector.first_pass_shrink();
    let mut tiles = windows(settings.rows, shrink);
    if settings.half_scale_rows.is_some() {
        tiles.extend(windows(settings.half_scale_rows, shrink.max(2)));
    }
    let answers = detector.detect(picture, &tiles, settings.tile_score)?;
    let mut hits = Vec::new();
    for (tile, boxes) in (0..).zip(answers) {
        hits.extend(boxes.into_iter().map(|found| Sighting::of(found, tile)));
    }
    Ok(keep_best(
        hits,
        settings.merge_iou,
        settings.most_windows,
        Sighting::scored,
    ))
}

/// The best box of the second pass that overlaps the hit which requested it. Another aircraft in the same window has its own hit.
fn confirm(hit: &Sighting, boxes: Vec<ScoredBox>) -> Option<Sighting> {
    boxes
        .into_iter()
        .map(|found| Sighting::of(found, hit.tile))
        .filter(|sighting| sighting.pixel_box.iou(&hit.pixel_box) > 0.0)
        .max_by(|a, b| a.score.total_cmp(&b.score))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tiling::blob_finder::{BlobFinder, paint_blob};

    const WIDTH: u32 = 1920;
    const HEIGHT: u32 = 1280;

    fn find(width_px: u32, height_px: u32, blobs: &[PixelBox]) -> (Vec<Sighting>, BlobFinder) {
        let mut rgb = vec![0; (width_px * height_px * 3) as usize];
        for blob in blobs {
            paint_blob(&mut rgb, width_px, blob);
        }
        let mut finder = BlobFinder::default();
        let picture = PictureView {
            rgb: &rgb,
            width_px,
            height_px,
        };
        let found = find_aircraft(&mut finder, &picture, &TilingSettings::default()).unwrap();
        (found, finder)
    }

    /// A box of whole pixels, from its first to its last column and row.
    fn pixels(columns: (u32, u32), rows: (u32, u32)) -> PixelBox {
        let edge = |pixel: u32, side: f64| f64::from(pixel) + side;
        PixelBox::from_edges(
            edge(columns.0, -0.5),
            edge(rows.0, -0.5),
            edge(columns.1, 0.5),
            edge(rows.1, 0.5),
        )
    }

    #[test]
    fn coordinates_come_back_exactly_from_every_tile() {
        let places = [
            (20, 30),
            (700, 100),
            (1_900, 610),
            (5, 1_200),
            (1_000, 900),
            (1_910, 1_275),
        ];
        for (tile, (column, row)) in (0..).zip(places) {
            let blob = pixels((column, column + 6), (row, row + 2));
            let (found, _) = find(WIDTH, HEIGHT, &[blob]);
            assert_eq!(
                found,
                [Sighting {
                    pixel_box: blob,
                    score: 1.0,
                    tile
                }]
            );
        }
    }

    #[test]
    fn an_aircraft_across_four_tiles_is_found_whole_by_the_second_pass_and_once() {
        let blob = pixels((630, 655), (636, 645));
        let (found, finder) = find(WIDTH, HEIGHT, &[blob]);
        assert_eq!(
            found
                .iter()
                .map(|sighting| sighting.pixel_box)
                .collect::<Vec<_>>(),
            [blob]
        );
        assert_eq!(finder.windows_seen, 6 + 4, "four tiles show a part each");
    }

    #[test]
    fn several_aircraft_get_a_window_each() {
        let blobs = [
            pixels((100, 120), (100, 106)),
            pixels((1_500, 1_507), (1_000, 1_002)),
        ];
        let (found, _) = find(WIDTH, HEIGHT, &blobs);
        let mut boxes: Vec<_> = found.iter().map(|sighting| sighting.pixel_box).collect();
        boxes.sort_by(|a, b| a.cx_px.total_cmp(&b.cx_px));
        assert_eq!(boxes, blobs);
    }

    #[test]
    fn pictures_that_are_no_multiple_of_a_tile_or_smaller_than_one_work_too() {
        for (width, height, blob) in [
            (1_920, 1_080, pixels((1_000, 1_008), (1_070, 1_079))),
            (300, 200, pixels((290, 299), (3, 5))),
        ] {
            let (found, _) = find(width, height, &[blob]);
            assert_eq!(
                found
                    .iter()
                    .map(|sighting| sighting.pixel_box)
                    .collect::<Vec<_>>(),
                [blob]
            );
        }
    }

    #[test]
    fn an_empty_picture_has_no_aircraft_and_no_second_pass() {
        let (found, finder) = find(WIDTH, HEIGHT, &[]);
        assert_eq!((found.len(), finder.windows_seen), (0, 6));
    }

    #[test]
    fn a_finder_of_any_size_looks_at_the_whole_picture_and_once_more_at_each_hit() {
        let blob = pixels((630, 655), (636, 645));
        let mut rgb = vec![0; (WIDTH * HEIGHT * 3) as usize];
        paint_blob(&mut rgb, WIDTH, &blob);
        let picture = PictureView {
            rgb: &rgb,
            width_px: WIDTH,
            height_px: HEIGHT,
        };
        let mut finder = BlobFinder::of_any_size();
        let mut settings = TilingSettings::default();
        let found = find_aircraft(&mut finder, &picture, &settings).unwrap();
        assert_eq!((found.len(), found[0].pixel_box), (1, blob));
        assert_eq!(finder.windows_seen, 2);
        settings.rows = Some(RowBand {
            top_px: 700,
            bottom_px: 1_280,
        });
        let found = find_aircraft(&mut finder, &picture, &settings).unwrap();
        assert_eq!(found, [], "the blob is above these rows");
        settings.half_scale_rows = Some(RowBand {
            top_px: 400,
            bottom_px: 800,
        });
        let found = find_aircraft(&mut finder, &picture, &settings).unwrap();
        assert_eq!((found.len(), found[0].pixel_box), (1, blob));
        assert_eq!(found[0].tile, 1);
        settings = TilingSettings::default();
        finder.first_pass_shrink = 2;
        finder.windows_seen = 0;
        let found = find_aircraft(&mut finder, &picture, &settings).unwrap();
        assert_eq!((found.len(), found[0].pixel_box), (1, blob));
        assert_eq!(finder.windows_seen, 2);
        settings.rows = Some(RowBand {
            top_px: 1_280,
            bottom_px: 2_000,
        });
        let refused = find_aircraft(&mut finder, &picture, &settings).unwrap_err();
        assert!(
            refused.to_string().contains("1280:2000") && refused.to_string().contains("below 1280"),
            "{refused}"
        );
    }

    #[test]
    fn tiles_that_overlap_by_more_than_half_are_refused() {
        let settings = TilingSettings {
            overlap_px: 321,
            ..Default::default()
        };
        let message = settings.check_overlap(WindowSize::square(640));
        assert!(message.unwrap_err().to_string().contains("at most half"));
        assert!(settings.check_overlap(WindowSize::square(642)).is_ok());
        let whole = settings.check_overlap(WindowSize::Any { multiple_px: 32 });
        assert!(whole.unwrap_err().to_string().contains("--tile"));
    }

    #[test]
    fn settings_out_of_range_are_refused_by_name() {
        let message = TilingSettings {
            score: 1.5,
            ..Default::default()
        }
        .check()
        .unwrap_err()
        .to_string();
        assert!(
            message.contains("score") && message.contains("1.5"),
            "{message}"
        );
    }
}
