//! `[imaging]`: air, mast, sensor and stream between an ideal image and a real one. X-Plane lacks them; the stand-in can draw them, and the
//! stream is ours.
//!
//! A preset gives values to the keys that a sweep leaves out. Plans contain values only, whatever they come from.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use dataset::geometry::imaging::{Crosswind, Degradation, Imaging, Seeing, Sensor, Stream, Sway};
use dataset::numbers::limits;
use dataset::plan::PlannedCamera;
use rand::Rng;
use schemars::JsonSchema;
use serde::Deserialize;

use super::check::fault::{Checked, fault};
use super::check::limits::in_schema;
use crate::seed;
use crate::spread::Spread;

/// Correlation time of seeing without a stated time or wind.
const USUAL_CORRELATION_S: Spread = Spread::Fixed(0.05);

/// `[imaging]`: each value is a number or a spread to draw from; everything is off by default.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(extend("anyOf" = [
    { "required": ["preset"] },
    { "properties": { "sensor": { "required": ["full_well_electrons"] } } },
]))]
pub struct ImagingTable {
    /// Gives values to all keys of `[imaging]` that the sweep leaves out, except `refraction_coefficient`. `tower-camera` is a camera on a
    /// mast, by day.
    pub preset: Option<Preset>,
    /// Coefficient of terrestrial refraction, drawn per scenario: curvature of light over the earth's. 0, the default, is straight light;
    /// typically 0.13 by day.
    #[schemars(transform = in_schema(limits::REFRACTION_COEFFICIENT))]
    pub refraction_coefficient: Option<Spread>,
    /// Standard deviation of the optics' Gaussian blur, pixels, drawn per camera; 0 by default.
    #[schemars(transform = in_schema(limits::BLUR_SIGMA_PX))]
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
    /// Electrons per white pixel, drawn per camera: sets the noise of the light itself. Required without a preset.
    #[schemars(transform = in_schema(limits::FULL_WELL_ELECTRONS))]
    pub full_well_electrons: Option<Spread>,
    /// Standard deviation of the read noise, electrons, drawn per camera; 0 by default.
    #[schemars(transform = in_schema(limits::READ_NOISE_ELECTRONS))]
    pub read_noise_electrons: Option<Spread>,
    /// Exposure relative to an ideal image, stops, drawn per camera; 0 by default.
    #[schemars(transform = in_schema(limits::EXPOSURE_EV))]
    pub exposure_ev: Option<Spread>,
}

/// `[imaging.seeing]`
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SeeingTable {
    /// Root mean square of the aircraft's motion along one axis at 10 km, arcseconds, drawn per scenario; 0 by default.
    #[schemars(transform = in_schema(limits::TILT_RMS_ARCSEC))]
    pub tilt_rms_arcsec: Option<Spread>,
    /// Standard deviation of the blur at 10 km, arcseconds, drawn per scenario; 0 by default.
    #[schemars(transform = in_schema(limits::SEEING_BLUR_ARCSEC))]
    pub blur_sigma_arcsec: Option<Spread>,
    /// Time for the motion's correlation to fall to 1/e, seconds, drawn per scenario; 0.05 without a wind.
    #[schemars(transform = in_schema(limits::CORRELATION_S))]
    pub correlation_s: Option<Spread>,
    /// Wind across the line of sight that carries the turbulence along, m/s, drawn per scenario. Instead of `correlation_s`, with
    /// `aperture_m`.
    #[schemars(transform = in_schema(limits::CROSSWIND_MPS))]
    pub wind_mps: Option<Spread>,
    /// Aperture of the lens, metres, drawn per camera: the motion's power spectrum falls as f^(-2/3) up to 0.3 wind / aperture, and as
    /// f^(-11/3) beyond.
    #[schemars(transform = in_schema(limits::APERTURE_M))]
    pub aperture_m: Option<Spread>,
}

/// `[imaging.sway]`
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SwayTable {
    /// Root mean square of the image's motion along one axis, pixels, drawn per camera; 0 by default.
    #[schemars(transform = in_schema(limits::SWAY_RMS_PX))]
    pub rms_px: Option<Spread>,
    /// Natural frequency of the mast, hertz, drawn per camera; 1 by default.
    #[schemars(transform = in_schema(limits::SWAY_FREQUENCY_HZ))]
    pub frequency_hz: Option<Spread>,
}

/// `[imaging.stream]`
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct StreamTable {
    /// Bit rate of the camera at 30 images per second, Mbit/s, drawn per camera; 0, the default, is no stream.
    #[schemars(transform = in_schema(limits::STREAM_MBIT_PER_S))]
    pub mbit_per_s: Option<Spread>,
}

/// The presets, as tables `[imaging]` would have them.
static PRESETS: LazyLock<BTreeMap<Preset, toml::Table>> = LazyLock::new(|| {
    toml::from_str(include_str!("built_in_imaging.toml"))
        .expect("the presets are a part of the program, and a test reads them")
});

impl ImagingTable {
    /// Checks the values of the file and completes them by its preset. `own` is the table in the file.
    pub(super) fn checked(self, own: &toml::Table) -> Checked<Self> {
        self.check()?;
        let Some(preset) = self.preset else {
            return Ok(self);
        };
        let mut values = PRESETS[&preset].clone();
        let states_correlation = self
            .seeing
            .and_then(|seeing| seeing.correlation_s)
            .is_some();
        if let Some(toml::Value::Table(seeing)) = values.get_mut("seeing")
            && states_correlation
        {
            // A correlation time replaces the wind.
            seeing.retain(|key, _| !["wind_mps", "aperture_m"].contains(&key));
        }
        overlay(&mut values, own);
        values
            .try_into()
            .or_else(|error: toml::de::Error| fault("imaging", error.message()))
    }

    /// Draws a camera's image properties, its lens included.
    pub(crate) fn draw(&self, scenario_seed: u64, camera: &PlannedCamera) -> Imaging {
        let draw = |name: &str, spread: &Option<Spread>| {
            let spread = spread.as_ref()?;
            Some(spread.value(scenario_seed, &format!("imaging.{name}")))
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
}

/// Writes the sweep's `[imaging]` over a preset.
fn overlay(preset: &mut toml::Table, own: &toml::Table) {
    for (key, value) in own {
        match (preset.get_mut(key), value) {
            (Some(toml::Value::Table(section)), toml::Value::Table(own)) if is_section(key) => {
                overlay(section, own);
            }
            _ => {
                preset.insert(key.clone(), value.clone());
            }
        }
    }
}

/// True for the name of a nested table; other tables are spreads.
fn is_section(key: &str) -> bool {
    ["sensor", "seeing", "sway", "stream"].contains(&key)
}

#[cfg(test)]
mod tests;
