//! Augmentation: variations of crops that the corpus does not contain, such as texture and edges of clouds behind the aircraft, gradients,
//! structures, blur, noise and tints.
//!
//! Input: a crop, the cover of its aircraft, a random number generator. Output: the varied crop, and whether its aircraft is still visible.
//! The stand-in's skies are smooth and its images free of noise, unlike X-Plane's streaky clouds and real cameras. A backdrop is added
//! where the aircraft is not and, faintly, over the aircraft, like thin cloud.

use std::ops::RangeInclusive;

use rand::{Rng, RngExt};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::crop::cover::MARGIN_PX;
use crate::crop::structures::{Rectangle, random_structure};
use crate::crop::texture::Texture;
use crate::error::{Result, in_range};
use crate::grid::targets::CropTruth;
use crate::network::convolution::standard_normal;
use crate::samples::training_picture::Strength;

/// A grey level (1 of 255).
const LEVEL: f32 = 1.0 / 255.0;
/// Maximum part of a texture over the aircraft, if not the whole.
const MAX_VEIL: f32 = 0.3;
/// A backdrop that hides its aircraft is halved this often before the aircraft counts as hidden.
const HALVINGS: usize = 3;
/// Most structures in a crop.
const MAX_STRUCTURES: usize = 4;
/// Width and wandering of a cloud's edge, px.
const EDGE_WIDTH_PX: RangeInclusive<f32> = 0.7..=6.0;
const EDGE_WANDERS_PX: RangeInclusive<f32> = 1.0..=12.0;
/// Share of noisy crops with independent colour noise; the others have noise in the luma alone, like decoded video.
const COLOUR_NOISE_SHARE: f64 = 0.3;
/// Texture feature size across the stretch, px, and maximum length relative to it.
const FEATURES_PX: RangeInclusive<f32> = 2.0..=60.0;
const MAX_STRETCH: f32 = 15.0;
/// Largest shift of red, green or blue of the paint, and of all colours, grey levels.
const MAX_PAINT_LEVELS: f32 = 80.0;
const MAX_TINT_LEVELS: f32 = 40.0;
/// Largest step of brightness at a cloud's edge, grey levels.
const MAX_CLOUD_EDGE_LEVELS: f32 = 60.0;
/// Largest gradient, grey levels per 100 pixels.
const MAX_GRADIENT_LEVELS: f32 = 20.0;
/// Standard deviation of the Gaussian blur, pixels.
const BLUR_PX: RangeInclusive<f32> = 0.3..=1.0;

/// Augmentation of crops. The simulator's skies are smooth and its aircraft has one paint, so most crops get texture, edges or gradients
/// behind the aircraft. Shares, 0 to 1, are independent of each other; levels are drawn up to the largest value, at most 255.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Augmentation {
    /// Share of crops that keep background, sharpness and noise of the corpus; the other shares are of the rest.
    pub plain_share: f64,
    /// Share of crops with texture: octaves of noise, half of them stretched along the horizon, half in any direction.
    pub texture_share: f64,
    /// Maximum root mean square of the texture, grey levels; drawn as the square of a uniform number, so weak textures are more frequent.
    pub largest_texture_levels: f32,
    /// Share of textures that lie over the aircraft in full, as noise and thin cloud do; of the others up to 30 % shows on it.
    pub texture_over_share: f64,
    /// Share of crops with a different paint, where the aircraft's pixels are known.
    pub paint_share: f64,
    /// Share of crops without landing lights, where the aircraft's pixels are known: none is brighter than the surrounding sky.
    pub unlit_share: f64,
    /// Share of crops with a cloud's edge.
    pub cloud_edge_share: f64,
    /// Share with a gradient of brightness.
    pub gradient_share: f64,
    /// Share with one to four masts, signs or buildings, behind the aircraft or without one.
    pub structure_share: f64,
    /// Share that is blurred.
    pub blur_share: f64,
    /// Share with white noise.
    pub noise_share: f64,
    /// Largest root mean square of the noise, grey levels.
    pub largest_noise_levels: f32,
    /// Share whose colours are shifted.
    pub tint_share: f64,
}

