//! Training images, and whether the aircraft in one is visible at all.
//!
//! Input: decoded frames and ground-truth boxes. Output: pieces of frames with their aircraft. An aircraft hidden by fog is neither a hit
//! nor a miss, and no table knows what the codec has left of it, so the pixels decide.

use dataset::tables::pixel_box::{PixelBox, TruthBox};

use crate::crop::cover::Cover;
use crate::grid::targets::CropTruth;

/// Minimum part of the silhouette inside the image and above the ground.
const MIN_VISIBLE_FRACTION: f64 = 0.4;
/// Minimum contrast against a plane through the surroundings, grey levels of 255; less is lost in the codec's noise.
const MIN_CONTRAST: f64 = 2.0;
/// Minimum aircraft strength relative to the texture behind it.
const MIN_PROMINENCE: f64 = 1.2;

/// A frame or a piece of one.
#[derive(Debug, Clone)]
pub struct TrainingPicture {
    /// Interleaved RGB, row-major.
    pub rgb: Vec<u8>,
    /// Width, pixels.
    pub width_px: usize,
    /// Height, pixels.
    pub height_px: usize,
    /// The aircraft, pixels of this piece.
    pub aircraft: Option<CropTruth>,
    /// The aircraft's cover, if known.
    pub cover: Option<Cover>,
}

impl TrainingPicture {
    /// Cuts the piece that starts at pixel (`left`, `top`), without a cover.
    pub fn piece(&self, left: usize, top: usize, width_px: usize, height_px: usize) -> Self {
        let mut rgb = Vec::with_capacity(width_px * height_px * 3);
        for y in top..top + height_px {
            rgb.extend_from_slice(&self.rgb[(y * self.width_px + left) * 3..][..width_px * 3]);
        }
        let aircraft = self.aircraft.map(|truth| {
            let pixel_box = PixelBox {
                cx_px: truth.pixel_box.cx_px - left as f64,
                cy_px: truth.pixel_box.cy_px - top as f64,
                ..truth.pixel_box
            };
            CropTruth { pixel_box, ..truth }
        });
        Self {
            rgb,
            width_px,
            height_px,
            aircraft,
            cover: None,
        }
    }

    fn grey(&self, x: usize, y: usize) -> f64 {
        let pixel = &self.rgb[(y * self.width_px + x) * 3..][..3];
        pixel.iter().map(|&value| f64::from(value)).sum::<f64>() / 3.0
    }
}

/// True if a ground-truth box's aircraft is visible in a frame. Atmospheric transmission is not a criterion: landing lights are visible
/// through fog that hides the aircraft itself.
pub fn is_visible(frame: &TrainingPicture, truth: &TruthBox) -> bool {
    may_be_visible(truth) && contrast(frame, &truth.pixel_box) >= MIN_CONTRAST
}

/// True if a large enough part is within the frame; haze and fog are judged from the pixels alone.
pub(crate) fn may_be_visible(truth: &TruthBox) -> bool {
    truth.visible_fraction >= MIN_VISIBLE_FRACTION
}

/// Box contrast: departure of its strongest tenth of pixels from a plane through its surroundings, grey levels, minus half of the same
/// figure for the surroundings themselves.
pub fn contrast(frame: &TrainingPicture, pixel_box: &PixelBox) -> f64 {
    let size = [frame.width_px, frame.height_px];
    Strength::of(|x, y| frame.grey(x, y), size, pixel_box).contrast()
}

/// Strength of an aircraft and its surroundings: mean distance of the strongest tenth of pixels from a plane through the surroundings, grey
/// levels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Strength {
    inside: f64,
    outside: f64,
}

impl Strength {
    /// Strength in a crop's box; `pixels` are interleaved, 0 to 1.
    pub(crate) fn in_crop(pixels: &[f32], side_px: usize, pixel_box: &PixelBox) -> Self {
        let grey = |x: usize, y: usize| {
            let pixel = &pixels[(y * side_px + x) * 3..][..3];
            f64::from(pixel.iter().sum::<f32>()) * (255.0 / 3.0)
        };
        Self::of(grey, [side_px; 2], pixel_box)
    }

    fn of(grey: impl Fn(usize, usize) -> f64, size_px: [usize; 2], pixel_box: &PixelBox) -> Self {
        let Departures { inside, outside } = Departures::of(grey, size_px, pixel_box);
        let strongest_tenth = |departures: Vec<f64>| {
            let mut distances: Vec<f64> = departures.into_iter().map(f64::abs).collect();
            distances.sort_by(|a, b| b.total_cmp(a));
            let count = distances.len().div_ceil(10);
            distances.iter().take(count).sum::<f64>() / count.max(1) as f64
        };
        Self {
            inside: strongest_tenth(inside),
            outside: strongest_tenth(outside),
        }
    }

    fn contrast(&self) -> f64 {
        self.inside - 0.5 * self.outside
    }

    /// True if the aircraft is stronger than the strongest spots of the texture behind it.
    pub(crate) fn stands_out(&self) -> bool {
        self.contrast() >= MIN_CONTRAST && self.inside >= MIN_PROMINENCE * self.outside
    }
}

/// Departures of a box's pixels and its surroundings from a plane through the surroundings, grey levels.
struct Departures {
    inside: Vec<f64>,
    outside: Vec<f64>,
}

