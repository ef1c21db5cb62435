//! Motion of the ground from a reference image to another one.
//!
//! Some hundred tiles with the most structure below the horizon are found again in the other image, each with its own gain and offset.
//! Their displacements decide about one motion (Gauss and Newton; Lucas and Kanade, "An iterative image registration technique", 1981).
//! Tiles that contradict the others count less (Cauchy's weights), so that vehicles, waves and clouds drop out. If the expected motion does
//! not lead to a fit, shrunk images are searched first ([`coarse`]).

mod coarse;
mod tile;

use std::cell::OnceCell;

use dataset::numbers::least_squares::NormalEquations;
use dataset::video::Luma;
use glam::DVec2;

use crate::ground::{Ground, Motion, SHIFT, UNKNOWNS};
use crate::sight::{CONTRADICTS_SD, Sight};
pub(crate) use coarse::Coarse;
use tile::{Tile, tiles_of};

/// Tiles that must agree.
const MIN_TILES: usize = 8;
/// Agreeing tiles with less than this part of the usual information about one axis show that the reference fades. With less than half of
/// that they do not show the direction: in haze, the rest of the ground may look alike wherever the camera looks.
const FADED: f64 = 0.6;
/// Minimum standard deviation, px: interpolation and compression. A step below it ends the iteration.
pub const MIN_SD_PX: f64 = 0.02;
/// Pixel noise of images, at least, grey levels.
pub const NOISE_LEVELS: f64 = 1.5;
/// Steps of the iteration: one without an end does not fit.
const MAX_STEPS: u32 = 12;
/// A shift found in shrunk images is right to this, pixels.
const COARSE_PX: f64 = 4.0;

/// Standard deviations of the unknowns before any image, pixels ([`Motion::to_px`]): they decide only where tiles do not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Freedom([f64; UNKNOWNS]);

impl Freedom {
    /// A camera that turns.
    pub const TURN: Self = Self([1e3, 1e3, 20.0, 1e-4, 1e-4]);
    /// A camera that also changes its focal length, from one flight to another.
    pub const TURN_AND_ZOOM: Self = Self([1e3, 1e3, 20.0, 20.0, 1e-4]);
    /// A camera that may also stand higher or lower, by a tenth.
    pub const MOVED: Self = Self([1e3, 1e3, 20.0, 20.0, 100.0]);
}

/// The ground that motions are measured from.
#[derive(Debug, Clone)]
pub struct Reference {
    ground: Ground,
    tiles: Vec<Tile>,
    coarse: Coarse,
    /// Largest information of agreeing tiles up to now, about both axes.
    usual: DVec2,
}

/// A measured motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    /// The motion.
    pub sight: Sight,
    /// Information of agreeing tiles about both axes.
    tells: DVec2,
}

impl Reference {
    /// A reference image with this pixel noise; `None` if it shows too little.
    pub fn of(image: &Luma<'_>, ground: &Ground, noise_levels: f64) -> Option<Self> {
        let tiles = tiles_of(image, ground, noise_levels);
        (tiles.len() >= MIN_TILES).then(|| Self {
            ground: *ground,
            coarse: Coarse::of(image, ground.top),
            usual: tiles.iter().map(|tile| tile.tells).sum::<DVec2>() / 2.0,
            tiles,
        })
    }

    /// Information of all tiles about the axis that they show less.
    pub(crate) fn information(&self) -> f64 {
        let all = self.tiles.iter().map(|tile| tile.tells);
        all.sum::<DVec2>().min_element()
    }

    /// Learns from a fit how much the tiles tell.
    pub(crate) fn take(&mut self, fit: &Fit) {
        self.usual = self.usual.max(fit.tells);
    }

