//! `[imaging]`: air, mast, sensor and stream between an ideal image and a real one. X-Plane has none of it; the stand-in can draw it, and
//! the stream is ours.
//!
//! A preset gives values to the keys that a sweep leaves out. Plans contain values only, whatever they come from.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use dataset::geometry::imaging::{Crosswind, Degradation, Imaging, Seeing, Sensor, Stream, Sway};
use dataset::numbers::limits::{self, Limits};
use dataset::plan::PlannedCamera;
use rand::Rng;
use schemars::JsonSchema;
use serde::Deserialize;

use super::check::fault::{Checked, fault};
use super::check::limits::Enforce;
use crate::seed;
use crate::spread::Spread;

/// Correlation time of a seeing that states no other course in time.
const USUAL_CORRELATION_S: Spread = Spread::Fixed(0.05);

/// `[imaging]`: each value is a number or a spread to draw from; everything is off by default.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(extend("anyOf" = [
    { "required": ["preset"] },
    { "properties": { "sensor": { "required": ["full_well_electrons"] } } },
]))]
pub struct ImagingTable {
    /// Gives values to all keys of these tables that the sweep leaves out, except `refraction_coefficient`. `tower-camera` is a camera on
    /// a mast, by day.
    pub preset: Option<Preset>,
    /// Coefficient of terrestrial refraction, drawn per scenario: curvature of light over the earth's. 0, the default, is straight light;
    /// typically 0.13 by day.
    #[schemars(transform = limits::REFRACTION_COEFFICIENT.in_schema())]
    pub refraction_coefficient: Option<Spread>,
    /// Standard deviation of the optics' Gaussian blur, pixels, drawn per camera; 0 by default.
    #[schemars(transform = limits::BLUR_SIGMA_PX.in_schema())]
    pub blur_sigma_px: Option<Spread>,
    /// Noise of the sensor.
    pub sensor: Option<SensorTable>,
    /// Turbulent air between aircraft and camera.
    pub seeing: Option<SeeingTable>,
    /// Sway of the mast.
    pub sway: Option<SwayTable>,
    /// The camera's own encoder, ahead of the corpus's.
    pub stream: Option<StreamTable>,
}

/// A set of values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Preset {
    /// A camera on a mast beside a runway.
    TowerCamera,
}

/// `[imaging.sensor]`
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SensorTable {
    /// Electrons of a white pixel, drawn per camera: sets the noise of the light itself. Required without a preset.
    #[schemars(transform = limits::FULL_WELL_ELECTRONS.in_schema())]
    pub full_well_electrons: Option<Spread>,
    /// Standard deviation of the read noise, electrons, drawn per camera; 0 by default.
    #[schemars(transform = limits::READ_NOISE_ELECTRONS.in_schema())]
    pub read_noise_electrons: Option<Spread>,
    /// Exposure relative to an ideal image, stops, drawn per camera; 0 by default.
    #[schemars(transform = limits::EXPOSURE_EV.in_schema())]
    pub exposure_ev: Option<Spread>,
}

/// `[imaging.seeing]`
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SeeingTable {
    /// Root mean square of the aircraft's motion along one axis at 10 km, arcseconds, drawn per scenario; 0 by default.
    #[schemars(transform = limits::TILT_RMS_ARCSEC.in_schema())]
    pub tilt_rms_arcsec: Option<Spread>,
    /// Standard deviation of the blur at 10 km, arcseconds, drawn per scenario; 0 by default.
    #[schemars(transform = limits::SEEING_BLUR_ARCSEC.in_schema())]
    pub blur_sigma_arcsec: Option<Spread>,
    /// Time in which the motion's correlation falls to 1/e, seconds, drawn per scenario; 0.05 without a wind.
    #[schemars(transform = limits::CORRELATION_S.in_schema())]
    pub correlation_s: Option<Spread>,
    /// Wind across the line of sight that carries the turbulence along, m/s, drawn per scenario. Instead of `correlation_s`, with
    /// `aperture_m`.
    #[schemars(transform = limits::CROSSWIND_MPS.in_schema())]
    pub wind_mps: Option<Spread>,
    /// Aperture of the lens, metres, drawn per camera: the motion's power spectrum falls as f^(-2/3) up to 0.3 wind / aperture, and as
    /// f^(-11/3) beyond.
    #[schemars(transform = limits::APERTURE_M.in_schema())]
    pub aperture_m: Option<Spread>,
}

/// `[imaging.sway]`
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SwayTable {
    /// Root mean square of the image's motion along one axis, pixels, drawn per camera; 0 by default.
    #[schemars(transform = limits::SWAY_RMS_PX.in_schema())]
    pub rms_px: Option<Spread>,
    /// Natural frequency of the mast, hertz, drawn per camera; 1 by default.
    #[schemars(transform = limits::SWAY_FREQUENCY_HZ.in_schema())]
    pub frequency_hz: Option<Spread>,
}

