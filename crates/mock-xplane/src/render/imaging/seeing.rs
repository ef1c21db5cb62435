//! Seeing: turbulent air moves and blurs the image of distant aircraft.
//!
//! In a field of several degrees the light of the aircraft passes through different air than the light of the ground next to it, so the
//! aircraft moves separately ([`TiltMotion`]); the backdrop, whose motion differs from place to place, is blurred by the same amount
//! instead. Blur grows by Fried's parameter with the power 3/5 of the path length (D. L. Fried, "Optical Resolution Through a Randomly
//! Inhomogeneous Medium", JOSA 56, 1966), for uniform air along the path.

use dataset::geometry::imaging::Seeing;
use dataset::geometry::imaging::image_motion::{
    RADIANS_PER_ARCSEC, SEEING_REFERENCE_M, TiltMotion,
};
use glam::DVec2;

/// A camera's seeing.
pub(crate) struct Turbulence {
    tilt: TiltMotion,
    blur_sigma_px: f64,
}

impl Turbulence {
    pub(crate) fn new(seeing: &Seeing, focal_px: f64, seed: u64) -> Self {
        Self {
            tilt: TiltMotion::new(seeing, focal_px, seed),
            blur_sigma_px: seeing.blur_sigma_arcsec * (focal_px * RADIANS_PER_ARCSEC),
        }
    }

    /// Displacement of an object's image by its distance and time, pixels right and down.
    pub(crate) fn shift_px(&self, distance_m: f64, time_s: f64) -> DVec2 {
        self.tilt.shift_px(distance_m, time_s)
    }

    /// Standard deviation of an object's blur by its distance, pixels.
    pub(crate) fn blur_px(&self, distance_m: f64) -> f64 {
        self.blur_sigma_px * (distance_m / SEEING_REFERENCE_M).powf(0.6)
    }

    /// Standard deviation of the backdrop's blur, pixels: blur and motion of objects at the reference distance.
    pub(crate) fn backdrop_blur_px(&self) -> f64 {
        self.blur_sigma_px.hypot(self.tilt.reference_rms_px())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blur_grows_with_the_distance_by_its_power() {
        let seeing = Seeing {
            tilt_rms_arcsec: 8.0,
            blur_sigma_arcsec: 4.0,
            correlation_s: Some(0.2),
            crosswind: None,
        };
        let focal_px = 10_972.8;
        let air = Turbulence::new(&seeing, focal_px, 7);
        assert!((air.blur_px(10_000.0) - 4.0 * focal_px * RADIANS_PER_ARCSEC).abs() < 1e-12);
        assert!((air.blur_px(20_000.0) / air.blur_px(10_000.0) - 2.0_f64.powf(0.6)).abs() < 1e-12);
    }
}
