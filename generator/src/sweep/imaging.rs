//! `[imaging]`: air and sensor between an ideal picture and a real one. X-Plane has none of it; the stand-in can draw it.

use dataset::geometry::imaging::{Degradation, Imaging, Seeing, Sensor};
use dataset::numbers::limits;
use dataset::plan::PlannedCamera;
use rand::Rng;
use schemars::JsonSchema;
use serde::Deserialize;

use super::fault::Checked;
use super::limits::Enforce;
use crate::seed;
use crate::spread::Spread;

/// `[imaging]`: each value is a number or a spread to draw from; everything is off by default.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ImagingTable {
    /// Coefficient of terrestrial refraction, drawn per scenario: curvature of light over the earth's. 0, the default, is straight light;
    /// typically 0.13 by day.
    #[schemars(transform = limits::REFRACTION_COEFFICIENT.in_schema())]
    pub refraction_coefficient: Spread,
    /// Standard deviation of the optics' Gaussian blur, pixels, drawn per camera; 0 by default.
    #[schemars(transform = limits::BLUR_SIGMA_PX.in_schema())]
    pub blur_sigma_px: Spread,
    /// Noise of the sensor.
    pub sensor: Option<SensorTable>,
    /// Turbulent air between aircraft and camera.
    pub seeing: Option<SeeingTable>,
}

/// `[imaging.sensor]`
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SensorTable {
    /// Electrons of a white pixel, drawn per camera: sets the noise of the light itself.
    #[schemars(transform = limits::FULL_WELL_ELECTRONS.in_schema())]
    pub full_well_electrons: Spread,
    /// Standard deviation of the read noise, electrons, drawn per camera; 0 by default.
    #[serde(default)]
    #[schemars(transform = limits::READ_NOISE_ELECTRONS.in_schema())]
    pub read_noise_electrons: Spread,
}

/// `[imaging.seeing]`
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SeeingTable {
    /// Root mean square of the aircraft's motion along one axis at 10 km, arcseconds, drawn per scenario; 0 by default.
    #[schemars(transform = limits::TILT_RMS_ARCSEC.in_schema())]
    pub tilt_rms_arcsec: Spread,
    /// Standard deviation of the blur at 10 km, arcseconds, drawn per scenario; 0 by default.
    #[schemars(transform = limits::SEEING_BLUR_ARCSEC.in_schema())]
    pub blur_sigma_arcsec: Spread,
    /// Time in which the motion's correlation falls to 1/e, seconds, drawn per scenario; 0.05 by default.
    #[schemars(transform = limits::CORRELATION_S.in_schema())]
    pub correlation_s: Spread,
}

impl Default for SeeingTable {
    fn default() -> Self {
        Self {
            tilt_rms_arcsec: Spread::Fixed(0.0),
            blur_sigma_arcsec: Spread::Fixed(0.0),
            correlation_s: Spread::Fixed(0.05),
        }
    }
}

impl ImagingTable {
    /// The picture properties of a camera in the scenario with this seed, its lens included.
    pub(crate) fn draw(&self, scenario_seed: u64, camera: &PlannedCamera) -> Imaging {
        let draw = |name: &str, spread: &Spread| {
            spread.draw(&mut seed::of_value(
                scenario_seed,
                &format!("imaging.{name}"),
            ))
        };
        let of_camera =
            |name: &str, spread: &Spread| draw(&format!("{}.{name}", camera.id), spread);
        let blur_sigma_px = of_camera("blur_sigma_px", &self.blur_sigma_px);
        let sensor = self.sensor.as_ref().map(|table| Sensor {
            full_well_electrons: of_camera("full_well_electrons", &table.full_well_electrons),
            read_noise_electrons: of_camera("read_noise_electrons", &table.read_noise_electrons),
        });
        // The strength of turbulence belongs to the air, its course in time to each camera.
        let seeing = self.seeing.as_ref().map(|table| Seeing {
            tilt_rms_arcsec: draw("tilt_rms_arcsec", &table.tilt_rms_arcsec),
            blur_sigma_arcsec: draw("blur_sigma_arcsec", &table.blur_sigma_arcsec),
            correlation_s: draw("correlation_s", &table.correlation_s),
        });
        let spoiled = blur_sigma_px > 0.0 || sensor.is_some() || seeing.is_some();
        // 53 bits, like the seeds of scenarios: some languages read JSON numbers as floats.
        let seed =
            seed::of_value(scenario_seed, &format!("imaging.{}.seed", camera.id)).next_u64() >> 11;
        Imaging {
            distortion: camera.distortion,
            refraction_coefficient: draw("refraction_coefficient", &self.refraction_coefficient),
            degradation: spoiled.then_some(Degradation {
                blur_sigma_px,
                sensor,
                seeing,
                seed,
            }),
        }
    }

    pub(super) fn check(&self) -> Checked<()> {
        let mut checks = vec![
            (
                "refraction_coefficient",
                limits::REFRACTION_COEFFICIENT,
                &self.refraction_coefficient,
            ),
            ("blur_sigma_px", limits::BLUR_SIGMA_PX, &self.blur_sigma_px),
        ];
        if let Some(table) = &self.sensor {
            checks.extend([
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
            ]);
        }
        if let Some(table) = &self.seeing {
            checks.extend([
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
            ]);
        }
        for (field, limits, spread) in checks {
            limits.check_spread(format!("imaging.{field}"), spread)?;
        }
        Ok(())
    }
}
