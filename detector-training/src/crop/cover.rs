//! Cover: the part of each pixel that the aircraft occupies, so that a background can be painted behind it.
//!
//! Input: an image of an aircraft and one of the same place without it. Output: a cover of 0 to 1 per pixel. Cameras do not move, so
//! another frame of the same video shows the background; where the two differ is the aircraft.

use crate::samples::training_picture::TrainingPicture;
use dataset::tables::pixel_box::PixelBox;

/// Margin around a box for finding the aircraft and for measuring its sky, px.
pub(crate) const MARGIN_PX: f64 = 3.0;
/// A difference below this is the codec's noise, grey levels.
const NOISE_LEVELS: f32 = 2.5;
/// A pixel that differs by this share of the aircraft's strongest tenth is all aircraft; one below the other share is none.
const WHOLE_SHARE: f32 = 0.6;
const NONE_SHARE: f32 = 0.1;

/// Cover within a rectangle; 0 outside.
#[derive(Debug, Clone, PartialEq)]
pub struct Cover {
    left: usize,
    top: usize,
    width: usize,
    height: usize,
    values: Vec<u8>,
}

impl Cover {
    /// The cover of the aircraft in `box`. `behind` is the same place without it and as large as `picture`.
    pub fn of(picture: &TrainingPicture, behind: &TrainingPicture, pixel_box: &PixelBox) -> Self {
        assert_eq!(
            (picture.width_px, picture.height_px),
            (behind.width_px, behind.height_px),
            "both show the same place"
        );
        let [left, top, right, bottom] = pixel_box.edges();
        let span = |low: f64, high: f64, length: usize| {
            let edge = |at: f64| (at.max(0.0) as usize).min(length);
            (
                edge((low - MARGIN_PX).floor()),
                edge((high + MARGIN_PX).ceil() + 1.0),
            )
        };
        let (left, right) = span(left, right, picture.width_px);
        let (top, bottom) = span(top, bottom, picture.height_px);
        let (width, height) = (right - left, bottom - top);
        let mut differences = Vec::with_capacity(width * height);
        for y in top..bottom {
            for x in left..right {
                let at = (y * picture.width_px + x) * 3;
                let by_colour = picture.rgb[at..at + 3].iter().zip(&behind.rgb[at..at + 3]);
                differences.push(by_colour.map(|(&a, &b)| a.abs_diff(b)).max().unwrap_or(0));
            }
        }
        let strongest = strongest_tenth(&differences);
        let none = NOISE_LEVELS.max(NONE_SHARE * strongest);
        let whole = (none + 1.0).max(WHOLE_SHARE * strongest);
        let values = differences
            .into_iter()
            .map(|difference| {
                let share = (f32::from(difference) - none) / (whole - none);
                (share.clamp(0.0, 1.0) * 255.0).round() as u8
            })
            .collect();
        Self {
            left,
            top,
            width,
            height,
            values,
        }
    }

    /// The cover between pixels, 0 to 1.
    pub(crate) fn between(&self, x: f64, y: f64) -> f32 {
        let outside = |at: f64, start: usize, length: usize| {
            at <= start as f64 - 1.0 || at >= (start + length) as f64
        };
        if outside(x, self.left, self.width) || outside(y, self.top, self.height) {
            return 0.0;
        }
        let (column, row) = (x.max(0.0) as usize, y.max(0.0) as usize);
        let (right, down) = ((x - column as f64) as f32, (y - row as f64) as f32);
        let line = |row: usize| {
            let (left, next) = (self.at(column, row), self.at(column + 1, row));
            left + right * (next - left)
        };
        line(row) + down * (line(row + 1) - line(row))
    }

    pub(crate) fn at(&self, x: usize, y: usize) -> f32 {
        let (Some(column), Some(row)) = (x.checked_sub(self.left), y.checked_sub(self.top)) else {
            return 0.0;
        };
        if column < self.width && row < self.height {
            f32::from(self.values[row * self.width + column]) / 255.0
        } else {
            0.0
        }
    }
}

/// The smallest of the largest tenth.
fn strongest_tenth(differences: &[u8]) -> f32 {
    let mut counts = [0_usize; 256];
    for &difference in differences {
        counts[usize::from(difference)] += 1;
    }
    let mut left = differences.len() / 10;
    for (difference, count) in counts.into_iter().enumerate().rev() {
        if count > left {
            return difference as f32;
        }
        left -= count;
    }
    0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::training_picture::sky_with_bar;

    #[test]
    fn the_aircraft_is_covered_and_the_sky_around_it_is_not() {
        let (picture, truth) = sky_with_bar(30.0);
        let cover = Cover::of(&picture, &sky_with_bar(0.0).0, &truth.pixel_box);
        assert_eq!(cover.at(50, 30), 1.0);
        for (x, y) in [(50, 24), (50, 36), (36, 30), (64, 30), (0, 0), (95, 63)] {
            assert_eq!(cover.at(x, y), 0.0, "{x} {y}");
        }
    }

    #[test]
    fn the_noise_of_a_codec_covers_nothing() {
        let (picture, truth) = sky_with_bar(2.0);
        let cover = Cover::of(&picture, &sky_with_bar(0.0).0, &truth.pixel_box);
        assert_eq!(cover.at(50, 30), 0.0);
    }
}