impl Default for Augmentation {
    fn default() -> Self {
        Self {
            plain_share: 0.35,
            texture_share: 0.7,
            largest_texture_levels: 20.0,
            texture_over_share: 0.3,
            paint_share: 0.3,
            unlit_share: 0.15,
            cloud_edge_share: 0.2,
            gradient_share: 0.3,
            structure_share: 0.2,
            blur_share: 0.3,
            noise_share: 0.4,
            largest_noise_levels: 5.0,
            tint_share: 0.3,
        }
    }
}

impl Augmentation {
    /// No augmentation: crops as in the corpus.
    pub fn none() -> Self {
        Self {
            plain_share: 1.0,
            ..Self::default()
        }
    }

    /// Checks that every setting is in its range.
    pub fn check(&self) -> Result<()> {
        let settings = serde_json::to_value(self).unwrap_or_default();
        for (key, value) in settings.as_object().into_iter().flatten() {
            // JSON has no NaN.
            let value = value.as_f64().unwrap_or(f64::NAN);
            let is_share = key.ends_with("_share");
            let most = if is_share { 1.0 } else { f64::from(u8::MAX) };
            in_range(&format!("training.augmentation.{key}"), value, 0.0..=most)?;
        }
        Ok(())
    }

    /// Varies a crop. `cover` holds how much of each pixel is aircraft; empty without one, or if it is not known: then everything
    /// lies over it. An aircraft that cannot be seen afterwards becomes invisible; its box stays. Returns whether the crop is varied.
    pub(crate) fn apply(
        &self,
        pixels: &mut [f32],
        side_px: usize,
        cover: &[f32],
        truth: Option<&mut CropTruth>,
        rng: &mut impl Rng,
    ) -> bool {
        if rng.random_bool(self.plain_share) {
            return false;
        }
        if let Some(truth) = truth.as_deref().filter(|truth| truth.visible)
            && rng.random_bool(self.unlit_share)
        {
            put_out_lights(pixels, side_px, cover, truth);
        }
        if let Some(truth) = truth.as_deref().filter(|truth| truth.visible)
            && rng.random_bool(self.paint_share)
        {
            paint(pixels, side_px, cover, truth, rng);
        }
        let backdrop = self.backdrop(side_px, rng);
        let blur_px = rng
            .random_bool(self.blur_share)
            .then(|| rng.random_range(BLUR_PX));
        let noise = if rng.random_bool(self.noise_share) {
            LEVEL * self.largest_noise_levels * rng.random::<f32>()
        } else {
            0.0
        };
        let colour_noise = rng.random_bool(COLOUR_NOISE_SHARE);
        let tint = if rng.random_bool(self.tint_share) {
            let largest = LEVEL * MAX_TINT_LEVELS;
            std::array::from_fn(|_| largest * rng.random_range(-1.0..=1.0))
        } else {
            [0.0; 3]
        };

        match truth.filter(|truth| truth.visible) {
            Some(truth) if backdrop.changes_anything() => {
                let original = pixels.to_vec();
                let mut strength = 1.0;
                truth.visible = (0..=HALVINGS).any(|_| {
                    pixels.copy_from_slice(&original);
                    backdrop.put_behind(pixels, side_px, cover, strength);
                    strength *= 0.5;
                    Strength::in_crop(pixels, side_px, &truth.pixel_box).stands_out()
                });
            }
            _ => backdrop.put_behind(pixels, side_px, cover, 1.0),
        }
        if let Some(deviation_px) = blur_px {
            blur(pixels, side_px, deviation_px);
        }
        add_noise(pixels, noise, colour_noise, tint, rng);
        true
    }

