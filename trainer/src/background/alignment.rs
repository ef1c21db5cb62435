//! Motion between two backgrounds that differ in weather and time of day.
//!
//! Brightness, contrast and even its sign differ: houses are white at noon and black at dawn. So the reference is cut into patches, each
//! with a free gain and offset in the second image, and weighted by its own misfit. First, a search finds the shift with the largest
//! squared correlations of the most structured patches. Gauss-Newton steps for all patches and the whole motion follow, from blurred to
//! sharp images; contradicting patches lose their weight. Grass stripes constrain rows only, a ship's hull constrains both axes: each patch
//! counts along its structure.

use dataset::geometry::camera::Camera;
use dataset::numbers::least_squares::NormalEquations;
use glam::{DMat2, DVec2};
use rayon::prelude::*;

use super::grey_image::GreyImage;
use super::motion::{Motion, UNKNOWNS};

/// Patch size, pixels: structure near the horizon is flat.
const PATCH: (usize, usize) = (64, 16);
/// Number of patches with the most horizontal and vertical structure.
const ACROSS: usize = 250;
const DOWN: usize = 100;
/// Number of patches in the search, and their margins, pixels.
const SEARCHED: usize = 40;
const SURROUNDINGS: (usize, usize) = (32, 4);
/// Range and step of the search, pixels.
const FARTHEST: (isize, isize) = (120, 24);
const STEP: (usize, usize) = (4, 2);
/// Blurs of the images, pixels.
const BLURS_PX: [f64; 3] = [3.0, 1.5, 0.7];
const STEPS: usize = 12;
/// Minimum squared correlation.
const MIN_CORRELATION: f64 = 0.3;
/// Minimum noise in mean images, grey levels.
const NOISE_LEVELS: f64 = 0.1;
/// Number of neighbouring pixels with a common error.
const SHARED: f64 = 4.0;
/// Prior standard deviations: turns, radians, and stretch.
const USUAL: [f64; UNKNOWNS] = [0.02, 0.02, 0.003, 0.1];
/// Standard deviations beyond which a patch loses weight.
const TOLERATED: f64 = 3.0;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Aligned {
    pub(crate) motion: Motion,
    /// Horizontal standard deviation, pixels.
    pub(crate) sd_px: f64,
}

/// First column and row of the patch in the camera's image.
type Corner = (usize, usize);

/// A background for comparison with others.
#[derive(Debug, Clone)]
pub(crate) struct Reference {
    picture: GreyImage,
    blurred: [GreyImage; BLURS_PX.len()],
    /// Patches with the most horizontal structure first.
    patches: Vec<Corner>,
}

/// A background prepared for comparison with a reference.
#[derive(Debug, Clone)]
pub(crate) struct Compared {
    searched: GreyImage,
    blurred: [(GreyImage, [GreyImage; 2]); BLURS_PX.len()],
}

impl Compared {
    pub(crate) fn of(picture: &GreyImage) -> Self {
        Self {
            searched: picture.blurred(1.0),
            blurred: BLURS_PX.map(|sigma_px| {
                let blurred = picture.blurred(sigma_px);
                let gradients = blurred.gradients();
                (blurred, gradients)
            }),
        }
    }
}

