//! The differences between an ideal image and a real one: lens, refraction and turbulence of the air, mast, sensor, the camera's encoder.
//!
//! Everything is off by default, because X-Plane draws ideal images. Lens and refraction move objects, so they belong to the calibration
//! and every projection includes them. The others degrade the image: calibration and ground-truth boxes assume still air and a still mast.
//!
//! Only the stand-in can draw it; a simulator reports whether it can before a scenario is flown. The camera's encoder is ours, so its
//! stream is available with every simulator.

pub mod image_motion;

use serde::{Deserialize, Serialize};

use crate::geometry::distortion::Distortion;
use crate::numbers::limits::{self, Check, check_fields};

/// Imaging properties of the camera.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Imaging {
    /// Distortion of the lens; `None` is a pinhole.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distortion: Option<Distortion>,
    /// Coefficient of terrestrial refraction; 0 is straight light.
    #[serde(skip_serializing_if = "is_zero")]
    pub refraction_coefficient: f64,
    /// Degradation of the image.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub degradation: Option<Degradation>,
}

/// Image degradation that does not affect the calibration.
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
    /// Sway of the mast.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sway: Option<Sway>,
    /// The camera's own encoder, ahead of the corpus's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stream: Option<Stream>,
    /// Seed of noise, seeing and sway: different for every scenario and view, below 2^53.
    pub seed: u64,
}

/// Sensor noise: Poisson noise of the light (as a Gaussian of the same variance) and read noise.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sensor {
    /// Electrons per white pixel (255).
    pub full_well_electrons: f64,
    /// Standard deviation of the read noise, electrons.
    pub read_noise_electrons: f64,
    /// Exposure relative to an ideal image, stops: 1 doubles the light.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub exposure_ev: f64,
}

/// Image motion and blur caused by turbulent air.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Seeing {
    /// Root mean square of the image's motion along one axis over 10 km, arcseconds; grows with the square root of the distance.
    pub tilt_rms_arcsec: f64,
    /// Standard deviation of an image's blur over 10 km, arcseconds; grows with the distance to the power 3/5.
    pub blur_sigma_arcsec: f64,
    /// The motion's autocorrelation falls to 1/e in this time, seconds. Either this or `crosswind`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub correlation_s: Option<f64>,
    /// Air that is blown across the line of sight.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crosswind: Option<Crosswind>,
}

/// Turbulence that is blown across the line of sight as it is: the power spectrum of the motion falls as f^(-2/3) up to a knee, and as
/// f^(-11/3) beyond.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Crosswind {
    /// Wind speed, metres per second.
    pub wind_mps: f64,
    /// Aperture of the lens, metres.
    pub aperture_m: f64,
}

/// Motion of the whole image, because the mast sways.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sway {
    /// Root mean square along one axis of the image, pixels.
    pub rms_px: f64,
    /// Natural frequency of the mast, hertz.
    pub frequency_hz: f64,
}

/// A rate-controlled video stream from camera to recorder.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stream {
    /// Bit rate at the camera's image rate, Mbit/s.
    pub mbit_per_s: f64,
}

impl Crosswind {
    /// Frequency of the knee, hertz; [`image_motion`] has its source.
    pub fn knee_hz(&self) -> f64 {
        0.3 * self.wind_mps / self.aperture_m
    }
}

impl Imaging {
    /// Checks for numbers outside their limits. Whether a lens folds the image over depends on the image: [`Distortion::check`].
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

    /// The part that a simulator has to draw: all but the camera's stream.
    #[must_use]
    pub fn drawn(self) -> Self {
        let without_stream = |degradation: Degradation| Degradation {
            stream: None,
            ..degradation
        };
        Self {
            degradation: (self.degradation.map(without_stream))
                .filter(|degradation| !degradation.is_none()),
            ..self
        }
    }

    /// True for ideal pinhole images in a vacuum, as X-Plane draws them.
    pub fn is_ideal(&self) -> bool {
        *self == Self::default()
    }
}