    /// Motion near an expected one, or else anywhere. `shrunk`: the image for all references of its camera.
    pub(crate) fn find(
        &self,
        image: &Luma<'_>,
        shrunk: &OnceCell<Coarse>,
        expected: Motion,
        freedom: &Freedom,
    ) -> Option<Fit> {
        let near = self.near(image, expected, freedom);
        match near {
            Some(fit) if !self.is_faded_in(&fit) => Some(fit),
            near => self.anywhere(image, shrunk, near, (expected, freedom)),
        }
    }

    /// Correlation of the edges of the ground with another image's, at the shift that fits best; 0 without any edge.
    pub(crate) fn resemblance(&self, image: &Luma<'_>, shrunk: &OnceCell<Coarse>) -> f64 {
        let other = shrunk.get_or_init(|| Coarse::of(image, self.ground.top));
        let best = self.coarse.best_shift(other, DVec2::ZERO);
        best.map_or(0.0, |(_, correlation)| correlation)
    }

    /// The better one of a fit and of what shrunk images show.
    pub(crate) fn anywhere(
        &self,
        image: &Luma<'_>,
        shrunk: &OnceCell<Coarse>,
        near: Option<Fit>,
        (expected, freedom): (Motion, &Freedom),
    ) -> Option<Fit> {
        let other = shrunk.get_or_init(|| Coarse::of(image, self.ground.top));
        let shift_px = self.coarse.shift_to(other, expected.shift_px)?;
        let from = Motion {
            shift_px,
            ..expected
        };
        let far = self.near(image, from, freedom);
        let is_near = |fit: &Fit| shift_px.distance(fit.sight.motion.shift_px) <= COARSE_PX;
        let fits = [near, far].into_iter().flatten().filter(is_near);
        fits.max_by(|a, b| self.share(a).total_cmp(&self.share(b)))
    }

    /// Information in the agreeing tiles, as a part of the usual, about the axis that lost more.
    fn share(&self, fit: &Fit) -> f64 {
        (fit.tells / self.usual.max(DVec2::splat(1e-9))).min_element()
    }

    /// True if too few tiles agree.
    pub(crate) fn is_faded_in(&self, fit: &Fit) -> bool {
        self.share(fit) < FADED
    }