impl Reference {
    pub(crate) fn of(picture: GreyImage) -> Self {
        let [across, down] = picture.gradients();
        let (width, height) = PATCH;
        let bottom = picture.top + picture.rows();
        let mut patches: Vec<(Corner, [f32; 2])> = Vec::new();
        for y in (picture.top + 4..(bottom - 4).saturating_sub(height)).step_by(height) {
            for x in (8..(picture.width - 8).saturating_sub(width)).step_by(width) {
                let power = |gradient: &GreyImage| {
                    let rows = (y - picture.top..).take(height);
                    let places =
                        rows.flat_map(|row| (x..x + width).map(move |column| (row, column)));
                    places
                        .map(|(row, column)| gradient.light[row * picture.width + column].powi(2))
                        .sum()
                };
                patches.push(((x, y), [power(&across), power(&down)]));
            }
        }
        let mut most = |axis: usize, count: usize| {
            patches.sort_by(|(_, a), (_, b)| b[axis].total_cmp(&a[axis]));
            patches
                .iter()
                .take(count)
                .map(|(corner, _)| *corner)
                .collect::<Vec<_>>()
        };
        let mut chosen = most(0, ACROSS);
        let mut down = most(1, DOWN);
        down.retain(|corner| !chosen.contains(corner));
        chosen.append(&mut down);
        Self {
            blurred: BLURS_PX.map(|sigma_px| picture.blurred(sigma_px)),
            picture,
            patches: chosen,
        }
    }

    pub(crate) fn picture(&self) -> &GreyImage {
        &self.picture
    }

    /// Motion from this image to a second one from the same kind of camera; `None` if they have too little in common.
    pub(crate) fn motion_to(
        &self,
        other: &Compared,
        camera: &Camera,
        horizon_px: f64,
    ) -> Option<Aligned> {
        let shift = self.search(&other.searched)?;
        // A turn around the downward axis moves directions to the right, one around the axis to the right moves them up.
        let turn_rad = [-shift.y, shift.x, 0.0].map(|px| px / camera.focal_px);
        let start = Motion {
            turn_rad: turn_rad.into(),
            stretch: 0.0,
        };
        let start = Aligned {
            motion: start,
            sd_px: f64::INFINITY,
        };
        let mut levels = self.blurred.iter().zip(&other.blurred);
        levels.try_fold(start, |found, (reference, (picture, gradients))| {
            self.refine(
                reference,
                (picture, gradients),
                camera,
                horizon_px,
                found.motion,
            )
        })
    }

    /// Shift with the largest squared correlations.
    fn search(&self, other: &GreyImage) -> Option<DVec2> {
        let reference = &self.blurred[BLURS_PX.len() - 1];
        let (columns, rows) = (
            FARTHEST.0 as usize * 2 / STEP.0 + 1,
            FARTHEST.1 as usize * 2 / STEP.1 + 1,
        );
        let last = |picture: &GreyImage, row: isize, column: isize| {
            let row = (row - picture.top as isize).clamp(0, picture.rows() as isize - 1) as usize;
            let column = column.clamp(0, picture.width as isize - 1) as usize;
            f64::from(picture.light[row * picture.width + column])
        };
        let scores = self.patches.par_iter().take(SEARCHED).map(|&(x, y)| {
            let places: Vec<(isize, isize)> = (0..PATCH.1 + 2 * SURROUNDINGS.1)
                .step_by(STEP.1)
                .flat_map(|row| {
                    (0..PATCH.0 + 2 * SURROUNDINGS.0)
                        .step_by(STEP.0)
                        .map(move |column| (row, column))
                })
                .map(|(row, column)| {
                    (
                        (y + row) as isize - SURROUNDINGS.1 as isize,
                        (x + column) as isize - SURROUNDINGS.0 as isize,
                    )
                })
                .collect();
            let count = places.len() as f64;
            let wanted: Vec<f64> = places
                .iter()
                .map(|&(row, column)| last(reference, row, column))
                .collect();
            let mean = wanted.iter().sum::<f64>() / count;
            let wanted: Vec<f64> = wanted.into_iter().map(|light| light - mean).collect();
            let power = wanted.iter().map(|light| light * light).sum::<f64>();
            let mut scores = vec![0.0; columns * rows];
            for (i, score) in scores.iter_mut().enumerate() {
                let down = (i / columns * STEP.1) as isize - FARTHEST.1;
                let right = (i % columns * STEP.0) as isize - FARTHEST.0;
                let [mut sum, mut squares, mut product] = [0.0; 3];
                for (&(row, column), wanted) in places.iter().zip(&wanted) {
                    let light = last(other, row + down, column + right);
                    sum += light;
                    squares += light * light;
                    product += light * wanted;
                }
                let variance = (squares - sum * sum / count).max(0.0) + 0.05 * count;
                *score = product * product / (power * variance + 1e-6);
            }
            scores
        });
        let sums = scores.reduce_with(|a, b| a.into_iter().zip(b).map(|(a, b)| a + b).collect())?;
        let (best, _) = sums
            .iter()
            .enumerate()
            .max_by(|(_, a), (_, b)| a.total_cmp(b))?;
        Some(DVec2::new(
            ((best % columns * STEP.0) as isize - FARTHEST.0) as f64,
            ((best / columns * STEP.1) as isize - FARTHEST.1) as f64,
        ))
    }

