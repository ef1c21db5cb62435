//! Motion of images by turbulent air and by a swaying mast, as a function of time.
//!
//! Each motion is a Gaussian process along both axes of the image, as a sum of waves with frequencies from its spectrum (Shinozuka and
//! Deodatis, "Simulation of Stochastic Processes by Spectral Representation", Applied Mechanics Reviews 44, 1991): any instant can be
//! computed independently, so that the stand-in draws with the same function that tells `dtd verify` where to look. Seeds of two cameras
//! are different, and so their motions are independent.
//!
//! **Tilt** moves the aircraft and leaves the background. Its variance grows with the length of the path through even air (D. L. Fried,
//! "Optical Resolution Through a Randomly Inhomogeneous Medium", JOSA 56, 1966). In time it either has the correlation `exp(-|t| / tau)`,
//! or comes from turbulence that a crosswind carries along: then the power spectrum falls as f^(-2/3) up to a knee and as f^(-11/3) beyond
//! (G. A. Tyler, "Bandwidth considerations for tracking through turbulence", JOSA A 11, 1994, for an image's centroid). Tyler's
//! asymptotes meet at 0.24 wind / aperture for the image and at 0.28 for the wavefront's tilt; we round to 0.3. There is no outer scale:
//! slow motion is as strong as it can be.
//!
//! **Sway** moves the whole image. A mast in gusts is a resonator: its displacement has a peak at the natural frequency, as wide as its
//! damping.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::DVec2;

use crate::geometry::imaging::{Crosswind, Seeing, Sway};
use crate::numbers::noise_hash::unit_hash;

/// Reference distance of seeing, metres.
pub const SEEING_REFERENCE_M: f64 = 10_000.0;
/// Radians per arcsecond.
pub const RADIANS_PER_ARCSEC: f64 = PI / 180.0 / 3_600.0;
/// Tilt waves along each axis: with a correlation time, in a crosswind, whose spectrum is far wider, and sway waves.
const CORRELATED_WAVES: u32 = 96;
const CROSSWIND_WAVES: u32 = 512;
const SWAY_WAVES: u32 = 128;
/// They distinguish the phases of tilt and sway with the same seed.
const TILT: u32 = 0x5EE1_0000;
const SWAY: u32 = 0x5A4A_0000;
/// Ratio of the mast's damping to the critical one. EN 1991-1-4, annex F, has logarithmic decrements of 0.012 to 0.05 for steel masts,
/// which are ratios of 0.002 to 0.008; the air adds as much as the wind is strong.
const DAMPING_RATIO: f64 = 0.02;
/// Sway frequencies are within this part of the natural one.
const SWAY_BAND: f64 = 0.5;

/// Image motion of a distant aircraft by turbulence.
#[derive(Debug, Clone)]
pub struct TiltMotion {
    rms_px: f64,
    waves: Waves,
}

impl TiltMotion {
    /// The motion in one camera.
    pub fn new(seeing: &Seeing, focal_px: f64, seed: u64) -> Self {
        let waves = match seeing.crosswind {
            Some(wind) => Waves::new(CROSSWIND_WAVES, seed, TILT, |part| {
                TAU * wind.frequency_hz(part)
            }),
            None => {
                let correlation_s = seeing.correlation_s.unwrap_or(f64::INFINITY);
                Waves::new(CORRELATED_WAVES, seed, TILT, |part| {
                    (part * FRAC_PI_2).tan() / correlation_s
                })
            }
        };
        Self {
            rms_px: seeing.tilt_rms_arcsec * (focal_px * RADIANS_PER_ARCSEC),
            waves,
        }
    }

    /// Root mean square along one axis at the reference distance, pixels.
    pub fn reference_rms_px(&self) -> f64 {
        self.rms_px
    }

    /// Image displacement for an object at a distance at a time, pixels right and down.
    pub fn shift_px(&self, distance_m: f64, time_s: f64) -> DVec2 {
        self.waves.at(time_s) * (self.rms_px * (distance_m / SEEING_REFERENCE_M).sqrt())
    }
}

impl Crosswind {
    /// The frequency below which this part of the variance is, hertz: 8/9 are below the knee.
    fn frequency_hz(&self, part: f64) -> f64 {
        let relative = if part < 8.0 / 9.0 {
            (part * 9.0 / 8.0).powi(3)
        } else {
            (9.0 * (1.0 - part)).powf(-3.0 / 8.0)
        };
        self.knee_hz() * relative
    }
}

/// Motion of the whole image by the mast's sway.
#[derive(Debug, Clone)]
pub struct SwayMotion {
    rms_px: f64,
    waves: Waves,
}

impl SwayMotion {
    /// A camera's motion.
    pub fn new(sway: &Sway, seed: u64) -> Self {
        // A resonator's spectral peak is Cauchy's distribution of frequencies.
        let widest = (SWAY_BAND / DAMPING_RATIO).atan();
        let waves = Waves::new(SWAY_WAVES, seed, SWAY, |part| {
            let aside = DAMPING_RATIO * (widest * (2.0 * part - 1.0)).tan();
            TAU * sway.frequency_hz * (1.0 + aside)
        });
        Self {
            rms_px: sway.rms_px,
            waves,
        }
    }

    /// Displacement of everything in the image at a time, pixels right and down.
    pub fn shift_px(&self, time_s: f64) -> DVec2 {
        self.waves.at(time_s) * self.rms_px
    }
}

/// A Gaussian process along two axes, with variance 1 along each.
#[derive(Debug, Clone)]
struct Waves {
    /// Angular frequency (rad/s) and phase of each wave, right and down.
    axes: [Vec<(f64, f64)>; 2],
}

impl Waves {
    /// `frequency`: the angular frequency (rad/s) below which a part of the variance is.
    fn new(count: u32, seed: u64, salt: u32, frequency: impl Fn(f64) -> f64) -> Self {
        let of_axis = |axis: u32| {
            let random = |wave: u32, what: u32| {
                let key = (axis << 16) | (what << 12) | wave;
                f64::from(unit_hash(seed as u32, (seed >> 32) as u32, key ^ salt))
            };
            (0..count)
                .map(|wave| {
                    // One frequency from each of equally likely parts of the spectrum.
                    let part = (f64::from(wave) + random(wave, 0)) / f64::from(count);
                    (frequency(part), TAU * random(wave, 1))
                })
                .collect()
        };
        Self {
            axes: [of_axis(0), of_axis(1)],
        }
    }

    fn at(&self, time_s: f64) -> DVec2 {
        let along = |waves: &[(f64, f64)]| {
            let sum: f64 = waves
                .iter()
                .map(|(frequency, phase)| (frequency * time_s + phase).cos())
                .sum();
            sum * (2.0 / waves.len() as f64).sqrt()
        };
        let [right, down] = &self.axes;
        DVec2::new(along(right), along(down))
    }
}

#[cfg(test)]
mod tests;