    /// Refines a motion; `None` if the tiles do not agree there.
    pub(crate) fn near(&self, image: &Luma<'_>, begin: Motion, freedom: &Freedom) -> Option<Fit> {
        let camera = &self.ground.camera;
        let mut numbers = begin.to_px(camera);
        for _ in 0..MAX_STEPS {
            let motion = Motion::of_px(numbers, camera);
            let told: Vec<_> = (self.tiles.iter())
                .filter_map(|tile| {
                    let there = self
                        .ground
                        .place_px(tile.direction, tile.middle_px, &motion);
                    Some((tile, tile.told(image, there - tile.middle_px)?))
                })
                .collect();
            if told.len() < MIN_TILES {
                return None;
            }
            let mut misfits = vec![0.0; told.len()];
            let mut step = [0.0; UNKNOWNS];
            let mut covariance_px2 = [[0.0; UNKNOWNS]; UNKNOWNS];
            for _ in 0..10 {
                let mut equations = NormalEquations::new(UNKNOWNS);
                for (unknown, sd_px) in freedom.0.iter().enumerate() {
                    let mut row = [0.0; UNKNOWNS];
                    row[unknown] = 1.0;
                    equations.add(&row, -numbers[unknown], sd_px.powi(-2));
                }
                let (mut squares, mut weights) = (0.0, 0.0);
                for ((tile, told), misfit) in told.iter().zip(&misfits) {
                    let weight = 1.0 / (1.0 + f64::powi(misfit / CONTRADICTS_SD, 2));
                    squares += weight * misfit * misfit;
                    weights += 2.0 * weight;
                    for (row, value, certainty) in told.equations(&tile.slopes) {
                        equations.add(&row, value, weight * certainty);
                    }
                }
                step = equations.solve_for()?;
                for ((tile, told), misfit) in told.iter().zip(&mut misfits) {
                    *misfit = told.misfit(&tile.slopes, &step);
                }
                let spread = (squares / weights).max(1.0);
                covariance_px2 = (equations.inverse_for()?).map(|row| row.map(|of| of * spread));
            }
            let agreeing = told.iter().zip(&misfits);
            let agreeing = agreeing.filter(|(_, misfit)| **misfit < CONTRADICTS_SD);
            let tells: DVec2 = agreeing.clone().map(|((tile, _), _)| tile.tells).sum();
            let longest = step.iter().fold(0.0_f64, |most, step| most.max(step.abs()));
            for (number, step) in numbers.iter_mut().zip(step) {
                // Slopes hold for some pixels only.
                *number += step.clamp(-3.0, 3.0);
            }
            if longest < MIN_SD_PX {
                for axis in SHIFT {
                    let variance_px2 = &mut covariance_px2[axis][axis];
                    *variance_px2 = variance_px2.max(MIN_SD_PX * MIN_SD_PX);
                }
                let sight = Sight {
                    motion: Motion::of_px(numbers, camera),
                    covariance_px2,
                };
                let fit = Fit { sight, tells };
                let enough = agreeing.count() >= MIN_TILES.max(told.len() / 2);
                return (enough && self.share(&fit) >= FADED / 2.0).then_some(fit);
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::watched::tests::{HEIGHT, WIDTH, camera, evening, ground, image};

    #[test]
    fn an_edge_tells_its_place_across_itself_and_not_along_its_steps() {
        let ground_below = Ground {
            top: HEIGHT / 2,
            ..Ground::of(&camera())
        };
        let certain = |ground: fn(DVec2) -> f64| -> Vec<usize> {
            let levels = image(Motion::default(), ground);
            let image = Luma::of(&levels, WIDTH);
            let tiles = tiles_of(&image, &ground_below, NOISE_LEVELS);
            assert!(tiles.len() >= MIN_TILES);
            let told = |tile: &Tile| tile.told(&image, DVec2::ZERO).unwrap();
            tiles
                .iter()
                .map(|tile| {
                    let equations = told(tile).equations(&tile.slopes);
                    equations
                        .iter()
                        .filter(|(.., certainty)| *certainty > 0.0)
                        .count()
                })
                .collect()
        };
        // Stripes that fall by a pixel in twelve: each has a step there.
        let stripes = |place: DVec2| {
            60.0 + 100.0 * ((place.y - place.x / 12.0) / 40.0).floor().rem_euclid(2.0)
        };
        assert!(certain(stripes).iter().all(|axes| *axes == 1));
        assert!(certain(ground).iter().all(|axes| *axes == 2));
    }

    #[test]
    fn turn_and_zoom_are_found_together_in_other_light() {
        let camera = camera();
        let levels = image(Motion::default(), ground);
        let reference = Reference::of(
            &Luma::of(&levels, WIDTH),
            &Ground::of(&camera),
            NOISE_LEVELS,
        )
        .unwrap();
        for [x, y, zoom] in [[3.4, -1.8, 0.002], [-25.0, 6.0, -0.005]] {
            let expected = Motion {
                shift_px: DVec2::new(x, y),
                roll_rad: 0.0005,
                zoom,
                lift: 0.0,
            };
            let levels = image(expected, evening);
            let image = Luma::of(&levels, WIDTH);
            let found = reference.find(
                &image,
                &OnceCell::new(),
                Motion::default(),
                &Freedom::TURN_AND_ZOOM,
            );
            let found = found.expect("the ground shows the motion").sight;
            let wanted_px = expected.to_px(&camera);
            for (found_px, wanted_px) in found.motion.to_px(&camera).iter().zip(wanted_px) {
                let error_px = (found_px - wanted_px).abs();
                assert!(error_px < 0.05, "{found:?}, expected {expected:?}");
            }
            assert!(found.sd_px() < 0.1, "{found:?}");
        }
    }
}
