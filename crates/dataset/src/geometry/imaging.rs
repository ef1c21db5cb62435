//! The differences between an ideal picture and a real one: lens, refraction and turbulence of the air, sensor.
//!
//! All of it is off by default, because X-Plane has none of it. Lens and refraction move objects, so they belong to the calibration
//! and every projection includes them. Blur, seeing and noise degrade the picture and leave the geometry alone.
//!
//! Only the stand-in can draw it; a simulator reports whether it can before a scenario is flown.

use serde::{Deserialize, Serialize};

use crate::geometry::distortion::Distortion;
use crate::numbers::limits::{self, Check};

/// Imaging properties of a camera.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Imaging {
    /// Distortion of the lens; `None` is a pinhole.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distortion: Option<Distortion>,
    /// Coefficient of terrestrial refraction; 0 is straight light.
    #[serde(skip_serializing_if = "is_zero")]
    pub refraction_coefficient: f64,
    /// Degradation of the picture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub degradation: Option<Degradation>,
}

/// Image degradation that does not affect geometry.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Degradation {
    /// Standard deviation of the optics' Gaussian point spread function, pixels.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub blur_sigma_px: f64,
    /// Noise of the sensor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensor: Option<Sensor>,
    /// Turbulence between aircraft and camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seeing: Option<Seeing>,
    /// Seed of noise and seeing: different for every scenario and view, below 2^53.
    pub seed: u64,
}

/// Sensor noise: Poisson noise of the light (as a Gaussian of the same variance) and read noise.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sensor {
    /// Electrons of a white pixel (255).
    pub full_well_electrons: f64,
    /// Standard deviation of the read noise, electrons.
    pub read_noise_electrons: f64,
}

/// Image motion and blur caused by turbulent air.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Seeing {
    /// Root mean square of the image's motion along one axis over 10 km, arcseconds; grows with the square root of the distance.
    pub tilt_rms_arcsec: f64,
    /// Standard deviation of the blur of one picture over 10 km, arcseconds; grows with the distance to the power 3/5.
    pub blur_sigma_arcsec: f64,
    /// The motion's autocorrelation falls to 1/e in this time, seconds.
    pub correlation_s: f64,
}

impl Imaging {
    /// Checks for numbers outside their limits. Whether a lens folds the picture over depends on the picture:
    /// [`Distortion::check`].
    pub fn check(&self, check: &mut Check) {
        check.number(
            "refraction_coefficient",
            self.refraction_coefficient,
            limits::REFRACTION_COEFFICIENT,
        );
        if let Some(degradation) = self.degradation {
            check.part("degradation", |check| degradation.check(check));
        }
    }

    /// True for ideal pictures of a pinhole in a vacuum, as X-Plane draws them.
    pub fn is_ideal(&self) -> bool {
        *self == Self::default()
    }
}

impl Degradation {
    fn check(&self, check: &mut Check) {
        check.number("blur_sigma_px", self.blur_sigma_px, limits::BLUR_SIGMA_PX);
        if let Some(Sensor {
            full_well_electrons,
            read_noise_electrons,
        }) = self.sensor
        {
            check.number(
                "sensor.full_well_electrons",
                full_well_electrons,
                limits::FULL_WELL_ELECTRONS,
            );
            check.number(
                "sensor.read_noise_electrons",
                read_noise_electrons,
                limits::READ_NOISE_ELECTRONS,
            );
        }
        if let Some(Seeing {
            tilt_rms_arcsec,
            blur_sigma_arcsec,
            correlation_s,
        }) = self.seeing
        {
            check.number(
                "seeing.tilt_rms_arcsec",
                tilt_rms_arcsec,
                limits::TILT_RMS_ARCSEC,
            );
            check.number(
                "seeing.blur_sigma_arcsec",
                blur_sigma_arcsec,
                limits::SEEING_BLUR_ARCSEC,
            );
            check.number("seeing.correlation_s", correlation_s, limits::CORRELATION_S);
        }
    }
}

pub(crate) fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_ideal_picture_is_an_empty_object_and_comes_back() {
        let text = serde_json::to_string(&Imaging::default()).unwrap();
        assert_eq!(text, "{}");
        assert!(serde_json::from_str::<Imaging>(&text).unwrap().is_ideal());
    }

    #[test]
    fn what_is_not_known_is_refused_rather_than_left_out() {
        assert!(serde_json::from_str::<Imaging>(r#"{"vignetting":0.2}"#).is_err());
    }
}