    fn refine(
        &self,
        reference: &GreyImage,
        (other, gradients): (&GreyImage, &[GreyImage; 2]),
        camera: &Camera,
        horizon_px: f64,
        start: Motion,
    ) -> Option<Aligned> {
        let mut motion = start;
        let mut sd_px = f64::INFINITY;
        for _ in 0..STEPS {
            let constraints: Vec<PatchConstraint> = self
                .patches
                .par_iter()
                .filter_map(|&corner| {
                    PatchConstraint::of(
                        corner,
                        reference,
                        (other, gradients),
                        |place, motion| motion.of_ground(camera, horizon_px, place),
                        motion,
                    )
                })
                .collect();
            let mut step = [0.0; UNKNOWNS];
            let mut misfits: Vec<f64> = vec![0.0; constraints.len()];
            for _ in 0..8 {
                let mut equations = NormalEquations::new(UNKNOWNS);
                for (unknown, sd) in USUAL.into_iter().enumerate() {
                    let mut row = [0.0; UNKNOWNS];
                    row[unknown] = 1.0;
                    equations.add(&row, -motion.to_array()[unknown], sd.powi(-2));
                }
                for (constraint, misfit) in constraints.iter().zip(&misfits) {
                    for (row, value, certainty) in constraint.equations() {
                        equations.add(&row, value, constraint.weight_at(*misfit) * certainty);
                    }
                }
                step = equations.solve_for::<UNKNOWNS>()?;
                let [mut squares, mut weights] = [0.0; 2];
                for (constraint, misfit) in constraints.iter().zip(&mut misfits) {
                    *misfit = constraint.misfit(&step);
                    let weight = constraint.weight_at(*misfit);
                    squares += weight * *misfit * *misfit;
                    weights += 2.0 * weight;
                }
                let spread = squares / f64::max(weights, 1.0);
                sd_px = (equations.inverse()?[1][1] * spread.max(1.0)).sqrt() * camera.focal_px;
            }
            let mut next = motion.to_array();
            next.iter_mut()
                .zip(step)
                .for_each(|(value, step)| *value += step);
            motion = Motion::from_array(next);
            let largest = step[..3]
                .iter()
                .fold(0.0, |largest: f64, step| largest.max(step.abs()));
            if largest * camera.focal_px < 0.002 {
                break;
            }
        }
        Some(Aligned { motion, sd_px })
    }
}

/// Constraint on the motion from one patch.
struct PatchConstraint {
    /// Derivatives of the position by the motion, right and down.
    slopes: [[f64; UNKNOWNS]; 2],
    /// Information matrix of the position, right and down, upper triangle.
    certainty: [f64; 3],
    /// Best shift, pixels.
    best: DVec2,
    weight: f64,
}