    fn backdrop(&self, side_px: usize, rng: &mut impl Rng) -> Backdrop {
        let mut light = vec![0.0; side_px * side_px];
        let mut veil = MAX_VEIL * rng.random::<f32>();
        let mut any = false;
        if rng.random_bool(self.texture_share) {
            let levels = self.largest_texture_levels * rng.random::<f32>().powi(2);
            let texture = Texture::random(&FEATURES_PX, MAX_STRETCH, rng);
            for (light, texture) in light.iter_mut().zip(texture.field(side_px, rng)) {
                *light += LEVEL * levels * texture;
            }
            if rng.random_bool(self.texture_over_share) {
                veil = 1.0;
            }
            any = true;
        }
        if rng.random_bool(self.gradient_share) {
            let slope = LEVEL * MAX_GRADIENT_LEVELS / 100.0 * rng.random::<f32>();
            let across = Direction::random(side_px, 0.0, rng);
            for (place, light) in light.iter_mut().enumerate() {
                *light += slope * across.distance_px(place, side_px);
            }
            any = true;
        }
        if rng.random_bool(self.cloud_edge_share) {
            let step = LEVEL * MAX_CLOUD_EDGE_LEVELS * rng.random_range(-1.0_f32..=1.0);
            let across = Direction::random(side_px, 0.4, rng);
            let wanders = rng.random_range(EDGE_WANDERS_PX);
            let width_px = rng.random_range(EDGE_WIDTH_PX);
            let shape = Texture::random(&FEATURES_PX, 2.0, rng).field(side_px, rng);
            for (place, light) in light.iter_mut().enumerate() {
                let inside = across.distance_px(place, side_px) + wanders * shape[place];
                *light += step * (0.5 + inside / width_px).clamp(0.0, 1.0);
            }
            any = true;
        }
        let structures = if rng.random_bool(self.structure_share) {
            (0..rng.random_range(1..=MAX_STRUCTURES))
                .flat_map(|_| random_structure(side_px, rng))
                .collect()
        } else {
            Vec::new()
        };
        // Clouds are nearly grey.
        let colour = std::array::from_fn(|_| rng.random_range(0.85..1.15));
        Backdrop {
            light: if any { light } else { Vec::new() },
            colour,
            veil,
            structures,
        }
    }
}

/// Paints the aircraft in a random colour, unless that would hide it.
fn paint(pixels: &mut [f32], side_px: usize, cover: &[f32], truth: &CropTruth, rng: &mut impl Rng) {
    let largest = LEVEL * MAX_PAINT_LEVELS;
    let shift: [f32; 3] = std::array::from_fn(|_| largest * rng.random_range(-1.0..=1.0));
    let original = pixels.to_vec();
    for (pixel, cover) in pixels.chunks_exact_mut(3).zip(cover) {
        for (value, shift) in pixel.iter_mut().zip(shift) {
            *value = (*value + cover * shift).clamp(0.0, 1.0);
        }
    }
    if !Strength::in_crop(pixels, side_px, &truth.pixel_box).stands_out() {
        pixels.copy_from_slice(&original);
    }
}

/// Darkens the aircraft to the mean of the surrounding sky, unless that would hide it.
fn put_out_lights(pixels: &mut [f32], side_px: usize, cover: &[f32], truth: &CropTruth) {
    let [left, top, right, bottom] = truth.pixel_box.edges();
    let around = |at: usize, low: f64, high: f64| {
        (low - MARGIN_PX..=high + MARGIN_PX).contains(&(at as f64))
    };
    let (mut sky, mut count) = ([0.0_f32; 3], 0.0_f32);
    for (place, pixel) in pixels.chunks_exact(3).enumerate() {
        let near = around(place % side_px, left, right) && around(place / side_px, top, bottom);
        if near && cover.get(place).is_some_and(|&cover| cover == 0.0) {
            for (sum, value) in sky.iter_mut().zip(pixel) {
                *sum += value;
            }
            count += 1.0;
        }
    }
    if count == 0.0 {
        return;
    }
    let original = pixels.to_vec();
    for (pixel, cover) in pixels.chunks_exact_mut(3).zip(cover) {
        for (value, sky) in pixel.iter_mut().zip(sky) {
            *value += cover * ((sky / count).min(*value) - *value);
        }
    }
    if !Strength::in_crop(pixels, side_px, &truth.pixel_box).stands_out() {
        pixels.copy_from_slice(&original);
    }
}

