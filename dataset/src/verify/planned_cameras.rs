//! Compares `calibration.json` with `plan.json`: are the cameras placed, aimed and configured as planned?
//!
//! The plan has masts, the aim of a scenario, the placement error of each mast, and the lens, air and sensor; together they
//! determine each camera and the quality of its pictures. A calibration that is consistent with itself, the tables and the labels
//! may still be that of another rig.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::{Faults, close};
use crate::calibration::{Calibration, CameraEntry};
use crate::imaging::Imaging;
use crate::rig::{Aim, Jitter, Mast, place_in};
use crate::runway::Runway;
use crate::units::Degrees;

const PLAN: &str = "plan.json";
const CALIBRATION: &str = "calibration.json";
/// Trigonometry differs in its last digits between machines: nanometres on the earth's surface ...
const LENGTH_TOLERANCE_M: f64 = 1e-5;
/// ... and as much at the far end of a long lens.
const ANGLE_TOLERANCE_DEG: f64 = 1e-9;

/// What a plan states about the cameras of one scenario.
pub(super) struct PlannedCameras {
    runway: Runway,
    masts: Vec<Mast>,
    picture: Picture,
    aim: Option<Aim>,
    jitter: BTreeMap<String, Jitter>,
    imaging: BTreeMap<String, Imaging>,
}

#[derive(Deserialize)]
struct Picture {
    width_px: u32,
    height_px: u32,
}

impl PlannedCameras {
    /// Reads it. `shared`: what all scenarios have in common.
    ///
    /// # Errors
    /// What cannot be read, as text.
    pub(super) fn read<'a>(
        shared: impl Fn(&str) -> &'a Value,
        parameters: &Value,
    ) -> Result<Self, String> {
        Ok(Self {
            runway: part(shared("runway"), "runway")?,
            masts: part(shared("cameras"), "cameras")?,
            picture: part(shared("picture"), "picture")?,
            aim: part(&parameters["aim"], "aim")?,
            jitter: or_none(&parameters["jitter"], "jitter")?,
            imaging: or_none(&parameters["imaging"], "imaging")?,
        })
    }

    /// Compares the cameras of a scenario with it. Which cameras must exist is checked with `scenario.json`.
    pub(super) fn check(&self, id: &str, calibration: &Calibration, faults: &mut Faults) {
        for mast in &self.masts {
            let Some(found) = calibration.cameras.get(&mast.id) else {
                continue;
            };
            for difference in self.differences(mast, found) {
                let Difference {
                    what,
                    planned,
                    found,
                } = difference;
                faults.of_view(
                    id,
                    CALIBRATION,
                    &mast.id,
                    format!("{what} was planned as {planned} (plan.json), but recorded as {found}"),
                );
            }
        }
    }

    fn differences(&self, mast: &Mast, found: &CameraEntry) -> Vec<Difference> {
        let jitter = self.jitter.get(&mast.id).copied().unwrap_or_default();
        let planned = place_in(mast, &self.runway, self.aim, &jitter);
        let mut differences = Vec::new();
        let mut differs = |what, planned: String, found: String| {
            differences.push(Difference {
                what,
                planned,
                found,
            });
        };

        let Picture {
            width_px,
            height_px,
        } = self.picture;
        if (found.width_px, found.height_px) != (width_px, height_px) {
            differs(
                "size in pixels",
                format!("{width_px}x{height_px}"),
                format!("{}x{}", found.width_px, found.height_px),
            );
        }
        let [here, there] = [&planned.pose, &found.placed.pose].map(|pose| pose.position());
        if !close(
            here.to_ecef().distance(there.to_ecef()),
            0.0,
            LENGTH_TOLERANCE_M,
        ) {
            differs(
                "latitude_deg, longitude_deg, altitude_msl_m",
                format!(
                    "{}, {}, {}",
                    here.latitude_deg, here.longitude_deg, here.altitude_msl_m
                ),
                format!(
                    "{}, {}, {}",
                    there.latitude_deg, there.longitude_deg, there.altitude_msl_m
                ),
            );
        }
        let [a, b] = [&planned.pose, &found.placed.pose];
        for (what, planned, found) in [
            ("heading_true_deg", a.heading_true_deg, b.heading_true_deg),
            ("pitch_deg", a.pitch_deg, b.pitch_deg),
            ("roll_deg", a.roll_deg, b.roll_deg),
            ("hfov_deg", planned.hfov_deg, found.placed.hfov_deg),
        ] {
            let off_deg = Degrees(found - planned).wrapped_180().0;
            if !close(off_deg, 0.0, ANGLE_TOLERANCE_DEG) {
                differs(what, planned.to_string(), found.to_string());
            }
        }
        // Drawn numbers are copied, not computed.
        let planned = self.imaging.get(&mast.id).copied().unwrap_or_default();
        let recorded = found.imaging();
        if planned.distortion != recorded.distortion {
            let [a, b] = [planned.distortion, recorded.distortion].map(|lens| json(&lens));
            differs("distortion", a, b);
        }
        if planned.refraction_coefficient != recorded.refraction_coefficient {
            let [a, b] = [planned, recorded].map(|air| air.refraction_coefficient.to_string());
            differs("refraction_coefficient", a, b);
        }
        if planned.degradation != recorded.degradation {
            let [a, b] = [planned.degradation, recorded.degradation].map(|sensor| json(&sensor));
            differs("degradation", a, b);
        }
        differences
    }
}

struct Difference {
    what: &'static str,
    planned: String,
    found: String,
}

/// The plan itself cannot be used for the comparison.
pub(super) fn unreadable(id: &str, message: &str, faults: &mut Faults) {
    faults.of(
        id,
        PLAN,
        format!("its cameras cannot be compared with calibration.json: {message}"),
    );
}

fn part<T: DeserializeOwned>(value: &Value, what: &str) -> Result<T, String> {
    T::deserialize(value).map_err(|error| format!("{what} cannot be read: {error}"))
}

/// A map that is omitted if empty.
fn or_none<T: DeserializeOwned + Default>(value: &Value, what: &str) -> Result<T, String> {
    match value {
        Value::Null => Ok(T::default()),
        there => part(there, what),
    }
}

fn json(value: &impl serde::Serialize) -> String {
    serde_json::to_string(value).unwrap_or_else(|error| error.to_string())
}
