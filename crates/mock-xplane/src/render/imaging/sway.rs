//! Sway: a mast that moves in the wind moves the whole image.
//!
//! The finished image is interpolated between its pixels by polynomials of degree 5 (Lagrange's, through six pixels along each axis).
//! They keep the places of centroids exactly, and at half a pixel 95 % of the contrast of details four pixels long; blur has removed finer
//! ones. Beyond its edges an image is extended by its edge pixels.

use dataset::geometry::imaging::Sway;
use dataset::geometry::imaging::image_motion::SwayMotion;
use glam::DVec2;
use rayon::prelude::*;

/// Source pixels per interpolated pixel, and how many precede it.
const TAPS: usize = 6;
const BEFORE: i64 = 2;
const COLOURS: usize = 3;

/// A camera's sway.
pub(crate) struct SwayingMast(SwayMotion);

impl SwayingMast {
    pub(crate) fn new(sway: &Sway, seed: u64) -> Self {
        Self(SwayMotion::new(sway, seed))
    }

    /// Moves an image by the sway at an instant.
    pub(crate) fn move_picture(&self, rgb: &mut [u8], size: (usize, usize), time_s: f64) {
        displace(rgb, size, self.0.shift_px(time_s));
    }
}

/// Moves an image of this size by a displacement, pixels right and down.
pub(crate) fn displace(rgb: &mut [u8], (width, height): (usize, usize), shift_px: DVec2) {
    let still = rgb.to_vec();
    // The pixel at x was at x - shift.
    let from = -shift_px;
    let whole = from.floor();
    let [across, down] = (from - whole).to_array().map(weights);
    let [first_column, first_row] = whole.to_array().map(|start| start as i64 - BEFORE);
    let stride = width * COLOURS;
    let inside = |place: i64, length: usize| place.clamp(0, length as i64 - 1) as usize;
    rgb.par_chunks_mut(stride).enumerate().for_each_init(
        || vec![0.0_f32; (width + TAPS - 1) * COLOURS],
        |line, (y, row)| {
            let rows: [&[u8]; TAPS] = std::array::from_fn(|tap| {
                let from = inside(y as i64 + first_row + tap as i64, height);
                &still[from * stride..][..stride]
            });
            for (x, pixel) in line.as_chunks_mut::<COLOURS>().0.iter_mut().enumerate() {
                let at = inside(x as i64 + first_column, width) * COLOURS;
                for (colour, value) in pixel.iter_mut().enumerate() {
                    let taps = rows.iter().zip(&down);
                    *value = taps
                        .map(|(row, weight)| f32::from(row[at + colour]) * weight)
                        .sum();
                }
            }
            for (index, value) in row.iter_mut().enumerate() {
                let taps = across.iter().enumerate();
                let sum: f32 = taps
                    .map(|(tap, weight)| line[index + tap * COLOURS] * weight)
                    .sum();
                *value = (sum + 0.5).clamp(0.0, 255.0) as u8;
            }
        },
    );
}

/// Weights of the pixels at -2 to 3 for the place between 0 and 1.
fn weights(place: f64) -> [f32; TAPS] {
    std::array::from_fn(|tap| {
        let node = tap as f64 - BEFORE as f64;
        let others = (0..TAPS)
            .filter(|other| *other != tap)
            .map(|other| other as f64 - BEFORE as f64);
        others
            .map(|other| (place - other) / (node - other))
            .product::<f64>() as f32
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (usize, usize) = (48, 40);

    /// A dark blurred spot before a grey sky.
    fn spot(place: DVec2) -> Vec<u8> {
        let (width, height) = SIZE;
        (0..width * height)
            .flat_map(|i| {
                let at = DVec2::new((i % width) as f64, (i / width) as f64);
                let light = 200.0 - 150.0 * (-0.5 * at.distance_squared(place) / 1.44).exp();
                [light.round() as u8; COLOURS]
            })
            .collect()
    }

    fn centre(rgb: &[u8]) -> DVec2 {
        let mut sum = DVec2::ZERO;
        let mut dark = 0.0;
        for (i, pixel) in rgb.as_chunks::<COLOURS>().0.iter().enumerate() {
            let weight = 200.0 - f64::from(pixel[1]);
            sum += DVec2::new((i % SIZE.0) as f64, (i / SIZE.0) as f64) * weight;
            dark += weight;
        }
        sum / dark
    }

    #[test]
    fn a_picture_moves_by_what_it_is_told_right_and_down() {
        let place = DVec2::new(22.3, 18.8);
        for shift_px in [
            DVec2::new(0.5, -0.5),
            DVec2::new(-3.27, 2.6),
            DVec2::new(5.0, 0.04),
        ] {
            let mut rgb = spot(place);
            displace(&mut rgb, SIZE, shift_px);
            let error_px = centre(&rgb) - place - shift_px;
            assert!(error_px.length() < 0.01, "{error_px} of {shift_px}");
            let drawn = spot(place + shift_px);
            let most = rgb.iter().zip(&drawn).map(|(a, b)| a.abs_diff(*b)).max();
            assert!(most <= Some(3), "{most:?} grey levels");
        }
    }

    #[test]
    fn a_picture_that_stays_keeps_every_byte_and_even_light_stays_even_up_to_the_edges() {
        let still = spot(DVec2::new(22.3, 18.8));
        let mut rgb = still.clone();
        displace(&mut rgb, SIZE, DVec2::ZERO);
        assert!(rgb == still);
        let mut even = vec![77; SIZE.0 * SIZE.1 * COLOURS];
        displace(&mut even, SIZE, DVec2::new(-6.4, 3.3));
        assert!(even.iter().all(|value| *value == 77));
    }
}
