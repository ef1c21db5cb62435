//! Measures how a fixed camera turns during a flight, from the ground that its images show.
//!
//! Input: the brightness of each image, in order, and the camera, whose calibration serves as a mask and for its focal length only. Output:
//! the turn of each image from the first one, with its standard deviation, or none where the ground shows too little.
//!
//! Some hundred tiles with the most structure below the horizon are compared with a reference image, each with its own gain and offset.
//! Their displacements decide about one rotation (Gauss and Newton; Lucas and Kanade, "An iterative image registration technique", 1981).
//! Tiles that contradict the others count less (Cauchy's weights), so that vehicles, waves and clouds drop out. If the turn of the image
//! before does not lead to a fit, shrunk images are searched first ([`coarse`]). When the light has changed so much that few tiles still
//! resemble the reference, the image becomes the new reference, at its measured turn.

mod coarse;
mod tile;

use dataset::geometry::camera::Camera;
use dataset::video::Luma;
use glam::DVec2;

use crate::registration::Normal;
use coarse::Coarse;
use tile::{Tile, tiles_of};

/// Greatest elevation of stationary objects above the horizon, radians.
const ABOVE_HORIZON_RAD: f64 = 0.006;
/// Tiles that must agree.
const MIN_TILES: usize = 8;
/// A tile further from the common turn, in its standard deviations, counts less than half.
const TOLERATED: f64 = 3.0;
/// The reference is replaced when the agreeing tiles have less than this part of the usual information about one axis. With less than half
/// of that they do not show the direction: in haze, the rest of the ground may look alike wherever the camera looks.
const FADED: f64 = 0.6;
/// Minimum standard deviation, px: interpolation and compression. A step below it ends the iteration.
const MIN_SD_PX: f64 = 0.02;
/// A turn with a larger standard deviation counts as not measured, pixels.
const MAX_SD_PX: f64 = 1.0;
/// Usual range of rolls, as the shift at half of the width, pixels: decides only where tiles do not.
const ROLL_SD_PX: f64 = 20.0;
/// Minimum pixel noise, grey levels.
pub(super) const NOISE_LEVELS: f64 = 1.5;
/// Steps of the iteration: one without an end does not fit.
const MAX_STEPS: u32 = 12;
/// A shift found in shrunk images is right to this, pixels.
const COARSE_PX: f64 = 4.0;
/// After failures, at most this many images pass without a search.
const MAX_PAUSE: u32 = 64;

/// Camera rotation, as image motion.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Turn {
    /// Shift at the image's centre, right and down, pixels.
    pub(crate) shift_px: DVec2,
    /// Rotation about the centre, clockwise, radians.
    pub(crate) roll_rad: f64,
}

/// A turn with the standard deviation of the shift, the larger one of both axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Measured {
    pub(crate) turn: Turn,
    pub(crate) sd_px: f64,
}

impl Turn {
    fn to_array(self, camera: &Camera) -> [f64; 3] {
        let half_px = f64::from(camera.width_px) / 2.0;
        [self.shift_px.x, self.shift_px.y, self.roll_rad * half_px]
    }

    fn from_array([x, y, roll_px]: [f64; 3], camera: &Camera) -> Self {
        Self {
            shift_px: DVec2::new(x, y),
            roll_rad: roll_px / (f64::from(camera.width_px) / 2.0),
        }
    }
}

/// Measures a view's consecutive images.
pub(crate) struct CameraMotion {
    camera: Camera,
    top: usize,
    reference: Option<Reference>,
    last: Turn,
    /// Images to pass without a search, and how many after the next failure.
    pause: u32,
    next_pause: u32,
}

struct Reference {
    turn: Turn,
    sd_px: f64,
    tiles: Vec<Tile>,
    coarse: Coarse,
    /// Largest information of agreeing tiles up to now, about both axes.
    usual: DVec2,
}

struct Fit {
    turn: Turn,
    sd_px: f64,
    /// Information of agreeing tiles about both axes.
    tells: DVec2,
}

impl CameraMotion {
    pub(crate) fn new(camera: &Camera) -> Self {
        let up = camera.ecef_from_camera.transpose() * camera.center_ecef_m.normalize_or_zero();
        let horizon_px = camera.principal_px.y - camera.focal_px * up.z / up.y;
        let top_px = horizon_px - ABOVE_HORIZON_RAD * camera.focal_px;
        Self {
            camera: *camera,
            // NaN and values below 0 become 0.
            top: top_px as usize,
            reference: None,
            last: Turn::default(),
            pause: 0,
            next_pause: 1,
        }
    }

    /// The turn of the next image from the first one.
    pub(crate) fn next(&mut self, image: &Luma<'_>) -> Option<Measured> {
        let size_px = [
            self.camera.width_px as usize,
            self.camera.height_px as usize,
        ];
        if [image.width_px, image.height_px] != size_px {
            return None;
        }
        if self.reference.is_none() {
            if self.pauses() {
                return None;
            }
            let begun = self.refer(image, Turn::default(), 0.0);
            self.searched(begun);
            return begun.then_some(Measured {
                turn: Turn::default(),
                sd_px: MIN_SD_PX,
            });
        }
        let fit = self.fit(image)?;
        let reference = self.reference.as_mut()?;
        reference.usual = reference.usual.max(fit.tells);
        let faded = reference.is_faded_in(&fit);
        let turn = after(fit.turn, reference.turn);
        let sd_px = fit.sd_px.hypot(reference.sd_px);
        self.last = turn;
        if faded {
            // A worse one is not taken.
            self.refer(image, turn, sd_px);
        }
        (sd_px <= MAX_SD_PX).then_some(Measured { turn, sd_px })
    }

