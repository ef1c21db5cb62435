//! A box's surroundings, with and without background.

use std::iter::repeat_n;

use dataset::numbers::least_squares::{dot, robust_fit};
use dataset::numbers::spread::deviation_from_zero;
use dataset::tables::pixel_box::PixelBox;
use dataset::tables::registrations::NoShift;
use dataset::video::PicturePart;
use glam::DVec2;

use super::{MIN_CONTRAST, SEARCH_PART, SEARCH_PX};
use crate::detector::PictureView;

/// A box whose edge is closer to the image's edge than this may be cut off.
pub(crate) const EDGE_PX: f64 = 1.5;
/// Maximum box size in full resolution, px: for larger aircraft, perspective limits the accuracy.
const MAX_BOX_PX: f64 = 192.0;
/// Grey levels are stored in steps of 1/256.
const STEPS_PER_GREY: f64 = 256.0;

/// Luma around a box, background included. Small, because it waits for the other view.
#[derive(Debug, Clone, PartialEq)]
pub struct Patch {
    pixel_box: PixelBox,
    /// Centre of the first pixel, in the image.
    origin_px: DVec2,
    /// Image pixels per patch pixel, along a side.
    bin: usize,
    width: usize,
    luma: Vec<u16>,
}

impl Patch {
    /// The image part around a box, for an image of this width and height.
    ///
    /// # Errors
    /// The image's edge cuts off the aircraft.
    pub(crate) fn part_around(
        pixel_box: PixelBox,
        [width_px, height_px]: [u32; 2],
    ) -> Result<PicturePart, NoShift> {
        let [left, top, right, bottom] = pixel_box.edges();
        let is_inside = left >= EDGE_PX - 0.5
            && top >= EDGE_PX - 0.5
            && right <= f64::from(width_px) - 0.5 - EDGE_PX
            && bottom <= f64::from(height_px) - 0.5 - EDGE_PX;
        if !is_inside {
            return Err(NoShift::Edge);
        }
        let longer = pixel_box.width_px.max(pixel_box.height_px);
        // The aircraft's edge, the background ring and room to search.
        let margin_px = 1.0 + GLOW_PX + RING_PX + SEARCH_PX;
        let margin = bin_of(pixel_box) as f64 * margin_px + (GLOW_PART + SEARCH_PART) * longer;
        let start = |edge: f64| (edge - margin).max(0.0) as u32;
        let end = |edge: f64, length: u32| ((edge + margin).max(0.0) as u32).min(length);
        Ok(PicturePart {
            left_px: start(left),
            top_px: start(top),
            width_px: end(right, width_px) - start(left),
            height_px: end(bottom, height_px) - start(top),
        })
    }

    /// Makes the patch from the part's pixels.
    pub(crate) fn of(pixels: &PictureView<'_>, part: PicturePart, pixel_box: PixelBox) -> Self {
        let bin = bin_of(pixel_box);
        let width = part.width_px as usize / bin;
        let height = part.height_px as usize / bin;
        let mut luma = Vec::with_capacity(width * height);
        for row in 0..height {
            for column in 0..width {
                let mut sum = 0.0;
                for y in row * bin..(row + 1) * bin {
                    let start = (y * part.width_px as usize + column * bin) * 3;
                    sum += pixels.rgb[start..start + 3 * bin]
                        .chunks_exact(3)
                        .map(luma_of)
                        .sum::<f64>();
                }
                luma.push((sum / (bin * bin) as f64 * STEPS_PER_GREY).round() as u16);
            }
        }
        let half = (bin as f64 - 1.0) / 2.0;
        Self {
            pixel_box,
            origin_px: DVec2::new(f64::from(part.left_px), f64::from(part.top_px)) + half,
            bin,
            width,
            luma,
        }
    }

    pub(super) fn bin(&self) -> usize {
        self.bin
    }

    /// The centre of the box, in the image.
    pub(crate) fn centre_px(&self) -> DVec2 {
        DVec2::new(self.pixel_box.cx_px, self.pixel_box.cy_px)
    }

    /// Shrinks the patch to this bin, if its own is smaller.
    pub(super) fn binned(&self, bin: usize) -> Self {
        let by = bin / self.bin;
        if by < 2 {
            return self.clone();
        }
        let height = self.luma.len() / self.width / by;
        let width = self.width / by;
        let mean = |row: usize, column: usize| {
            let lines = row * by..(row + 1) * by;
            let sum: u64 = lines
                .flat_map(|y| {
                    let start = y * self.width + column * by;
                    &self.luma[start..start + by]
                })
                .map(|grey| u64::from(*grey))
                .sum();
            (sum / (by * by) as u64) as u16
        };
        Self {
            origin_px: self.origin_px + self.bin as f64 * (by as f64 - 1.0) / 2.0,
            bin,
            width,
            luma: (0..height)
                .flat_map(|row| (0..width).map(move |column| (row, column)))
                .map(|(row, column)| mean(row, column))
                .collect(),
            ..*self
        }
    }
}

