//! Randomly varied crops of images: position, size, mirror, light, and what `augmentation` adds.
//!
//! Input: an image and a random number generator. Output: a square of pixel values 0 to 1 and the position of its aircraft, exact
//! to a fraction of a pixel. Half of the crops are not resampled, because interpolated pixels are smoother than those the detector
//! will see.

pub(crate) mod augmentation;
pub mod cover;
mod structures;
mod texture;

use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

use super::grid::targets::CropTruth;
use super::network::convolution::standard_normal;
use super::samples::training_picture::TrainingPicture;
use augmentation::Augmentation;
use cover::Cover;
use dataset::tables::pixel_box::PixelBox;

/// Share of resampled crops.
const RESAMPLED_SHARE: f64 = 0.5;
/// Share of augmented crops without antialiasing.
const ALIASED_SHARE: f64 = 0.2;
/// Image pixels per pixel in a resampled crop: less than one enlarges.
const SCALE_RANGE: std::ops::Range<f64> = 0.7..1.2;
/// Maximum distance between an aircraft's centre and its crop, px.
const BEYOND_PX: f64 = 4.0;
/// Share of background crops at an edge of the image, where the network sees less context.
const EDGE_SHARE: f64 = 0.15;
/// Share of crops with noise, and its maximum deviation (pixels are 0 to 1).
const NOISY_SHARE: f64 = 0.3;
const MAX_NOISE: f32 = 1.5 / 255.0;

/// Crop position.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Placement {
    /// Image coordinates of the centre of the crop's top-left pixel.
    pub left_px: f64,
    /// Image coordinates of the centre of the crop's top-left pixel.
    pub top_px: f64,
    /// Image pixels for one pixel of the crop.
    pub scale: f64,
    /// True if the crop is mirrored left to right.
    pub mirrored: bool,
}

impl Placement {
    /// A random position in an image; if `near` an aircraft, one with the aircraft's centre in the crop (occasionally just
    /// outside).
    pub fn random(
        picture: &TrainingPicture,
        near: Option<&PixelBox>,
        side_px: usize,
        rng: &mut impl Rng,
    ) -> Self {
        let resampled = rng.random_bool(RESAMPLED_SHARE);
        let smallest = picture.width_px.min(picture.height_px) as f64 - 1.0;
        let side = side_px as f64 - 1.0;
        let scale = if resampled {
            rng.random_range(SCALE_RANGE)
        } else {
            1.0
        }
        .min(smallest / side);
        let mut place = |center: Option<f64>, length: usize| {
            let most = (length as f64 - 1.0 - scale * side).max(0.0);
            let (low, high) = center.map_or((0.0, most), |center| {
                (
                    (center - scale * side - BEYOND_PX).clamp(0.0, most),
                    (center + BEYOND_PX).clamp(0.0, most),
                )
            });
            let part = match near {
                None if rng.random_bool(EDGE_SHARE) => f64::from(u8::from(rng.random_bool(0.5))),
                _ => rng.random::<f64>(),
            };
            let at = low + (high - low) * part;
            if resampled { at } else { at.round() }
        };
        Self {
            left_px: place(near.map(|aircraft| aircraft.cx_px), picture.width_px),
            top_px: place(near.map(|aircraft| aircraft.cy_px), picture.height_px),
            scale,
            mirrored: rng.random_bool(0.5),
        }
    }

    /// A box of the image in the crop.
    pub(crate) fn box_in_crop(&self, pixel_box: &PixelBox, side_px: usize) -> PixelBox {
        let right = (pixel_box.cx_px - self.left_px) / self.scale;
        PixelBox {
            cx_px: if self.mirrored {
                side_px as f64 - 1.0 - right
            } else {
                right
            },
            cy_px: (pixel_box.cy_px - self.top_px) / self.scale,
            width_px: pixel_box.width_px / self.scale,
            height_px: pixel_box.height_px / self.scale,
        }
    }