    /// Makes an image the reference if it has enough tiles.
    fn refer(&mut self, image: &Luma<'_>, turn: Turn, sd_px: f64) -> bool {
        let tiles = tiles_of(image, self.top, &self.camera);
        let enough = tiles.len() >= MIN_TILES;
        if enough {
            self.reference = Some(Reference {
                turn,
                sd_px,
                coarse: Coarse::of(image, self.top),
                usual: tiles.iter().map(|tile| tile.tells).sum::<DVec2>() / 2.0,
                tiles,
            });
        }
        enough
    }

    fn fit(&mut self, image: &Luma<'_>) -> Option<Fit> {
        let camera = self.camera;
        let reference = self.reference.as_ref()?;
        let begin = before(self.last, reference.turn);
        let near = reference.fit(image, &camera, begin);
        let is_sure = |fit: &Fit| !reference.is_faded_in(fit);
        if near.as_ref().is_some_and(is_sure) {
            self.searched(true);
            return near;
        }
        if self.pauses() {
            return None;
        }
        let reference = self.reference.as_ref()?;
        let moved = reference
            .coarse
            .shift_to(&Coarse::of(image, self.top), begin.shift_px);
        let is_near =
            |fit: &Fit| moved.is_some_and(|moved| moved.distance(fit.turn.shift_px) <= COARSE_PX);
        let share = |fit: &Fit| reference.share(fit);
        let far = moved.and_then(|shift_px| {
            let roll_rad = begin.roll_rad;
            reference.fit(image, &camera, Turn { shift_px, roll_rad })
        });
        let fits = [near, far].into_iter().flatten().filter(is_near);
        let fit = fits.max_by(|a, b| share(a).total_cmp(&share(b)));
        self.searched(fit.is_some());
        fit
    }

    /// True while searches are left out after failures.
    fn pauses(&mut self) -> bool {
        let pauses = self.pause > 0;
        self.pause = self.pause.saturating_sub(1);
        pauses
    }

    fn searched(&mut self, found: bool) {
        if found {
            (self.pause, self.next_pause) = (0, 1);
        } else {
            self.pause = self.next_pause;
            self.next_pause = (2 * self.next_pause).min(MAX_PAUSE);
        }
    }
}

/// Turns are small: they add up.
fn after(then: Turn, first: Turn) -> Turn {
    Turn {
        shift_px: then.shift_px + first.shift_px,
        roll_rad: then.roll_rad + first.roll_rad,
    }
}

fn before(whole: Turn, first: Turn) -> Turn {
    Turn {
        shift_px: whole.shift_px - first.shift_px,
        roll_rad: whole.roll_rad - first.roll_rad,
    }
}

impl Reference {
    /// Information in the agreeing tiles, as a part of the usual, about the axis that lost more.
    fn share(&self, fit: &Fit) -> f64 {
        (fit.tells / self.usual.max(DVec2::splat(1e-9))).min_element()
    }

    /// True if too few tiles agree.
    fn is_faded_in(&self, fit: &Fit) -> bool {
        self.share(fit) < FADED
    }

    /// Refines a turn; `None` if the tiles do not agree there.
    fn fit(&self, image: &Luma<'_>, camera: &Camera, begin: Turn) -> Option<Fit> {
        let mut numbers = begin.to_array(camera);
        for _ in 0..MAX_STEPS {
            let turn = Turn::from_array(numbers, camera);
            let matrix = camera.turn(turn.shift_px, turn.roll_rad);
            let told: Vec<_> = (self.tiles.iter())
                .filter_map(|tile| {
                    let there = camera.pixel_of(matrix * tile.direction);
                    Some((tile, tile.told(image, there - tile.middle_px)?))
                })
                .collect();
            if told.len() < MIN_TILES {
                return None;
            }
            let mut misfits = vec![0.0; told.len()];
            let mut step = [0.0; 3];
            let mut sd_px = f64::INFINITY;
            for _ in 0..10 {
                let mut equations = Normal::<3>::new();
                equations.add(&[0.0, 0.0, 1.0], -numbers[2], ROLL_SD_PX.powi(-2));
                let (mut squares, mut weights) = (0.0, 0.0);
                for ((tile, told), misfit) in told.iter().zip(&misfits) {
                    let weight = 1.0 / (1.0 + f64::powi(misfit / TOLERATED, 2));
                    squares += weight * misfit * misfit;
                    weights += 2.0 * weight;
                    for (row, value, certainty) in told.equations(&tile.slopes) {
                        equations.add(&row, value, weight * certainty);
                    }
                }
                step = equations.solve()?;
                for ((tile, told), misfit) in told.iter().zip(&mut misfits) {
                    *misfit = told.misfit(&tile.slopes, &step);
                }
                let inverse = equations.inverse()?;
                let spread = (squares / weights).max(1.0);
                sd_px = (inverse[0][0].max(inverse[1][1]) * spread).sqrt();
            }
            let agreeing = told.iter().zip(&misfits);
            let agreeing = agreeing.filter(|(_, misfit)| **misfit < TOLERATED);
            let tells: DVec2 = agreeing.clone().map(|((tile, _), _)| tile.tells).sum();
            let longest = step.iter().fold(0.0_f64, |most, step| most.max(step.abs()));
            for (number, step) in numbers.iter_mut().zip(step) {
                // Slopes hold for some pixels only.
                *number += step.clamp(-3.0, 3.0);
            }
            if longest < MIN_SD_PX {
                let fit = Fit {
                    turn: Turn::from_array(numbers, camera),
                    sd_px: sd_px.max(MIN_SD_PX),
                    tells,
                };
                let enough = agreeing.count() >= MIN_TILES.max(told.len() / 2);
                return (enough && self.share(&fit) >= FADED / 2.0).then_some(fit);
            }
        }
        None
    }
}

#[cfg(test)]
mod tests;
