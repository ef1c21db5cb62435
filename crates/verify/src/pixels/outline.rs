//! Outlines of objects in boxes: the outermost columns and rows on each side.
//!
//! Light, paint and lamps move the centre of brightness by metres along the aircraft. They leave its outline alone as long as all of it
//! stands out, which the size of the outline shows.

use glam::DVec2;

use super::sight::above_noise;
use dataset::numbers::spread::median;

/// Error of the object's middle, pixels.
pub(super) const ERROR_PX: f64 = 0.3;
/// In a noiseless image the outline's edge stands out by this, grey levels, or by a part of the contrast.
const MIN_OF_SMOOTH_GREY: f64 = 5.0;
const PART_OF_CONTRAST: f64 = 0.25;
/// Paint does not stand out from the sky by more than this, grey levels, and not by this many times the median of what stands out: these
/// are lamps, and what they outshine is not seen.
const LAMPS_GREY: f64 = 120.0;
const LAMPS_MEDIANS: f64 = 3.0;

/// The bright or dark part, relative to the box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Outline {
    /// Middle relative to the centre of the box, pixels.
    pub(super) offset_px: DVec2,
    /// Width and height, pixels.
    pub(super) size_px: DVec2,
}

impl Outline {
    /// The outline in residuals of pixels, which come row by row with their places relative to the centre of the box; `None` if no pixel
    /// stands out, or lamps do. `inside`: the residuals in the box, whose contrast is known.
    pub(super) fn of(
        residuals: impl Iterator<Item = (DVec2, f64)>,
        inside: &[f64],
        contrast: f64,
        noise: f64,
    ) -> Option<Self> {
        if contrast >= LAMPS_GREY {
            return None;
        }
        let threshold = above_noise(noise).max(MIN_OF_SMOOTH_GREY.min(PART_OF_CONTRAST * contrast));
        let mut standing_out: Vec<f64> = inside
            .iter()
            .copied()
            .filter(|residual| *residual > threshold)
            .collect();
        if standing_out.is_empty() || contrast >= LAMPS_MEDIANS * median(&mut standing_out) {
            return None;
        }
        let (mut columns, mut rows) = (Profile::default(), Profile::default());
        for (place, residual) in residuals {
            columns.add(place.x, residual);
            rows.add(place.y, residual);
        }
        let (columns, rows) = (columns.edges(threshold)?, rows.edges(threshold)?);
        Some(Self {
            offset_px: DVec2::new(columns[0] + columns[1], rows[0] + rows[1]) / 2.0,
            size_px: DVec2::new(columns[1] - columns[0], rows[1] - rows[0]),
        })
    }
}

/// The largest residual of each column, or of each row.
#[derive(Default)]
struct Profile {
    /// Place of the first one.
    first: Option<f64>,
    largest: Vec<f64>,
}

impl Profile {
    fn add(&mut self, place: f64, residual: f64) {
        let first = *self.first.get_or_insert(place);
        let index = (place - first).round().max(0.0) as usize;
        if index >= self.largest.len() {
            self.largest.resize(index + 1, 0.0);
        }
        self.largest[index] = self.largest[index].max(residual);
    }

    /// Places where the profile rises above the threshold for the first time and falls below it for the last time, between pixels by
    /// linear interpolation.
    fn edges(&self, threshold: f64) -> Option<[f64; 2]> {
        let above = |residual: &f64| *residual > threshold;
        let first = self.largest.iter().position(above)?;
        let last = self.largest.iter().rposition(above)?;
        let beyond = |inside: usize, outside: Option<usize>| {
            let outside = outside.and_then(|index| self.largest.get(index));
            outside.map_or(0.0, |outside| {
                (self.largest[inside] - threshold) / (self.largest[inside] - outside)
            })
        };
        let start = self.first?;
        Some([
            start + first as f64 - beyond(first, first.checked_sub(1)),
            start + last as f64 + beyond(last, Some(last + 1)),
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Residuals around a box of 40 x 20 pixels.
    fn residuals(of: impl Fn(DVec2) -> f64) -> Vec<(DVec2, f64)> {
        let places = (-20..=20).flat_map(|y| (-30..=30).map(move |x| (x, y)));
        places
            .map(|(x, y)| DVec2::new(f64::from(x) + 0.25, f64::from(y)))
            .map(|place| (place, of(place)))
            .collect()
    }

    fn bar(place: DVec2, middle: DVec2) -> f64 {
        let inside = |away: f64, half: f64| (half + 0.5 - away.abs()).clamp(0.0, 1.0);
        let away = place - middle;
        20.0 * inside(away.x, 20.0) * inside(away.y, 10.0)
    }

    #[test]
    fn the_middle_of_the_outline_is_found_whatever_part_of_it_is_bright() {
        let middle = DVec2::new(1.3, -0.6);
        for bright in [0.0, 30.0] {
            let all = residuals(|place| {
                let lit = if place.x > 10.0 { bright } else { 0.0 };
                let grey = bar(place, middle);
                grey + if grey > 0.0 { lit } else { 0.0 }
            });
            let inside: Vec<f64> = all.iter().map(|(_, residual)| *residual).collect();
            let outline = Outline::of(all.into_iter(), &inside, 20.0 + bright, 1.0).unwrap();
            let off_px = (outline.offset_px - middle).length();
            // Half a pixel on the sharp edges of this bar; its brightness is off by pixels.
            assert!(off_px < 0.6, "{outline:?}");
            assert!((outline.size_px - DVec2::new(40.0, 20.0)).length() < 3.0);
        }
    }

    #[test]
    fn lamps_have_no_outline_of_the_aircraft() {
        let outline = |of: fn(DVec2) -> f64, contrast: f64| {
            let all = residuals(of);
            let inside: Vec<f64> = all.iter().map(|(_, residual)| *residual).collect();
            Outline::of(all.into_iter(), &inside, contrast, 1.0)
        };
        let aircraft = |place: DVec2| bar(place, DVec2::ZERO);
        assert!(outline(aircraft, 20.0).is_some());
        assert_eq!(outline(aircraft, 80.0), None);
        assert_eq!(outline(aircraft, 180.0), None);
        assert_eq!(outline(|_| 1.0, 9.0), None);
    }
}