    /// The crop's pixels: interpolated bilinearly, or the nearest of the image if `aliased`.
    pub fn cut(&self, picture: &TrainingPicture, side_px: usize, aliased: bool) -> Vec<f32> {
        let mut out = Vec::with_capacity(side_px * side_px * 3);
        let sample = |start: f64, index: usize, length: usize| {
            let at = (start + self.scale * index as f64).clamp(0.0, length as f64 - 1.0);
            let at = if aliased { at.round() } else { at };
            let low = (at.floor() as usize).min(length - 1);
            (low, (low + 1).min(length - 1), (at - low as f64) as f32)
        };
        let columns: Vec<_> = (0..side_px)
            .map(|x| if self.mirrored { side_px - 1 - x } else { x })
            .map(|x| sample(self.left_px, x, picture.width_px))
            .collect();
        for y in 0..side_px {
            let (y0, y1, down) = sample(self.top_px, y, picture.height_px);
            let [upper, lower] =
                [y0, y1].map(|y| &picture.rgb[y * picture.width_px * 3..][..picture.width_px * 3]);
            for &(x0, x1, right) in &columns {
                for colour in 0..3 {
                    let value = |line: &[u8], x: usize| f32::from(line[3 * x + colour]);
                    let top = value(upper, x0) + right * (value(upper, x1) - value(upper, x0));
                    let bottom = value(lower, x0) + right * (value(lower, x1) - value(lower, x0));
                    out.push((top + down * (bottom - top)) / 255.0);
                }
            }
        }
        out
    }

    /// The cover of the crop's pixels, interpolated bilinearly.
    pub(crate) fn cut_cover(&self, cover: &Cover, side_px: usize) -> Vec<f32> {
        let mut out = Vec::with_capacity(side_px * side_px);
        for y in 0..side_px {
            let down = self.top_px + self.scale * y as f64;
            for x in 0..side_px {
                let x = if self.mirrored { side_px - 1 - x } else { x };
                out.push(cover.between(self.left_px + self.scale * x as f64, down));
            }
        }
        out
    }
}

/// A random crop, its aircraft, and whether it was varied beyond light.
pub(crate) fn random_crop(
    picture: &TrainingPicture,
    placement: &Placement,
    side_px: usize,
    augmentation: &Augmentation,
    rng: &mut impl Rng,
) -> (Vec<f32>, Option<CropTruth>, bool) {
    let aliased = rng.random_bool(ALIASED_SHARE) && augmentation.plain_share < 1.0;
    let mut pixels = placement.cut(picture, side_px, aliased);
    let mut truth = picture.aircraft.map(|truth| CropTruth {
        pixel_box: placement.box_in_crop(&truth.pixel_box, side_px),
        ..truth
    });
    let cover = picture
        .cover
        .as_ref()
        .map_or_else(Vec::new, |cover| placement.cut_cover(cover, side_px));
    vary_light(&mut pixels, rng);
    let varied = augmentation.apply(&mut pixels, side_px, &cover, truth.as_mut(), rng);
    (pixels, truth, varied)
}

