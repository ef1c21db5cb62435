//! A camera's direction and focal length in a flight, relative to those in the training.

use dataset::geometry::camera::Camera;
use dataset::numbers::least_squares::{NormalEquations, inverse};
use glam::{DMat2, DVec2};

use crate::ground::{Covariance, Motion, SHIFT, UNKNOWNS, slopes};

/// Evidence that is further away, in standard deviations, contradicts other evidence; in a mean it counts less than half.
pub const CONTRADICTS_SD: f64 = 3.0;
/// Deviation that chance does not explain, even among thousands of numbers, in standard deviations.
pub const CERTAIN_SD: f64 = 5.0;

/// A camera's direction and focal length, with their covariance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sight {
    /// Motion from the training's image to the flight's.
    pub motion: Motion,
    /// Its covariance.
    pub covariance_px2: Covariance,
}

impl Sight {
    /// The expectation before any image is compared: no motion, with these standard deviations ([`Motion::to_px`]).
    pub fn expected(sds_px: [f64; UNKNOWNS]) -> Self {
        let mut covariance_px2 = [[0.0; UNKNOWNS]; UNKNOWNS];
        for (unknown, sd_px) in sds_px.into_iter().enumerate() {
            covariance_px2[unknown][unknown] = sd_px * sd_px;
        }
        Self {
            motion: Motion::default(),
            covariance_px2,
        }
    }

    /// Standard deviation of the shift, the larger one of both axes, pixels.
    pub fn sd_px(&self) -> f64 {
        let variances = SHIFT.map(|axis| self.covariance_px2[axis][axis]);
        variances.fold(0.0, f64::max).sqrt()
    }

    /// Both pieces of evidence together; `None` if a covariance is singular.
    #[must_use]
    pub fn with(&self, other: &Self, camera: &Camera) -> Option<Self> {
        let mut equations = NormalEquations::new(UNKNOWNS);
        for one in [self, other] {
            let values = one.motion.to_px(camera);
            let information = inverse(&one.covariance_px2)?;
            equations.add_information(&information, &values);
        }
        Some(Self {
            motion: Motion::of_px(equations.solve_for()?, camera),
            covariance_px2: equations.inverse_for()?,
        })
    }

    /// This evidence with what is expected, or alone if both contradict each other: a camera that has moved is not where it is expected.
    #[must_use]
    pub fn expected_at(&self, expected: &Self, camera: &Camera) -> Self {
        let here = self.motion.to_px(camera);
        let there = expected.motion.to_px(camera);
        let agrees = (0..UNKNOWNS).all(|unknown| {
            let variance_px2 =
                self.covariance_px2[unknown][unknown] + expected.covariance_px2[unknown][unknown];
            (here[unknown] - there[unknown]).abs() <= CONTRADICTS_SD * variance_px2.sqrt()
        });
        let both = agrees.then(|| self.with(expected, camera)).flatten();
        both.unwrap_or(*self)
    }

    /// Evidence whose shift has an additional error, a standard deviation in pixels.
    #[must_use]
    pub fn with_shift_sd(mut self, sd_px: f64) -> Self {
        SHIFT.for_each(|axis| self.covariance_px2[axis][axis] += sd_px * sd_px);
        self
    }

    /// Evidence whose standard deviations are larger by a factor.
    #[must_use]
    pub fn widened(&self, factor: f64) -> Self {
        let square = factor * factor;
        Self {
            covariance_px2: self.covariance_px2.map(|row| row.map(|of| of * square)),
            ..*self
        }
    }

    /// Displacements of a place in the image by one standard deviation, two independent ones.
    pub fn errors_px(&self, camera: &Camera, place_px: DVec2) -> [DVec2; 2] {
        let slopes = slopes(camera, |step| {
            step.after(self.motion).usual_px(camera, place_px)
        });
        let mut covariance = DMat2::ZERO;
        for (slope, row) in slopes.iter().zip(self.covariance_px2) {
            for (other, part) in slopes.iter().zip(row) {
                covariance += part * DMat2::from_cols(*slope * other.x, *slope * other.y);
            }
        }
        // Cholesky's factor, column by column.
        let right = covariance.x_axis.x.max(0.0).sqrt();
        let together = covariance.x_axis.y / right.max(f64::MIN_POSITIVE);
        let down = (covariance.y_axis.y - together * together).max(0.0).sqrt();
        [DVec2::new(right, together), DVec2::new(0.0, down)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::watched::tests::camera;

    #[test]
    fn a_wide_expectation_leaves_a_narrow_measurement_as_it_is() {
        let camera = camera();
        let numbers = [2.0, -3.0, 0.4, 0.8, 0.1];
        let measured = Sight {
            motion: Motion::of_px(numbers, &camera),
            ..Sight::expected([0.02, 0.03, 0.05, 0.05, 0.01])
        };
        let both = Sight::expected([100.0; UNKNOWNS]).with(&measured, &camera);
        let both = both.unwrap();
        for (found, number) in both.motion.to_px(&camera).into_iter().zip(numbers) {
            assert!((found - number).abs() < 1e-5, "{both:?}");
        }
        assert!((both.sd_px() - 0.03).abs() < 1e-6, "{both:?}");
        assert_eq!(Sight::expected([0.0; UNKNOWNS]).with(&both, &camera), None);
    }

    #[test]
    fn an_uncertain_zoom_displaces_places_in_proportion_to_their_distance_from_the_centre() {
        let camera = camera();
        let sight = Sight::expected([0.0, 0.0, 0.0, 0.5, 0.0]);
        for right_px in [0.0, 80.0, -160.0, 320.0] {
            let place_px = camera.principal_px + DVec2::new(right_px, 0.0);
            let [first, second] = sight.errors_px(&camera, place_px);
            let expected_px = 0.5 * right_px.abs() / 320.0;
            assert!(
                (first.x - expected_px).abs() < 1e-4,
                "{first} at {right_px}"
            );
            assert!(
                first.y.abs().max(second.length()) < 1e-4,
                "{first}, {second}"
            );
        }
    }
}