impl Degradation {
    /// True if it changes no image.
    pub fn is_none(&self) -> bool {
        let Self {
            blur_sigma_px,
            sensor,
            seeing,
            sway,
            stream,
            seed: _,
        } = self;
        *blur_sigma_px == 0.0
            && sensor.is_none()
            && seeing.is_none()
            && sway.is_none()
            && stream.is_none()
    }

    fn check(&self, check: &mut Check) {
        check_fields!(check, self, { blur_sigma_px: limits::BLUR_SIGMA_PX });
        if let Some(sensor) = self.sensor {
            check.part("sensor", |check| {
                check_fields!(check, sensor, {
                    exposure_ev: limits::EXPOSURE_EV,
                    full_well_electrons: limits::FULL_WELL_ELECTRONS,
                    read_noise_electrons: limits::READ_NOISE_ELECTRONS,
                });
            });
        }
        if let Some(seeing) = self.seeing {
            check.part("seeing", |check| {
                check_fields!(check, seeing, {
                    tilt_rms_arcsec: limits::TILT_RMS_ARCSEC,
                    blur_sigma_arcsec: limits::SEEING_BLUR_ARCSEC,
                });
                match seeing.crosswind {
                    Some(crosswind) => check.part("crosswind", |check| {
                        check_fields!(check, crosswind, {
                            wind_mps: limits::CROSSWIND_MPS,
                            aperture_m: limits::APERTURE_M,
                        });
                    }),
                    // NaN, a number that is in no range, if both are missing.
                    None => check.number(
                        "correlation_s",
                        seeing.correlation_s.unwrap_or(f64::NAN),
                        limits::CORRELATION_S,
                    ),
                }
            });
        }
        if let Some(sway) = self.sway {
            check.part("sway", |check| {
                check_fields!(check, sway, {
                    rms_px: limits::SWAY_RMS_PX,
                    frequency_hz: limits::SWAY_FREQUENCY_HZ,
                });
            });
        }
        if let Some(Stream { mbit_per_s }) = self.stream {
            check.number("stream.mbit_per_s", mbit_per_s, limits::STREAM_MBIT_PER_S);
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
    fn what_a_simulator_draws_lacks_the_stream_and_a_stream_alone_leaves_ideal_pictures() {
        let stream = Some(Stream { mbit_per_s: 6.0 });
        let of = |degradation| Imaging {
            degradation: Some(degradation),
            ..Imaging::default()
        };
        let only = of(Degradation {
            stream,
            seed: 3,
            ..Degradation::default()
        });
        assert!(!only.is_ideal() && only.drawn().is_ideal());
        let blurred = Degradation {
            blur_sigma_px: 0.7,
            seed: 3,
            ..Degradation::default()
        };
        let both = of(Degradation { stream, ..blurred });
        assert_eq!(both.drawn(), of(blurred));
    }

    #[test]
    fn a_seeing_without_any_course_in_time_is_out_of_limits_and_that_of_older_files_reads_as_before()
     {
        let faults = |text: &str| {
            let mut check = Check::default();
            serde_json::from_str::<Imaging>(text)
                .unwrap()
                .check(&mut check);
            check.first().map(|fault| fault.to_string())
        };
        let seeing = |more: &str| {
            format!(
                r#"{{"degradation":{{"seeing":{{"tilt_rms_arcsec":5.0,"blur_sigma_arcsec":0.0{more}}},"seed":1}}}}"#
            )
        };
        let text = seeing(r#","correlation_s":0.05"#);
        assert_eq!(faults(&text), None);
        let back: Imaging = serde_json::from_str(&text).unwrap();
        assert_eq!(serde_json::to_string(&back).unwrap(), text);
        let fault = faults(&seeing("")).unwrap();
        assert!(
            fault.contains("degradation.seeing.correlation_s"),
            "{fault}"
        );
        let still = seeing(r#","crosswind":{"wind_mps":0.0,"aperture_m":0.05}"#);
        assert!(faults(&still).unwrap().contains("wind_mps"));
    }

    #[test]
    fn what_is_not_known_is_refused_rather_than_left_out() {
        assert!(serde_json::from_str::<Imaging>(r#"{"vignetting":0.2}"#).is_err());
    }
}