/// Contrast, brightness, tint and noise.
fn vary_light(pixels: &mut [f32], rng: &mut impl Rng) {
    let contrast: f32 = rng.random_range(0.7..1.25);
    let brightness: f32 = rng.random_range(-0.08..0.08);
    let tint: [f32; 3] = std::array::from_fn(|_| rng.random_range(0.94..1.06));
    let mean = pixels.iter().sum::<f32>() / pixels.len().max(1) as f32;
    let noise = if rng.random_bool(NOISY_SHARE) {
        MAX_NOISE * rng.random::<f32>()
    } else {
        0.0
    };
    for pixel in pixels.chunks_exact_mut(3) {
        // One number for the three colours: a decoded video has its noise in the luma.
        let grain = if noise > 0.0 {
            noise * standard_normal(rng)
        } else {
            0.0
        };
        for (value, tint) in pixel.iter_mut().zip(tint) {
            *value =
                ((mean + contrast * (*value - mean) + brightness) * tint + grain).clamp(0.0, 1.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::training_picture::sky_with_bar;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    /// Centre and width of pixels darker than the sky, by column sums.
    fn measured(pixels: &[f32], side: usize) -> (f64, f64) {
        let mut sums = [0.0; 3];
        for y in 0..side {
            let sky = f64::from(pixels[(y * side) * 3].max(pixels[(y * side + side - 1) * 3]));
            for x in 0..side {
                let darker = (sky - f64::from(pixels[(y * side + x) * 3])).max(0.0);
                let weight = if darker > 0.005 { darker } else { 0.0 };
                sums = [
                    sums[0] + weight,
                    sums[1] + weight * x as f64,
                    sums[2] + weight * (x * x) as f64,
                ];
            }
        }
        let center = sums[1] / sums[0];
        (
            center,
            (12.0 * (sums[2] / sums[0] - center * center)).sqrt(),
        )
    }

    #[test]
    fn pixels_and_box_stay_together_to_a_tenth_of_a_pixel() {
        let (picture, truth) = sky_with_bar(30.0);
        for (left_px, scale, mirrored) in [
            (20.0, 1.0, false),
            (20.0, 1.0, true),
            (31.37, 0.71, false),
            (24.6, 0.9, true),
        ] {
            let placement = Placement {
                left_px,
                top_px: 10.0,
                scale,
                mirrored,
            };
            let pixels = placement.cut(&picture, 48, false);
            let (center, width) = measured(&pixels, 48);
            let expected = placement.box_in_crop(&truth.pixel_box, 48);
            assert!(
                (center - expected.cx_px).abs() < 0.1,
                "{center} {expected:?}"
            );
            assert!(
                (width - expected.width_px).abs() < 0.5,
                "{width} {expected:?}"
            );
        }
    }

    #[test]
    fn an_aliased_crop_holds_values_of_the_picture_alone() {
        let (picture, truth) = sky_with_bar(30.0);
        let placement = Placement {
            left_px: 31.37,
            top_px: 10.2,
            scale: 0.71,
            mirrored: true,
        };
        let levels = |aliased: bool| {
            let pixels = placement.cut(&picture, 48, aliased);
            let (center, _) = measured(&pixels, 48);
            let expected = placement.box_in_crop(&truth.pixel_box, 48).cx_px;
            assert!((center - expected).abs() < 0.5, "{center} {expected}");
            let of_picture = |value: f32| {
                let level = 255.0 * value;
                (level - level.round()).abs() < 1e-3
            };
            pixels.into_iter().all(of_picture)
        };
        assert!(levels(true));
        assert!(!levels(false), "interpolation makes values in between");
    }

    #[test]
    fn a_background_crop_lies_at_an_edge_of_its_picture_now_and_then() {
        let (mut picture, _) = sky_with_bar(30.0);
        picture.aircraft = None;
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let bottom = (0..1000)
            .map(|_| Placement::random(&picture, None, 24, &mut rng))
            .filter(|place| place.top_px + place.scale * 23.0 > picture.height_px as f64 - 1.5)
            .count();
        assert!((50..150).contains(&bottom), "{bottom}");
    }

    #[test]
    fn a_random_crop_stays_in_the_picture_and_holds_the_aircraft() {
        let (picture, truth) = sky_with_bar(30.0);
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut centers_inside = 0;
        for _ in 0..400 {
            let placement = Placement::random(&picture, Some(&truth.pixel_box), 48, &mut rng);
            let end = placement.left_px + placement.scale * 47.0;
            assert!(
                placement.left_px >= 0.0 && end <= 95.0 + 1e-9,
                "{placement:?}"
            );
            let inside = placement.box_in_crop(&truth.pixel_box, 48);
            assert!((-8.0..56.0).contains(&inside.cx_px), "{inside:?}");
            centers_inside += usize::from(
                (0.0..48.0).contains(&inside.cx_px) && (0.0..48.0).contains(&inside.cy_px),
            );
        }
        assert!(centers_inside > 320, "{centers_inside}");
    }
}
