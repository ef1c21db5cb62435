//! Seeing: turbulent air moves the image of a distant aircraft and blurs it.
//!
//! In a field of several degrees the light of the aircraft passes through different air than the light of the ground next to it, so the
//! aircraft moves separately; the backdrop, whose motion differs from place to place, is blurred by the same amount instead. Motion along
//! an axis is a Gaussian process with the correlation `exp(-|t| / tau)` (first-order Gauss-Markov), as a sum of waves with frequencies from
//! its spectrum (Shinozuka and Deodatis, "Simulation of Stochastic Processes by Spectral Representation", Applied Mechanics Reviews 44,
//! 1991): any instant can be computed independently. Variance of the angle of arrival grows with the path length, blur by Fried's parameter
//! with its power 3/5 (D. L. Fried, "Optical Resolution Through a Randomly Inhomogeneous Medium", JOSA 56, 1966), for uniform air along the
//! path.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use dataset::geometry::imaging::Seeing;
use glam::DVec2;

use crate::render::noise::unit_hash;

/// Reference distance of the settings, metres.
const REFERENCE_M: f64 = 10_000.0;
const RADIANS_PER_ARCSEC: f64 = PI / 180.0 / 3_600.0;
/// Waves along each axis.
const WAVES: u32 = 96;

/// Seeing of one camera.
pub(crate) struct Turbulence {
    tilt_rms_px: f64,
    blur_sigma_px: f64,
    /// Angular frequency (rad/s) and phase of each wave, right and down.
    waves: [Vec<(f64, f64)>; 2],
}

impl Turbulence {
    pub(crate) fn new(seeing: &Seeing, focal_px: f64, seed: u64) -> Self {
        let px_per_arcsec = focal_px * RADIANS_PER_ARCSEC;
        let waves = |axis: u32| {
            let random = |wave: u32, what: u32| {
                let key = (axis << 16) | (what << 12) | wave;
                f64::from(unit_hash(
                    seed as u32,
                    (seed >> 32) as u32,
                    key ^ 0x5EE1_0000,
                ))
            };
            (0..WAVES)
                .map(|wave| {
                    // One frequency from each of equally likely parts of the spectrum.
                    let part = (f64::from(wave) + random(wave, 0)) / f64::from(WAVES);
                    let frequency = (part * FRAC_PI_2).tan() / seeing.correlation_s;
                    (frequency, TAU * random(wave, 1))
                })
                .collect()
        };
        Self {
            tilt_rms_px: seeing.tilt_rms_arcsec * px_per_arcsec,
            blur_sigma_px: seeing.blur_sigma_arcsec * px_per_arcsec,
            waves: [waves(0), waves(1)],
        }
    }

    /// Displacement of the image of an object at a distance at a time, pixels right and down.
    pub(crate) fn shift_px(&self, distance_m: f64, time_s: f64) -> DVec2 {
        let along = |waves: &[(f64, f64)]| {
            let sum: f64 = waves
                .iter()
                .map(|(frequency, phase)| (frequency * time_s + phase).cos())
                .sum();
            sum * (2.0 / f64::from(WAVES)).sqrt()
        };
        let [right, down] = &self.waves;
        DVec2::new(along(right), along(down))
            * (self.tilt_rms_px * (distance_m / REFERENCE_M).sqrt())
    }

    /// Standard deviation of the blur of an object at a distance, pixels.
    pub(crate) fn blur_px(&self, distance_m: f64) -> f64 {
        self.blur_sigma_px * (distance_m / REFERENCE_M).powf(0.6)
    }

    /// Standard deviation of the backdrop's blur, pixels: blur and motion of objects at the reference distance.
    pub(crate) fn backdrop_blur_px(&self) -> f64 {
        self.blur_sigma_px.hypot(self.tilt_rms_px)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SEEING: Seeing = Seeing {
        tilt_rms_arcsec: 8.0,
        blur_sigma_arcsec: 4.0,
        correlation_s: 0.2,
    };
    const FOCAL_PX: f64 = 10_972.8;

    #[test]
    fn motion_has_the_asked_rms_and_forgets_itself_in_the_asked_time() {
        let (mut square, mut product) = (DVec2::ZERO, DVec2::ZERO);
        let mut count = 0.0;
        for seed in 0..60 {
            let air = Turbulence::new(&SEEING, FOCAL_PX, 1_000 + seed);
            for step in 0..50 {
                let time_s = f64::from(step) * 1.3;
                let (now, later) = (
                    air.shift_px(10_000.0, time_s),
                    air.shift_px(10_000.0, time_s + SEEING.correlation_s),
                );
                square += now * now;
                product += now * later;
                count += 1.0;
            }
        }
        let rms_arcsec =
            (square / count / 2.0).element_sum().sqrt() / FOCAL_PX / RADIANS_PER_ARCSEC;
        assert!((rms_arcsec / 8.0 - 1.0).abs() < 0.04, "{rms_arcsec}");
        let correlation = product.element_sum() / square.element_sum();
        assert!(
            (correlation - (-1.0_f64).exp()).abs() < 0.05,
            "{correlation}"
        );
    }

    #[test]
    fn motion_and_blur_grow_with_distance_by_their_powers() {
        let air = Turbulence::new(&SEEING, FOCAL_PX, 7);
        let ratio = air.shift_px(20_000.0, 3.0) / air.shift_px(5_000.0, 3.0);
        assert!(ratio.distance(DVec2::splat(2.0)) < 1e-9, "{ratio}");
        assert!((air.blur_px(10_000.0) - 4.0 * FOCAL_PX * RADIANS_PER_ARCSEC).abs() < 1e-12);
        assert!((air.blur_px(20_000.0) / air.blur_px(10_000.0) - 2.0_f64.powf(0.6)).abs() < 1e-12);
    }
}
