//! The mean of the first images that show one direction of a fixed camera, from just above the horizon down.
//!
//! The mean has a fifth of the noise of an image, and neither rain nor waves; the aircraft covers few pixels, and moves.

use std::io::Cursor;

use dataset::geometry::camera::Camera;
use dataset::video::Luma;
use image::{GrayImage, ImageFormat, ImageReader};

use crate::fit::NOISE_LEVELS;
use crate::ground::{Ground, Motion};
use crate::watched::Measured;

/// Number of averaged images in a complete background.
pub const IMAGES: u32 = 24;
/// Noise by the rounding of a mean, grey levels.
const ROUNDING_LEVELS: f64 = 0.3;
/// Images that are off by more are left out, pixels: the rest of a shake blurs the mean by less than the images are blurred.
pub const MAX_OFF_PX: f64 = 0.5;

/// A background.
#[derive(Debug, Clone, PartialEq)]
pub struct Background {
    /// Columns.
    pub width_px: usize,
    /// First row in the camera's image.
    pub top_px: usize,
    /// Grey levels, row after row.
    pub levels: Vec<u8>,
    /// Number of averaged images.
    pub images: u32,
    /// Mean turn of these images from the first image of the flight.
    pub turn: Motion,
}

impl Background {
    /// The levels as a PNG.
    pub fn png(&self) -> Vec<u8> {
        png_of(self.levels.clone(), self.width_px)
    }

    /// A background whose levels are a PNG; `None` unless it has the size of the camera's image below this row.
    pub fn of_png(png: &[u8], top_px: usize, images: u32, camera: &Camera) -> Option<Self> {
        let rows = camera.height_px.checked_sub(u32::try_from(top_px).ok()?)?;
        Some(Self {
            width_px: camera.width_px as usize,
            top_px,
            levels: levels_of_png(png, |size_px| size_px == (camera.width_px, rows))?,
            images,
            turn: Motion::default(),
        })
    }

    /// Pixel noise, grey levels.
    pub(crate) fn noise_levels(&self) -> f64 {
        let mean = NOISE_LEVELS / f64::from(self.images.max(1)).sqrt();
        mean.hypot(ROUNDING_LEVELS)
    }

    /// Levels of a whole image, which continues above the background as its first row.
    pub(crate) fn whole(&self) -> Vec<u8> {
        let first = self.levels.iter().take(self.width_px);
        let above = first.cycle().take(self.top_px * self.width_px);
        above.chain(&self.levels).copied().collect()
    }
}

/// Grey levels, row after row, as a PNG of this width.
pub fn png_of(levels: Vec<u8>, width_px: usize) -> Vec<u8> {
    let rows = levels.len() / width_px.max(1);
    let image = GrayImage::from_raw(width_px as u32, rows as u32, levels);
    let mut png = Cursor::new(Vec::new());
    let image = image.expect("as many levels as pixels");
    image
        .write_to(&mut png, ImageFormat::Png)
        .expect("memory takes any image");
    png.into_inner()
}

/// Grey levels of a PNG with an allowed width and height.
pub fn levels_of_png(png: &[u8], is_allowed: impl Fn((u32, u32)) -> bool) -> Option<Vec<u8>> {
    let reader = || ImageReader::with_format(Cursor::new(png), ImageFormat::Png);
    // Before anything is decoded.
    let is_allowed = is_allowed(reader().into_dimensions().ok()?);
    let image = is_allowed.then(|| reader().decode().ok()).flatten()?;
    Some(image.into_luma8().into_raw())
}

/// Collects the images of a background.
#[derive(Debug, Clone)]
pub struct Collected {
    ground: Ground,
    sums: Vec<u16>,
    images: u32,
    turns: Motion,
    /// True while no image has shown the ground.
    is_hidden: bool,
}

impl Collected {
    /// No image yet.
    pub fn new(camera: &Camera) -> Self {
        Self {
            ground: Ground::of(camera),
            sums: Vec::new(),
            images: 0,
            turns: Motion::default(),
            is_hidden: false,
        }
    }

