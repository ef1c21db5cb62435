//! Point lights: how a lamp of some candela at some distance falls on pixels.
//!
//! A lamp is smaller than a pixel at any distance of interest. Its illuminance at the camera, divided by a pixel's solid angle, is spread
//! by a Gaussian (the optics) with a weak wide skirt (glare), centred with sub-pixel accuracy.

pub(crate) mod site_lamps;

use glam::{DVec2, Vec3};

/// Standard deviation of the optics' blur, pixels.
const SIGMA_PX: f64 = 0.65;
/// Part of the light in the skirt, and its radius in pixels.
const SKIRT: f64 = 8e-4;
const SKIRT_RADIUS_PX: f64 = 3.0;
/// Exposed light below which a lamp's edge is not drawn (half a grey level in a dark image).
const FAINTEST: f64 = 4e-4;
/// Maximum extent of lamps, pixels.
const FARTHEST_PX: f64 = 40.0;

/// A lamp as it falls on the image.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Spot {
    /// Position, pixels.
    pub(crate) pixel: DVec2,
    /// Exposed light, integrated over pixels.
    pub(crate) energy: Vec3,
}

impl Spot {
    /// Exposed light that the spot adds to a pixel.
    pub(crate) fn on(&self, x: i64, y: i64) -> Vec3 {
        let r2 = (DVec2::new(x as f64, y as f64) - self.pixel).length_squared();
        self.energy * profile(r2) as f32
    }

    /// Distance beyond which the spot cannot be seen, pixels.
    pub(crate) fn reach_px(&self) -> f64 {
        let energy = f64::from(self.energy.max_element());
        let mut reach = 0.0;
        while reach < FARTHEST_PX && energy * profile(reach * reach) > FAINTEST {
            reach += 0.5;
        }
        reach
    }
}

/// Light per pixel at a squared distance, for a spot with unit energy.
fn profile(r2: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    let core =
        (1.0 - SKIRT) * (-r2 / (2.0 * SIGMA_PX * SIGMA_PX)).exp() / (TAU * SIGMA_PX * SIGMA_PX);
    let skirt = SKIRT * 2.0 / (PI * SKIRT_RADIUS_PX * SKIRT_RADIUS_PX)
        * (1.0 + r2 / (SKIRT_RADIUS_PX * SKIRT_RADIUS_PX)).powi(-3);
    core + skirt
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spot_keeps_its_energy_and_its_place_within_a_hundredth_of_a_pixel() {
        let spot = Spot {
            pixel: DVec2::new(20.3, 19.6),
            energy: Vec3::ONE,
        };
        let (mut sum, mut moment) = (0.0, DVec2::ZERO);
        for y in 0..40 {
            for x in 0..40 {
                let light = f64::from(spot.on(x, y).x);
                sum += light;
                moment += DVec2::new(x as f64, y as f64) * light;
            }
        }
        assert!((sum - 1.0).abs() < 2e-3, "{sum}");
        assert!(
            (moment / sum - spot.pixel).length() < 0.01,
            "{}",
            moment / sum
        );
    }
}