impl Departures {
    fn of(
        grey: impl Fn(usize, usize) -> f64,
        [width_px, height_px]: [usize; 2],
        pixel_box: &PixelBox,
    ) -> Self {
        let margin = 4.0_f64.max(0.25 * pixel_box.width_px);
        let [left, top, right, bottom] = pixel_box.edges();
        let span = |low: f64, high: f64, length: usize| {
            let last = length as f64 - 1.0;
            (low.clamp(0.0, last).round() as usize)..=(high.clamp(0.0, last).round() as usize)
        };
        let mut inner = Vec::new();
        let mut outer = Vec::new();
        for y in span(top - margin, bottom + margin, height_px) {
            for x in span(left - margin, right + margin, width_px) {
                let (px, py) = (x as f64, y as f64);
                let inside = (left..=right).contains(&px) && (top..=bottom).contains(&py);
                let near = (left - 1.5..=right + 1.5).contains(&px)
                    && (top - 1.5..=bottom + 1.5).contains(&py);
                let sample = [px - pixel_box.cx_px, py - pixel_box.cy_px, grey(x, y)];
                if inside {
                    inner.push(sample);
                } else if !near {
                    outer.push(sample);
                }
            }
        }
        let [level, right, down] = fitted_plane(&outer);
        let departures = |samples: &[[f64; 3]]| {
            let departure = |&[x, y, grey]: &[f64; 3]| grey - level - right * x - down * y;
            samples.iter().map(departure).collect()
        };
        Self {
            inside: departures(&inner),
            outside: departures(&outer),
        }
    }
}

/// Least squares `grey = a + b x + c y`, by Cramer's rule; a constant where the samples do not span a plane.
fn fitted_plane(samples: &[[f64; 3]]) -> [f64; 3] {
    let sum = |term: fn(&[f64; 3]) -> f64| samples.iter().map(term).sum::<f64>();
    let count = samples.len() as f64;
    let matrix = glam::DMat3::from_cols_array(&[
        count,
        sum(|s| s[0]),
        sum(|s| s[1]),
        sum(|s| s[0]),
        sum(|s| s[0] * s[0]),
        sum(|s| s[0] * s[1]),
        sum(|s| s[1]),
        sum(|s| s[0] * s[1]),
        sum(|s| s[1] * s[1]),
    ]);
    let right = glam::DVec3::new(sum(|s| s[2]), sum(|s| s[0] * s[2]), sum(|s| s[1] * s[2]));
    if matrix.determinant() > 1e-6 {
        (matrix.inverse() * right).to_array()
    } else {
        [right.x / count.max(1.0), 0.0, 0.0]
    }
}

#[cfg(test)]
pub(crate) use tests::sky_with_bar;

#[cfg(test)]
mod tests {
    use super::*;

    /// A sky that brightens downwards with a dark bar in it.
    pub(crate) fn sky_with_bar(darker_by: f64) -> (TrainingPicture, TruthBox) {
        let (width_px, height_px) = (96, 64);
        let pixel_box = PixelBox {
            cx_px: 50.0,
            cy_px: 30.0,
            width_px: 21.0,
            height_px: 7.0,
        };
        let [left, top, right, bottom] = pixel_box.edges();
        let mut rgb = Vec::new();
        for y in 0..height_px {
            for x in 0..width_px {
                let (px, py) = (x as f64, y as f64);
                let inside = (left..right).contains(&px) && (top..bottom).contains(&py);
                let grey = 120.0 + 0.5 * py - if inside { darker_by } else { 0.0 };
                rgb.extend([grey.round() as u8; 3]);
            }
        }
        let truth = TruthBox {
            tick: 0,
            view: "left".into(),
            class: "aircraft".into(),
            pixel_box,
            visible_fraction: 1.0,
            truncation: 0.0,
            transmission: 0.5,
            aircraft_number: None,
            occluded_fraction: None,
        };
        let aircraft = Some(CropTruth {
            pixel_box,
            visible: true,
        });
        (
            TrainingPicture {
                rgb,
                width_px,
                height_px,
                aircraft,
                cover: None,
            },
            truth,
        )
    }

    #[test]
    fn a_slope_of_brightness_is_no_contrast_and_a_bar_has_its_own() {
        let (sky, truth) = sky_with_bar(0.0);
        assert!(contrast(&sky, &truth.pixel_box) < 1.0);
        let (sky, truth) = sky_with_bar(20.0);
        assert!((contrast(&sky, &truth.pixel_box) - 20.0).abs() < 1.0);
    }

    #[test]
    fn what_fog_or_the_horizon_hides_is_not_visible() {
        let (sky, truth) = sky_with_bar(20.0);
        assert!(is_visible(&sky, &truth));
        assert!(!is_visible(
            &sky,
            &TruthBox {
                visible_fraction: 0.2,
                ..truth.clone()
            }
        ));
        assert!(!is_visible(&sky_with_bar(1.0).0, &truth));
    }

    #[test]
    fn a_piece_keeps_pixels_and_boxes_together() {
        let (sky, truth) = sky_with_bar(20.0);
        let piece = sky.piece(30, 10, 40, 40);
        assert_eq!(piece.grey(5, 6), sky.grey(35, 16));
        assert_eq!(
            piece.aircraft.unwrap().pixel_box.cx_px,
            truth.pixel_box.cx_px - 30.0
        );
    }
}