/// A direction across a crop, and where its zero is.
struct Direction {
    right: f32,
    down: f32,
    zero_px: f32,
}

impl Direction {
    /// The zero lies within `off_centre` sides of the middle.
    fn random(side_px: usize, off_centre: f32, rng: &mut impl Rng) -> Self {
        let (down, right) = rng.random_range(0.0..std::f32::consts::TAU).sin_cos();
        let middle = 0.5 * side_px as f32 * (right + down);
        let moved = off_centre * side_px as f32 * rng.random_range(-1.0_f32..=1.0);
        Self {
            right,
            down,
            zero_px: middle + moved,
        }
    }

    fn distance_px(&self, place: usize, side_px: usize) -> f32 {
        let (x, y) = ((place % side_px) as f32, (place / side_px) as f32);
        x * self.right + y * self.down - self.zero_px
    }
}

/// Backdrop behind an aircraft.
struct Backdrop {
    /// Light added to every pixel; may be empty.
    light: Vec<f32>,
    /// Factors of that by colour.
    colour: [f32; 3],
    /// Part over the aircraft.
    veil: f32,
    structures: Vec<Rectangle>,
}

impl Backdrop {
    fn changes_anything(&self) -> bool {
        !self.light.is_empty() || !self.structures.is_empty()
    }

    fn put_behind(&self, pixels: &mut [f32], side_px: usize, cover: &[f32], strength: f32) {
        let cover_at = |place: usize| cover.get(place).copied().unwrap_or(0.0);
        for (place, light) in self.light.iter().enumerate() {
            let seen = 1.0 - (1.0 - self.veil) * cover_at(place);
            for (value, colour) in pixels[3 * place..][..3].iter_mut().zip(self.colour) {
                *value += strength * seen * light * colour;
            }
        }
        for structure in &self.structures {
            for (x, y) in structure.pixels(side_px) {
                let place = y * side_px + x;
                let seen = strength * (1.0 - cover_at(place)) * structure.cover(x, y);
                for (value, colour) in pixels[3 * place..][..3].iter_mut().zip(structure.colour) {
                    *value += seen * (colour - *value);
                }
            }
        }
        for value in pixels {
            *value = value.clamp(0.0, 1.0);
        }
    }
}

/// A Gaussian blur, rows, then columns; the edge repeats.
fn blur(pixels: &mut [f32], side_px: usize, deviation_px: f32) {
    let reach = (3.0 * deviation_px).ceil() as usize;
    let weights: Vec<f32> = (0..=2 * reach)
        .map(|k| (-0.5 * ((k as f32 - reach as f32) / deviation_px).powi(2)).exp())
        .collect();
    let sum: f32 = weights.iter().sum();
    let mut line = vec![0.0; side_px];
    for (along, across) in [(1, side_px), (side_px, 1)] {
        for lane in 0..side_px {
            for colour in 0..3 {
                let place = |at: usize| 3 * (lane * across + at * along) + colour;
                for (at, out) in line.iter_mut().enumerate() {
                    let blurred: f32 = weights
                        .iter()
                        .enumerate()
                        .map(|(k, weight)| {
                            let from = (at + k).saturating_sub(reach).min(side_px - 1);
                            weight * pixels[place(from)]
                        })
                        .sum();
                    *out = blurred / sum;
                }
                for (at, &value) in line.iter().enumerate() {
                    pixels[place(at)] = value;
                }
            }
        }
    }
}

fn add_noise(
    pixels: &mut [f32],
    deviation: f32,
    by_colour: bool,
    tint: [f32; 3],
    rng: &mut impl Rng,
) {
    for pixel in pixels.chunks_exact_mut(3) {
        let mut grain = [0.0; 3];
        if deviation > 0.0 {
            grain = [deviation * standard_normal(rng); 3];
            if by_colour {
                grain[1..].fill_with(|| deviation * standard_normal(rng));
            }
        }
        for ((value, grain), tint) in pixel.iter_mut().zip(grain).zip(tint) {
            *value = (*value + grain + tint).clamp(0.0, 1.0);
        }
    }
}

#[cfg(test)]
mod tests;