/// Image pixels per patch pixel, along a side: a power of two, so that the patches of two views can have equal pixels.
fn bin_of(pixel_box: PixelBox) -> usize {
    let longer = pixel_box.width_px.max(pixel_box.height_px);
    ((longer / MAX_BOX_PX).ceil() as usize).next_power_of_two()
}

/// ITU-R BT.709.
fn luma_of(rgb: &[u8]) -> f64 {
    0.2126 * f64::from(rgb[0]) + 0.7152 * f64::from(rgb[1]) + 0.0722 * f64::from(rgb[2])
}

/// A patch without its background, slightly blurred. Coordinates are pixels of the patch.
#[derive(Debug, Clone)]
pub(super) struct Cleaned {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Grey levels above the background.
    values: Vec<f64>,
    /// Standard deviation of the background, grey levels.
    pub(super) noise: f64,
    pub(super) centre: DVec2,
    pub(super) size: DVec2,
    origin_px: DVec2,
    bin: usize,
}

/// Reach of the aircraft's glow and blur outside the box: pixels, and a part of the box's width.
const GLOW_PX: f64 = 5.0;
/// See [`GLOW_PX`].
const GLOW_PART: f64 = 0.1;
/// Width of the ring that shows the background.
const RING_PX: f64 = 14.0;
/// Standard deviation of the blur for equally large images: just enough that the interpolation does not depend on the subpixel position.
pub(super) const BLUR_PX: f64 = 0.8;
/// Standard deviations over which a blur reaches.
const BLUR_REACH: f64 = 4.0;
/// Minimum noise, grey levels: neighbours in 8-bit images are rounded alike.
const MIN_NOISE: f64 = 0.15;
/// Rounds of reweighting of the background.
const ROUNDS: usize = 4;

impl Cleaned {
    /// Removes the background and blurs.
    ///
    /// # Errors
    /// The aircraft does not stand out from the background, or too little background is visible.
    pub(super) fn of(patch: &Patch, blur_px: f64) -> Result<Self, NoShift> {
        let step = patch.bin as f64;
        let raw: Vec<f64> = patch
            .luma
            .iter()
            .map(|grey| f64::from(*grey) / STEPS_PER_GREY)
            .collect();
        let mut cleaned = Self {
            width: patch.width,
            height: raw.len() / patch.width.max(1),
            values: raw,
            noise: 0.0,
            centre: (patch.centre_px() - patch.origin_px) / step,
            size: DVec2::new(patch.pixel_box.width_px, patch.pixel_box.height_px) / step,
            origin_px: patch.origin_px,
            bin: patch.bin,
        };
        cleaned.remove_background(blur_px)?;
        Ok(cleaned)
    }

    /// Image pixels per pixel.
    pub(super) fn step_px(&self) -> f64 {
        self.bin as f64
    }

    /// The centre of the box, in the image.
    pub(super) fn centre_px(&self) -> DVec2 {
        self.origin_px + self.centre * self.step_px()
    }

    /// Search radius around the box centre.
    pub(super) fn search(&self, at_least: f64) -> f64 {
        at_least + SEARCH_PART * self.size.x
    }

    pub(super) fn at(&self, column: usize, row: usize) -> f64 {
        self.values[row * self.width + column]
    }

    pub(super) fn values(&self) -> &[f64] {
        &self.values
    }

    fn remove_background(&mut self, blur_px: f64) -> Result<(), NoShift> {
        let half = self.size / 2.0 + GLOW_PX + GLOW_PART * self.size.x;
        let scale = half.x;
        let (width, centre) = (self.width, self.centre);
        let from_centre: Vec<DVec2> = (0..self.height)
            .flat_map(|row| (0..width).map(move |column| (column, row)))
            .map(|(column, row)| DVec2::new(column as f64, row as f64) - centre)
            .collect();
        let ring: Vec<usize> = (0..self.values.len())
            .filter(|index| {
                let away = from_centre[*index].abs();
                (away.cmpgt(half).any()) && away.cmplt(half + RING_PX).all()
            })
            .collect();
        let terms = |index: usize| {
            let DVec2 { x, y } = from_centre[index] / scale;
            [1.0, x, y, x * x, x * y, y * y]
        };
        let shown: Vec<_> = ring
            .iter()
            .map(|index| (terms(*index), self.values[*index], 1.0))
            .collect();
        let fit = robust_fit(&shown, |_, _| 0.0, MIN_NOISE, ROUNDS).ok_or(NoShift::Edge)?;
        let clean: Vec<f64> = (0..self.values.len())
            .map(|index| self.values[index] - dot(&terms(index), &fit.unknowns))
            .collect();
        self.values = blurred(&clean, width, blur_px);
        let of_ring = || ring.iter().map(|index| self.values[*index]);
        self.noise = deviation_from_zero(of_ring()).max(MIN_NOISE);
        let reach = self.size / 2.0 + 1.0;
        let peak = (0..self.values.len())
            .filter(|index| from_centre[*index].abs().cmple(reach).all())
            .fold(0.0_f64, |most, index| most.max(self.values[index].abs()));
        // The robust deviation leaves out clouds and the horizon; the aircraft must also stand out from them.
        let rms = (of_ring().map(|v| v * v).sum::<f64>() / ring.len() as f64).sqrt();
        if peak < MIN_CONTRAST * self.noise || peak < 2.0 * rms {
            return Err(NoShift::Faint);
        }
        Ok(())
    }