/// `[imaging.stream]`
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct StreamTable {
    /// Bit rate of the camera at 30 images per second, Mbit/s, drawn per camera; 0, the default, is no stream.
    #[schemars(transform = limits::STREAM_MBIT_PER_S.in_schema())]
    pub mbit_per_s: Option<Spread>,
}

static PRESETS: LazyLock<BTreeMap<Preset, ImagingTable>> = LazyLock::new(|| {
    toml::from_str(include_str!("built_in_imaging.toml"))
        .expect("the presets are a part of the program, and a test reads them")
});

impl ImagingTable {
    /// Checks what the file states and completes it by its preset.
    pub(super) fn checked(self) -> Checked<Self> {
        self.check()?;
        match self.preset {
            None => Ok(self),
            Some(preset) => Ok(self.over(&PRESETS[&preset])),
        }
    }

    /// Its own values, and those of a preset where it has none.
    fn over(self, preset: &Self) -> Self {
        Self {
            preset: self.preset,
            refraction_coefficient: either(
                self.refraction_coefficient,
                &preset.refraction_coefficient,
            ),
            blur_sigma_px: either(self.blur_sigma_px, &preset.blur_sigma_px),
            sensor: merged(self.sensor, &preset.sensor, SensorTable::over),
            seeing: merged(self.seeing, &preset.seeing, SeeingTable::over),
            sway: merged(self.sway, &preset.sway, SwayTable::over),
            stream: merged(self.stream, &preset.stream, StreamTable::over),
        }
    }

    /// The image properties of a camera in the scenario with this seed, its lens included.
    pub(crate) fn draw(&self, scenario_seed: u64, camera: &PlannedCamera) -> Imaging {
        let draw = |name: &str, spread: &Option<Spread>| {
            let spread = spread.as_ref()?;
            let mut random = seed::of_value(scenario_seed, &format!("imaging.{name}"));
            Some(spread.draw(&mut random))
        };
        let of_camera =
            |name: &str, spread: &Option<Spread>| draw(&format!("{}.{name}", camera.id), spread);
        let sensor = self.sensor.as_ref().and_then(|table| {
            Some(Sensor {
                full_well_electrons: of_camera("full_well_electrons", &table.full_well_electrons)?,
                read_noise_electrons: of_camera(
                    "read_noise_electrons",
                    &table.read_noise_electrons,
                )
                .unwrap_or(0.0),
                exposure_ev: of_camera("exposure_ev", &table.exposure_ev).unwrap_or(0.0),
            })
        });
        // Turbulence and wind belong to the air, their course in time to each camera.
        let seeing = self.seeing.as_ref().map(|table| {
            let crosswind = draw("wind_mps", &table.wind_mps)
                .zip(of_camera("aperture_m", &table.aperture_m))
                .map(|(wind_mps, aperture_m)| Crosswind {
                    wind_mps,
                    aperture_m,
                });
            let usual = || Some(USUAL_CORRELATION_S);
            let correlation = || table.correlation_s.clone().or_else(usual);
            Seeing {
                tilt_rms_arcsec: draw("tilt_rms_arcsec", &table.tilt_rms_arcsec).unwrap_or(0.0),
                blur_sigma_arcsec: draw("blur_sigma_arcsec", &table.blur_sigma_arcsec)
                    .unwrap_or(0.0),
                correlation_s: match crosswind {
                    None => draw("correlation_s", &correlation()),
                    Some(_) => None,
                },
                crosswind,
            }
        });
        let sway = self.sway.as_ref().and_then(|table| {
            Some(Sway {
                rms_px: of_camera("sway.rms_px", &table.rms_px).filter(|rms_px| *rms_px > 0.0)?,
                frequency_hz: of_camera("sway.frequency_hz", &table.frequency_hz).unwrap_or(1.0),
            })
        });
        let stream = self.stream.as_ref().and_then(|table| {
            let rate = of_camera("stream.mbit_per_s", &table.mbit_per_s);
            let mbit_per_s = rate.filter(|rate| *rate > 0.0)?;
            Some(Stream { mbit_per_s })
        });
        // 53 bits, like the seeds of scenarios: some languages read JSON numbers as floats.
        let seed =
            seed::of_value(scenario_seed, &format!("imaging.{}.seed", camera.id)).next_u64() >> 11;
        let degradation = Degradation {
            blur_sigma_px: of_camera("blur_sigma_px", &self.blur_sigma_px).unwrap_or(0.0),
            sensor,
            seeing,
            sway,
            stream,
            seed,
        };
        Imaging {
            distortion: camera.distortion,
            refraction_coefficient: draw("refraction_coefficient", &self.refraction_coefficient)
                .unwrap_or(0.0),
            degradation: (!degradation.is_none()).then_some(degradation),
        }
    }

