//! Where a camera looks in a flight, relative to where it looked in the training.

use dataset::geometry::camera::Camera;
use glam::DVec2;

use crate::fit::{Fit, MIN_SD_PX};
use crate::ground::{Motion, SHIFT, UNKNOWNS};
use crate::least_squares::{Normal, inverse};

/// Square pixels, for the unknowns of [`Motion::to_px`].
pub type Covariance = [[f64; UNKNOWNS]; UNKNOWNS];

/// A camera's direction and focal length, with their covariance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sight {
    /// Motion from the training's image to the flight's.
    pub motion: Motion,
    /// Its covariance.
    pub covariance_px2: Covariance,
}

impl Sight {
    /// What is expected of a camera before its images are compared: no motion, with these standard deviations ([`Motion::to_px`]).
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

    /// The motion by a fit.
    pub(crate) fn of_fit(fit: &Fit) -> Self {
        let mut covariance_px2 = fit.covariance_px2;
        SHIFT.for_each(|axis| covariance_px2[axis][axis] += MIN_SD_PX * MIN_SD_PX);
        Self {
            motion: fit.motion,
            covariance_px2,
        }
    }

    /// Standard deviation of the shift, the larger one of both axes, pixels.
    pub fn sd_px(&self) -> f64 {
        let variances = SHIFT.map(|axis| self.covariance_px2[axis][axis]);
        variances.fold(0.0, f64::max).sqrt()
    }

    /// Both pieces of evidence together; `None` if one is certain of something impossible.
    #[must_use]
    pub fn with(&self, other: &Self, camera: &Camera) -> Option<Self> {
        let mut equations = Normal::<UNKNOWNS>::new();
        for one in [self, other] {
            let values = one.motion.to_px(camera);
            let information = inverse(one.covariance_px2)?;
            // Rows of the information's square root would do as well: N = sum J, N x = sum J v.
            equations.add_information(&information, &values);
        }
        Some(Self {
            motion: Motion::of_px(equations.solve()?, camera),
            covariance_px2: equations.inverse()?,
        })
    }

    /// The same evidence, less certain by a factor.
    #[must_use]
    pub fn widened(&self, factor: f64) -> Self {
        let square = factor * factor;
        Self {
            covariance_px2: self.covariance_px2.map(|row| row.map(|of| of * square)),
            ..*self
        }
    }

    /// Displacements of a place in the image by one standard deviation, by independent causes.
    pub fn errors_px(&self, camera: &Camera, place_px: DVec2) -> [DVec2; UNKNOWNS] {
        const SMALL_PX: f64 = 1e-3;
        let factor = factor(self.covariance_px2);
        let usual_px = |motion: Motion| motion.usual_px(camera, place_px);
        let here_px = usual_px(self.motion);
        std::array::from_fn(|cause| {
            let column = std::array::from_fn(|unknown| SMALL_PX * factor[unknown][cause]);
            let moved = Motion::of_px(column, camera).after(self.motion);
            (usual_px(moved) - here_px) / SMALL_PX
        })
    }
}

/// Lower triangular factor of a covariance (Cholesky), with zeros where it has no variance.
fn factor(covariance: Covariance) -> Covariance {
    let mut factor = [[0.0; UNKNOWNS]; UNKNOWNS];
    for i in 0..UNKNOWNS {
        for j in 0..=i {
            let known: f64 = (0..j).map(|k| factor[i][k] * factor[j][k]).sum();
            let left = covariance[i][j] - known;
            factor[i][j] = if i == j {
                left.max(0.0).sqrt()
            } else if factor[j][j] > 0.0 {
                left / factor[j][j]
            } else {
                0.0
            };
        }
    }
    factor
}