    /// Takes the next image with its turn; `hidden`: the ground has not been seen yet. True if it is part of the background.
    pub fn take(&mut self, image: &Luma<'_>, turn: Option<Measured>, hidden: bool) -> bool {
        let shows = match turn {
            Some(measured) => measured.turn.shift_px.length() <= MAX_OFF_PX,
            None => hidden,
        };
        let Ground { camera, top, .. } = self.ground;
        let size_px = [camera.width_px as usize, camera.height_px as usize];
        let has_ground = [image.width_px, image.height_px] == size_px && top < image.height_px;
        if self.is_hidden && turn.is_some() {
            // Images without the ground are worth nothing once there is one with it.
            *self = Self::new(&camera);
        }
        if self.images == IMAGES || !shows || !has_ground {
            return false;
        }
        self.is_hidden = hidden;
        self.sums
            .resize((image.height_px - top) * image.width_px, 0);
        let rows = self.sums.chunks_exact_mut(image.width_px);
        for (sums, row) in rows.zip(top..) {
            for (sum, level) in sums.iter_mut().zip(image.row(row)) {
                *sum += u16::from(*level);
            }
        }
        self.images += 1;
        self.turns = self
            .turns
            .after(turn.map_or(Motion::default(), |of| of.turn));
        true
    }

    /// The mean of the images up to now; `None` without any.
    pub fn background(&self) -> Option<Background> {
        let images = u16::try_from(self.images)
            .ok()
            .filter(|images| *images > 0)?;
        let levels = self.sums.iter().map(|sum| (sum + images / 2) / images);
        let part = f64::from(images).recip();
        Some(Background {
            width_px: self.ground.camera.width_px as usize,
            top_px: self.ground.top,
            levels: levels.map(|level| level as u8).collect(),
            images: self.images,
            turn: Motion {
                shift_px: self.turns.shift_px * part,
                roll_rad: self.turns.roll_rad * part,
                ..Motion::default()
            },
        })
    }

    /// True if no further image is taken.
    pub fn is_complete(&self) -> bool {
        self.images == IMAGES
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;
    use crate::watched::tests::{HEIGHT, WIDTH, camera};

    #[test]
    fn a_background_is_the_mean_of_images_from_one_direction_and_comes_back_from_its_png() {
        let camera = camera();
        let mut collected = Collected::new(&camera);
        let mut take = |level: u8, turn_px: Option<f64>, hidden: bool| {
            let levels = vec![level; WIDTH * HEIGHT];
            let turn = turn_px.map(|x_px| Measured {
                turn: Motion {
                    shift_px: DVec2::new(x_px, 0.0),
                    ..Motion::default()
                },
                sd_px: 0.02,
            });
            let is_taken = collected.take(&Luma::of(&levels, WIDTH), turn, hidden);
            (is_taken, collected.is_complete())
        };
        for number in 1..=IMAGES {
            assert!(!take(200, Some(2.0), false).0, "turned");
            assert!(!take(200, None, false).0, "not measured");
            let level = if number % 2 == 0 { 100 } else { 110 };
            assert_eq!(take(level, Some(0.2), false), (true, number == IMAGES));
        }
        assert!(!take(200, Some(0.0), false).0, "complete");
        let background = collected.background().unwrap();
        assert!(background.levels.iter().all(|level| *level == 105));
        assert!((background.turn.shift_px.x - 0.2).abs() < 1e-9);
        let mut hidden = Collected::new(&camera);
        assert_eq!(hidden.background(), None);
        let levels = vec![90; WIDTH * HEIGHT];
        assert!(hidden.take(&Luma::of(&levels, WIDTH), None, true));
        assert_eq!(hidden.background().map(|of| of.levels[0]), Some(90));
        let other_size = Luma::of(&levels, WIDTH / 2);
        assert!(!hidden.take(&other_size, None, true));
        let mut sky = camera;
        sky.principal_px.y += 2.0 * HEIGHT as f64;
        assert!(!Collected::new(&sky).take(&Luma::of(&levels, WIDTH), None, true));
        let (png, top_px) = (background.png(), background.top_px);
        let back = Background::of_png(&png, top_px, IMAGES, &camera).unwrap();
        assert_eq!(back.levels, background.levels);
        assert_eq!(Background::of_png(&png, top_px + 1, IMAGES, &camera), None);
        let torn = &png[..png.len() / 2];
        assert_eq!(Background::of_png(torn, top_px, IMAGES, &camera), None);
    }
}