    fn check(&self) -> Checked<()> {
        for (field, limits, spread) in self.values() {
            if let Some(spread) = spread {
                limits.check_spread(format!("imaging.{field}"), spread)?;
            }
        }
        let has_preset = self.preset.is_some();
        if let Some(table) = &self.sensor
            && table.full_well_electrons.is_none()
            && !has_preset
        {
            return fault(
                "imaging.sensor",
                "missing field `full_well_electrons`; expected a number of electrons, or a preset in [imaging]",
            );
        }
        let Some(table) = &self.seeing else {
            return Ok(());
        };
        let [wind, aperture] = [&table.wind_mps, &table.aperture_m].map(Option::is_some);
        if table.correlation_s.is_some() && (wind || aperture) {
            return fault(
                "imaging.seeing.correlation_s",
                "either correlation_s, or wind_mps and aperture_m, say how fast the air moves the aircraft; expected one of them",
            );
        }
        if wind != aperture && !has_preset {
            let (given, missing) = if wind {
                ("wind_mps", "aperture_m")
            } else {
                ("aperture_m", "wind_mps")
            };
            return fault(
                format!("imaging.seeing.{given}"),
                format!("{given} has no effect without {missing}; expected both"),
            );
        }
        Ok(())
    }

    /// All values of the tables that there are, with their keys and limits.
    fn values(&self) -> Vec<(&'static str, Limits, &Option<Spread>)> {
        let mut values = vec![
            (
                "refraction_coefficient",
                limits::REFRACTION_COEFFICIENT,
                &self.refraction_coefficient,
            ),
            ("blur_sigma_px", limits::BLUR_SIGMA_PX, &self.blur_sigma_px),
        ];
        if let Some(table) = &self.sensor {
            values.extend([
                (
                    "sensor.full_well_electrons",
                    limits::FULL_WELL_ELECTRONS,
                    &table.full_well_electrons,
                ),
                (
                    "sensor.read_noise_electrons",
                    limits::READ_NOISE_ELECTRONS,
                    &table.read_noise_electrons,
                ),
                (
                    "sensor.exposure_ev",
                    limits::EXPOSURE_EV,
                    &table.exposure_ev,
                ),
            ]);
        }
        if let Some(table) = &self.seeing {
            values.extend([
                (
                    "seeing.tilt_rms_arcsec",
                    limits::TILT_RMS_ARCSEC,
                    &table.tilt_rms_arcsec,
                ),
                (
                    "seeing.blur_sigma_arcsec",
                    limits::SEEING_BLUR_ARCSEC,
                    &table.blur_sigma_arcsec,
                ),
                (
                    "seeing.correlation_s",
                    limits::CORRELATION_S,
                    &table.correlation_s,
                ),
                ("seeing.wind_mps", limits::CROSSWIND_MPS, &table.wind_mps),
                ("seeing.aperture_m", limits::APERTURE_M, &table.aperture_m),
            ]);
        }
        if let Some(table) = &self.sway {
            values.extend([
                ("sway.rms_px", limits::SWAY_RMS_PX, &table.rms_px),
                (
                    "sway.frequency_hz",
                    limits::SWAY_FREQUENCY_HZ,
                    &table.frequency_hz,
                ),
            ]);
        }
        if let Some(table) = &self.stream {
            values.push((
                "stream.mbit_per_s",
                limits::STREAM_MBIT_PER_S,
                &table.mbit_per_s,
            ));
        }
        values
    }
}

impl SensorTable {
    fn over(self, preset: &Self) -> Self {
        Self {
            full_well_electrons: either(self.full_well_electrons, &preset.full_well_electrons),
            read_noise_electrons: either(self.read_noise_electrons, &preset.read_noise_electrons),
            exposure_ev: either(self.exposure_ev, &preset.exposure_ev),
        }
    }
}

impl SeeingTable {
    fn over(self, preset: &Self) -> Self {
        // A correlation time is another course in time than a wind.
        let has_course = self.correlation_s.is_some();
        let wind = |own, preset| {
            if has_course {
                None
            } else {
                either(own, preset)
            }
        };
        Self {
            tilt_rms_arcsec: either(self.tilt_rms_arcsec, &preset.tilt_rms_arcsec),
            blur_sigma_arcsec: either(self.blur_sigma_arcsec, &preset.blur_sigma_arcsec),
            wind_mps: wind(self.wind_mps, &preset.wind_mps),
            aperture_m: wind(self.aperture_m, &preset.aperture_m),
            correlation_s: self.correlation_s,
        }
    }
}

impl SwayTable {
    fn over(self, preset: &Self) -> Self {
        Self {
            rms_px: either(self.rms_px, &preset.rms_px),
            frequency_hz: either(self.frequency_hz, &preset.frequency_hz),
        }
    }
}

impl StreamTable {
    fn over(self, preset: &Self) -> Self {
        Self {
            mbit_per_s: either(self.mbit_per_s, &preset.mbit_per_s),
        }
    }
}

fn either(own: Option<Spread>, preset: &Option<Spread>) -> Option<Spread> {
    own.or_else(|| preset.clone())
}

fn merged<T: Clone + Default>(
    own: Option<T>,
    preset: &Option<T>,
    over: impl Fn(T, &T) -> T,
) -> Option<T> {
    match (own, preset) {
        (own, None) => own,
        (own, Some(preset)) => Some(over(own.unwrap_or_default(), preset)),
    }
}

#[cfg(test)]
mod tests;