impl PatchConstraint {
    fn of(
        (x, y): Corner,
        reference: &GreyImage,
        (other, [across, down]): (&GreyImage, &[GreyImage; 2]),
        place: impl Fn(DVec2, &Motion) -> DVec2,
        motion: Motion,
    ) -> Option<Self> {
        let half = DVec2::new(PATCH.0 as f64 - 1.0, PATCH.1 as f64 - 1.0) / 2.0;
        let middle = DVec2::new(x as f64, y as f64) + half;
        let here = place(middle, &motion);
        let stretched = half.y * (1.0 + motion.stretch).abs();
        if !other.contains([
            here.x - half.x,
            here.y - stretched,
            here.x + half.x,
            here.y + stretched,
        ]) {
            return None;
        }
        // Sums and products: light there, light here, and both gradients.
        let mut sums = [0.0; 4];
        let mut products = [[0.0; 4]; 4];
        for row in 0..PATCH.1 {
            let v = here.y + (row as f64 - half.y) * (1.0 + motion.stretch);
            for column in 0..PATCH.0 {
                let u = here.x + column as f64 - half.x;
                let wanted =
                    reference.light[(y + row - reference.top) * reference.width + x + column];
                let values = [
                    f64::from(wanted),
                    other.between(u, v),
                    across.between(u, v),
                    down.between(u, v),
                ];
                for i in 0..4 {
                    sums[i] += values[i];
                    for k in i..4 {
                        products[i][k] += values[i] * values[k];
                    }
                }
            }
        }
        let count = (PATCH.0 * PATCH.1) as f64;
        let about_means =
            |i: usize, k: usize| products[i.min(k)][i.max(k)] - sums[i] * sums[k] / count;
        let power = about_means(0, 0) + 1e-6;
        // Remainder after gain and offset.
        let left =
            |i: usize, k: usize| about_means(i, k) - about_means(0, i) * about_means(0, k) / power;
        let rest = left(1, 1);
        let correlation = 1.0 - rest / (about_means(1, 1) + 1e-6);
        if correlation <= MIN_CORRELATION {
            return None;
        }
        let variance = (rest / (count - 4.0)).max(NOISE_LEVELS.powi(2)) * SHARED;
        let certainty = [left(2, 2), left(2, 3), left(3, 3)].map(|value| value / variance);
        let [xx, xy, yy] = certainty;
        let pull = DVec2::new(-left(1, 2), -left(1, 3)) / variance;
        let ridge = 1e-3 * (xx + yy) + 1e-9;
        let best = DMat2::from_cols_array(&[xx + ridge, xy, xy, yy + ridge]).inverse() * pull;
        let mut slopes = [[0.0; UNKNOWNS]; 2];
        for unknown in 0..UNKNOWNS {
            const SMALL: f64 = 1e-6;
            let mut other = motion.to_array();
            other[unknown] += SMALL;
            let slope = (place(middle, &Motion::from_array(other)) - here) / SMALL;
            slopes[0][unknown] = slope.x;
            slopes[1][unknown] = slope.y;
        }
        Some(Self {
            slopes,
            certainty,
            best,
            weight: correlation,
        })
    }

    /// Two independent equations for the step with their information, along the axes of the patch's structure.
    fn equations(&self) -> [([f64; UNKNOWNS], f64, f64); 2] {
        let [xx, xy, yy] = self.certainty;
        let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
        let axis = DVec2::from_angle(angle);
        [axis, axis.perp()].map(|axis| {
            let row =
                std::array::from_fn(|i| axis.x * self.slopes[0][i] + axis.y * self.slopes[1][i]);
            let certainty =
                axis.x * axis.x * xx + 2.0 * axis.x * axis.y * xy + axis.y * axis.y * yy;
            (row, axis.dot(self.best), certainty.max(0.0))
        })
    }

    fn weight_at(&self, misfit: f64) -> f64 {
        self.weight / (1.0 + (misfit / TOLERATED).powi(2))
    }

    /// Difference between the best shift and a step, in standard deviations.
    fn misfit(&self, step: &[f64; UNKNOWNS]) -> f64 {
        let squares = self.equations().map(|(row, value, certainty)| {
            let moved: f64 = row.iter().zip(step).map(|(row, step)| row * step).sum();
            certainty * (moved - value).powi(2)
        });
        squares.iter().sum::<f64>().sqrt()
    }
}