    /// Value and its derivatives between the pixels, by Catmull and Rom's cubic; `None` too close to the edge.
    pub(super) fn sample(&self, at: DVec2) -> Option<(f64, DVec2)> {
        // Negative values and NaN become 0, which is too close to the edge; values that are too large become the largest number.
        let (column, row) = (at.x as usize, at.y as usize);
        let is_inside = |at: usize, length: usize| at >= 1 && at < length.saturating_sub(2);
        if !is_inside(column, self.width) || !is_inside(row, self.height) {
            return None;
        }
        let (across, slope_x) = cubic(at.x - column as f64);
        let (down, slope_y) = cubic(at.y - row as f64);
        let (column, row) = (column - 1, row - 1);
        let (mut value, mut dx, mut dy) = (0.0, 0.0, 0.0);
        for j in 0..4 {
            let line = &self.values[(row + j) * self.width + column..][..4];
            let along: f64 = line.iter().zip(across).map(|(v, w)| v * w).sum();
            let slope: f64 = line.iter().zip(slope_x).map(|(v, w)| v * w).sum();
            value += down[j] * along;
            dx += down[j] * slope;
            dy += slope_y[j] * along;
        }
        Some((value, DVec2::new(dx, dy)))
    }
}

/// Weights of the four neighbours for the value and for its derivative (Catmull and Rom, 1974).
fn cubic(t: f64) -> ([f64; 4], [f64; 4]) {
    let (t2, t3) = (t * t, t * t * t);
    let values = [
        -0.5 * t + t2 - 0.5 * t3,
        1.0 - 2.5 * t2 + 1.5 * t3,
        0.5 * t + 2.0 * t2 - 1.5 * t3,
        -0.5 * t2 + 0.5 * t3,
    ];
    let slopes = [
        -0.5 + 2.0 * t - 1.5 * t2,
        -5.0 * t + 4.5 * t2,
        0.5 + 4.0 * t - 4.5 * t2,
        -t + 1.5 * t2,
    ];
    (values, slopes)
}

/// A Gaussian blur; outside, the edge continues.
pub(super) fn blurred(values: &[f64], width: usize, blur_px: f64) -> Vec<f64> {
    let reach = (BLUR_REACH * blur_px) as usize;
    let weight = |k: usize| {
        let away = k as f64 - reach as f64;
        (-away * away / (2.0 * blur_px * blur_px)).exp()
    };
    let weights = || (0..2 * reach + 1).map(weight);
    let sum: f64 = weights().sum();
    let kernel: Vec<f64> = weights().map(|weight| weight / sum).collect();
    let mut lines: Vec<Vec<f64>> = Vec::with_capacity(values.len() / width);
    let mut longer = Vec::with_capacity(width + 2 * reach);
    for line in values.chunks_exact(width) {
        longer.clear();
        longer.extend(repeat_n(line[0], reach));
        longer.extend_from_slice(line);
        longer.extend(repeat_n(line[width - 1], reach));
        let sums = longer.windows(kernel.len());
        lines.push(
            sums.map(|taps| {
                taps.iter()
                    .zip(&kernel)
                    .map(|(value, weight)| weight * value)
                    .sum()
            })
            .collect(),
        );
    }
    let mut both = Vec::with_capacity(values.len());
    for row in 0..lines.len() {
        let start = both.len();
        both.resize(start + width, 0.0);
        for (k, weight) in kernel.iter().enumerate() {
            let line = &lines[(row + k).saturating_sub(reach).min(lines.len() - 1)];
            for (sum, value) in both[start..].iter_mut().zip(line) {
                *sum += weight * value;
            }
        }
    }
    both
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_pixels_there_is_a_value_and_outside_nothing_however_far() {
        let (width, height) = (8, 6);
        let picture = Cleaned {
            width,
            height,
            values: (0..width * height).map(|i| (i % width) as f64).collect(),
            noise: 1.0,
            centre: DVec2::new(4.0, 3.0),
            size: DVec2::ONE,
            origin_px: DVec2::ZERO,
            bin: 1,
        };
        let (value, slope) = picture.sample(DVec2::new(2.25, 2.5)).unwrap();
        assert!((value - 2.25).abs() < 1e-12 && (slope.x - 1.0).abs() < 1e-12);
        assert!(picture.sample(DVec2::new(5.99, 3.99)).is_some());
        for outside in [0.99, 6.0, -1.0, 1e300, f64::INFINITY, f64::NAN] {
            assert_eq!(picture.sample(DVec2::new(outside, 2.5)), None, "{outside}");
        }
    }
}
