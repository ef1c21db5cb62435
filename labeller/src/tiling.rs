//! Small aircraft in large pictures: the paper's Auto Segmentation.
//!
//! A picture is cut into non-overlapping tiles of the detector's size (six of 640 pixels for 1920x1280). A window of the same size
//! is centred on every hit, so that an aircraft on the border of two tiles is complete, and the detector runs again; its boxes
//! there count, in the coordinates of the original frame. Several aircraft get a window each. From the paper's section on detection
//! (S11, S12).

use dataset::pixel_box::PixelBox;
use serde::{Deserialize, Serialize};

use crate::detector::{Detector, PictureView, ScoredBox, Window, keep_best};
use crate::error::{Error, Result};

/// Maximum number of second-pass windows that can be configured.
const MOST_WINDOWS: usize = 1_000;

/// What counts as a hit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TilingSettings {
    /// Minimum score of a hit in a tile, 0 to 1. Below [`TilingSettings::score`], because the aircraft may be cut there.
    pub tile_score: f64,
    /// Minimum score of a detection in a centred window, 0 to 1.
    pub score: f64,
    /// Boxes that overlap by more than this (intersection over union) are one aircraft, 0 to 1.
    pub merge_iou: f64,
    /// Maximum number of hits per picture that get a second pass, the best first: limits the time spent on clutter.
    pub most_windows: usize,
}

impl Default for TilingSettings {
    fn default() -> Self {
        Self {
            tile_score: 0.15,
            score: 0.3,
            merge_iou: 0.3,
            most_windows: 6,
        }
    }
}

impl TilingSettings {
    /// Checks all ranges.
    pub fn check(&self) -> Result<()> {
        let ratios = [
            ("tile_score", self.tile_score),
            ("score", self.score),
            ("merge_iou", self.merge_iou),
        ];
        for (name, value) in ratios {
            if !(0.0..=1.0).contains(&value) {
                return Err(Error::Option {
                    name,
                    found: value.to_string(),
                    expected: "a number from 0 to 1",
                });
            }
        }
        if !(1..=MOST_WINDOWS).contains(&self.most_windows) {
            return Err(Error::Option {
                name: "most_windows",
                found: self.most_windows.to_string(),
                expected: "1 to 1000",
            });
        }
        Ok(())
    }
}

/// An aircraft that was found in a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// The box in the original frame.
    pub pixel_box: PixelBox,
    /// Confidence of the second pass, 0 to 1.
    pub score: f64,
    /// Number of the tile (row-major, from 0) in which the first pass saw it.
    pub tile: u32,
}

/// Finds all aircraft in a picture, best first.
pub fn find_aircraft(
    detector: &mut dyn Detector,
    picture: &PictureView<'_>,
    settings: &TilingSettings,
) -> Result<Vec<Sighting>> {
    let hits = first_pass(detector, picture, settings)?;
    let windows: Vec<_> = hits
        .iter()
        .map(|hit| centred_window(&hit.pixel_box, picture, detector.window_px()))
        .collect();
    let answers = detector.detect(picture, &windows, settings.score)?;
    let sightings = hits
        .iter()
        .zip(windows)
        .zip(answers)
        .filter_map(|((hit, window), boxes)| confirm(hit, window, boxes))
        .collect();
    Ok(keep_best(
        sightings,
        settings.merge_iou,
        settings.most_windows,
        Sighting::scored,
    ))
}

impl Sighting {
    fn scored(&self) -> ScoredBox {
        ScoredBox {
            pixel_box: self.pixel_box,
            score: self.score,
        }
    }
}

/// Corners of the tiles of a picture, row by row. Tiles at the right and at the bottom may extend past the picture.
pub(crate) fn tiles_of(width_px: u32, height_px: u32, tile_px: u32) -> Vec<Window> {
    let starts = |length_px: u32| (0..length_px.div_ceil(tile_px)).map(move |k| k * tile_px);
    starts(height_px)
        .flat_map(|top_px| starts(width_px).map(move |left_px| Window { left_px, top_px }))
        .collect()
}

/// Hits in the tiles, best first, in the coordinates of the frame.
fn first_pass(
    detector: &mut dyn Detector,
    picture: &PictureView<'_>,
    settings: &TilingSettings,
) -> Result<Vec<Sighting>> {
    let tiles = tiles_of(picture.width_px, picture.height_px, detector.window_px());
    let answers = detector.detect(picture, &tiles, settings.tile_score)?;
    let mut hits = Vec::new();
    for (tile, (window, boxes)) in (0..).zip(tiles.into_iter().zip(answers)) {
        let in_frame = |found: ScoredBox| Sighting {
            pixel_box: to_frame(found, window),
            score: found.score,
            tile,
        };
        hits.extend(boxes.into_iter().map(in_frame));
    }
    Ok(keep_best(
        hits,
        settings.merge_iou,
        settings.most_windows,
        Sighting::scored,
    ))
}

/// The window centred on the box, moved inside the picture if the picture is large enough.
fn centred_window(around: &PixelBox, picture: &PictureView<'_>, window_px: u32) -> Window {
    let start = |centre_px: f64, picture_px: u32| {
        let start = (centre_px - f64::from(window_px - 1) / 2.0).round();
        start.clamp(0.0, f64::from(picture_px.saturating_sub(window_px))) as u32
    };
    Window {
        left_px: start(around.cx_px, picture.width_px),
        top_px: start(around.cy_px, picture.height_px),
    }
}

/// The best box of the second pass that overlaps the hit which requested it. Another aircraft in the same window has its own hit.
fn confirm(hit: &Sighting, window: Window, boxes: Vec<ScoredBox>) -> Option<Sighting> {
    boxes
        .into_iter()
        .map(|found| Sighting {
            pixel_box: to_frame(found, window),
            score: found.score,
            tile: hit.tile,
        })
        .filter(|sighting| sighting.pixel_box.iou(&hit.pixel_box) > 0.0)
        .max_by(|a, b| a.score.total_cmp(&b.score))
}

fn to_frame(found: ScoredBox, window: Window) -> PixelBox {
    PixelBox {
        cx_px: found.pixel_box.cx_px + f64::from(window.left_px),
        cy_px: found.pixel_box.cy_px + f64::from(window.top_px),
        ..found.pixel_box
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::blob_finder::{BlobFinder, paint_blob};

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
    fn a_full_frame_is_six_tiles_row_by_row() {
        let corners: Vec<_> = tiles_of(WIDTH, HEIGHT, 640)
            .iter()
            .map(|tile| (tile.left_px, tile.top_px))
            .collect();
        assert_eq!(
            corners,
            [
                (0, 0),
                (640, 0),
                (1280, 0),
                (0, 640),
                (640, 640),
                (1280, 640)
            ]
        );
        assert_eq!(tiles_of(WIDTH, 1080, 640).len(), 6);
        assert_eq!(tiles_of(WIDTH, HEIGHT, 416).len(), 20);
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
