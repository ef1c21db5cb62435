//! An aircraft at 6 NM: with its trajectory (the paper's figure 2), and with the search's tiles (figure 3).

use dataset::corpus::Corpus;
use dataset::corpus::detections::Detection;
use dataset::geometry::camera::Camera;
use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
use dataset::tables::frames::TickRow;
use dataset::tables::pixel_box::{PixelBox, TruthBox};
use image::imageops::{self, FilterType};
use image::{Rgb, RgbImage};

use super::drawing::{FOUND, TILE, TRUE, jpeg, line, outline};
use crate::error::{Error, Result};

/// Distance shown in the paper, NM.
const SHOWN_NM: f64 = 6.0;
/// Tolerance around that distance.
const NEAR_NM: f64 = 0.5;
/// Conditions of the image, if the corpus has them.
const WANTED: (&str, &str) = ("clear", "12:00");
/// Side of tiles and of the second pass's window, px.
const TILE_PX: u32 = 640;
/// Distance between a box and its outline, px.
const GAP_PX: f64 = 6.0;
/// Distance between the two parts of the image of the search, pixels.
const BETWEEN_PX: u32 = 8;
/// Maximum width of a figure's part, px.
const MAX_WIDTH_PX: u32 = 960;

/// The tick that is shown.
pub(super) struct Shown {
    picture: RgbImage,
    camera: Camera,
    true_box: PixelBox,
    found: Option<PixelBox>,
    /// All ticks of the flight.
    pub(super) rows: Vec<TickRow>,
    /// Distance of the threshold before the touchdown target, metres.
    pub(super) to_threshold_m: f64,
}

impl Shown {
    /// The first scenario with a tick near 6 NM and a view of the whole aircraft.
    pub(super) fn choose(corpus: &Corpus, detections: &str) -> Result<Self> {
        let mut folders = Vec::new();
        for folder in corpus.scenarios()? {
            let record = folder.open()?.record()?;
            let is_wanted = (record.weather_name(), record.time_of_day()) == WANTED;
            folders.push((!is_wanted, folder));
        }
        folders.sort_by_key(|(is_other, _)| *is_other);
        for (_, folder) in &folders {
            let scenario = folder.open()?;
            let rows = scenario.frames()?.rows;
            let Some(row) = nearest(&rows) else { continue };
            let is_whole =
                |of: &&TruthBox| of.is_of_first() && of.tick == row.tick && of.truncation == 0.0;
            let boxes = scenario.truth_boxes()?;
            let Some(truth) = boxes.iter().find(is_whole) else {
                continue;
            };
            let calibration = scenario.calibration()?;
            let Some(entry) = calibration.cameras.get(&truth.view) else {
                continue;
            };
            let is_here = |found: &&Detection| {
                found.confirmed && found.tick == row.tick && found.view == truth.view
            };
            let found = scenario.detections(detections)?.boxes;
            let found = found.iter().find(is_here).map(|found| found.pixel_box);
            let drawn = scenario.picture(&truth.view, row.tick)?;
            let [width, height] = drawn.size_px;
            let Some(picture) = RgbImage::from_raw(width, height, drawn.rgb) else {
                continue;
            };
            return Ok(Self {
                picture,
                camera: entry.camera(),
                true_box: truth.pixel_box,
                found,
                to_threshold_m: scenario.record()?.runway.touchdown_past_threshold_m,
                rows,
            });
        }
        Err(Error::NoPicture { dtd_nm: SHOWN_NM })
    }

    /// The image with the trajectory of the whole flight and the ground-truth box.
    pub(super) fn with_trajectory(&self) -> Result<Vec<u8>> {
        let mut picture = self.picture.clone();
        let places = self.rows.iter().filter_map(|row| {
            let place = row.pose.position().to_ecef();
            let at = self
                .camera
                .shows(place)
                .then(|| self.camera.project(place))??;
            Some([at.x, at.y])
        });
        // The aircraft stays visible.
        let [left, top, right, bottom] = around(&self.true_box);
        let is_beside = |[x, y]: &[f64; 2]| *x < left || *x > right || *y < top || *y > bottom;
        let places: Vec<[f64; 2]> = places.collect();
        for part in places.split(|place| !is_beside(place)) {
            line(&mut picture, part, 2, TRUE);
        }
        outline(&mut picture, [left, top, right, bottom], 2, TRUE);
        jpeg(&smaller(&picture), "the image at 6 NM")
    }

    /// The image with the tiles of the first pass, and beside it the window of the second pass with the box that it found.
    pub(super) fn with_tiles(&self) -> Result<Vec<u8>> {
        let (width, height) = self.picture.dimensions();
        let centre = self.found.unwrap_or(self.true_box);
        let side = TILE_PX.min(width).min(height);
        let start = |centre: f64, length: u32| {
            let first = (centre - f64::from(side) / 2.0).max(0.0) as u32;
            first.min(length - side)
        };
        let (left, top) = (start(centre.cx_px, width), start(centre.cy_px, height));
        let mut window = imageops::crop_imm(&self.picture, left, top, side, side).to_image();
        if let Some(found) = self.found {
            let [x0, y0, x1, y1] = around(&found);
            let (x, y) = (f64::from(left), f64::from(top));
            outline(&mut window, [x0 - x, y0 - y, x1 - x, y1 - y], 2, FOUND);
        }
        let mut picture = self.picture.clone();
        let starts = |length: u32| (0..length).step_by(TILE_PX as usize);
        for (x, y) in starts(width).flat_map(|x| starts(height).map(move |y| (x, y))) {
            let end = |start: u32, length: u32| (start + TILE_PX).min(length) - 1;
            let tile = [x, y, end(x, width), end(y, height)].map(f64::from);
            outline(&mut picture, tile, 2, TILE);
        }
        let edges = [left, top, left + side, top + side].map(f64::from);
        outline(&mut picture, edges, 2, FOUND);
        let picture = smaller(&picture);
        let height = picture.height();
        let window = imageops::resize(&window, height, height, FilterType::Triangle);
        let left = picture.width() + BETWEEN_PX;
        let mut both = RgbImage::from_pixel(left + height, height, Rgb([255; 3]));
        imageops::replace(&mut both, &picture, 0, 0);
        imageops::replace(&mut both, &window, i64::from(left), 0);
        jpeg(&both, "the image of the search")
    }
}

/// The tick nearest to 6 NM, if one is near.
fn nearest(rows: &[TickRow]) -> Option<&TickRow> {
    let off_nm = |row: &TickRow| {
        let labels = row.labels?;
        Some((labels.dtd_m / METERS_PER_NAUTICAL_MILE - SHOWN_NM).abs())
    };
    let near = rows.iter().filter_map(|row| Some((off_nm(row)?, row)));
    let nearest = near.min_by(|a, b| a.0.total_cmp(&b.0))?;
    (nearest.0 < NEAR_NM).then_some(nearest.1)
}

/// Edges of a box's outline.
fn around(pixel_box: &PixelBox) -> [f64; 4] {
    let [left, top, right, bottom] = pixel_box.edges();
    [left - GAP_PX, top - GAP_PX, right + GAP_PX, bottom + GAP_PX]
}

/// Shrinks the image to page width.
fn smaller(picture: &RgbImage) -> RgbImage {
    let (width, height) = picture.dimensions();
    if width <= MAX_WIDTH_PX {
        return picture.clone();
    }
    let height = (f64::from(height) * f64::from(MAX_WIDTH_PX) / f64::from(width)).round();
    imageops::resize(picture, MAX_WIDTH_PX, height as u32, FilterType::Triangle)
}
