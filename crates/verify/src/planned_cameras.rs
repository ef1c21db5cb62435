//! Compares `calibration.json` with `plan.json`: are the cameras placed, aimed and configured as planned?
//!
//! The plan has masts, a scenario's aim, the placement error of each mast, and the lens, air and sensor; together they determine each
//! camera and its image quality. A calibration that is consistent with itself, the tables and the labels may still belong to another rig.

use std::collections::BTreeMap;

use super::plan_as_written::{CommonAsWritten, ParametersAsWritten, Unreadable};
use crate::faults::{Faults, LENGTH_TOLERANCE_M, RELATIVE_TOLERANCE, close};
use dataset::corpus::calibration::{Calibration, CameraEntry};
use dataset::geometry::imaging::Imaging;
use dataset::geometry::runway::Runway;
use dataset::numbers::units::Degrees;
use dataset::plan::{Aim, Jitter, Picture, PlannedCamera};

const CALIBRATION: &str = "calibration.json";

/// A plan's statements about a scenario's cameras.
pub(super) struct PlannedCameras<'a> {
    runway: &'a Runway,
    cameras: &'a [PlannedCamera],
    picture: Picture,
    aim: Option<Aim>,
    jitter: &'a Option<BTreeMap<String, Jitter>>,
    imaging: &'a Option<BTreeMap<String, Imaging>>,
}

impl<'a> PlannedCameras<'a> {
    /// Reads it.
    ///
    /// # Errors
    /// A part cannot be read.
    pub(super) fn read(
        common: &'a CommonAsWritten,
        parameters: &'a ParametersAsWritten,
    ) -> Result<Self, Unreadable<'a>> {
        Ok(Self {
            runway: common.runway.read("runway")?,
            cameras: common.cameras.read("cameras")?,
            picture: *common.picture.read("picture")?,
            aim: *parameters.aim.read("aim")?,
            jitter: parameters.jitter.read("jitter")?,
            imaging: parameters.imaging.read("imaging")?,
        })
    }

    /// Compares a scenario's cameras with it. The set of cameras is checked with `scenario.json`.
    pub(super) fn check(&self, id: &str, calibration: &Calibration, faults: &mut Faults) {
        for camera in self.cameras {
            if let Some(found) = calibration.cameras.get(&camera.id) {
                self.compare(camera, found, |what, planned: String, found: String| {
                    let message = format!(
                        "{what} was planned as {planned} (plan.json), but recorded as {found}"
                    );
                    faults.of_view(id, CALIBRATION, &camera.id, message);
                });
            }
        }
    }

    /// Reports what differs: its name, the planned and the found value.
    fn compare(
        &self,
        camera: &PlannedCamera,
        found: &CameraEntry,
        mut differs: impl FnMut(&str, String, String),
    ) {
        let (jitter, imaging) = (drawn(self.jitter, camera), drawn(self.imaging, camera));
        let planned = camera.calibrated(self.runway, self.picture, self.aim, &jitter, &imaging);
        if (found.width_px, found.height_px) != (planned.width_px, planned.height_px) {
            let [a, b] = [&planned, found].map(|c| format!("{}x{}", c.width_px, c.height_px));
            differs("size in pixels", a, b);
        }
        let [here, there] = [&planned, found].map(|camera| camera.placed.pose.position());
        if !close(
            here.to_ecef().distance(there.to_ecef()),
            0.0,
            LENGTH_TOLERANCE_M,
        ) {
            let [a, b] = [here, there].map(|at| {
                let (latitude_deg, longitude_deg) = (at.latitude_deg, at.longitude_deg);
                format!("{latitude_deg}, {longitude_deg}, {}", at.altitude_msl_m)
            });
            differs("latitude_deg, longitude_deg, altitude_msl_m", a, b);
        }
        let [a, b] = [&planned.placed, &found.placed];
        for (what, planned, found) in [
            (
                "heading_true_deg",
                a.pose.heading_true_deg,
                b.pose.heading_true_deg,
            ),
            ("pitch_deg", a.pose.pitch_deg, b.pose.pitch_deg),
            ("roll_deg", a.pose.roll_deg, b.pose.roll_deg),
            ("hfov_deg", a.hfov_deg, b.hfov_deg),
        ] {
            let off_deg = Degrees(found - planned).wrapped_180().0;
            if !close(off_deg.to_radians(), 0.0, RELATIVE_TOLERANCE) {
                differs(what, planned.to_string(), found.to_string());
            }
        }
        // Drawn numbers are copied, not computed.
        let [planned, recorded] = [imaging, found.imaging()];
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
    }
}

/// The value drawn for a camera, or the default if none was drawn.
fn drawn<T: Copy + Default>(of_each: &Option<BTreeMap<String, T>>, camera: &PlannedCamera) -> T {
    let drawn = of_each.as_ref().and_then(|of_each| of_each.get(&camera.id));
    drawn.copied().unwrap_or_default()
}

fn json(value: &impl serde::Serialize) -> String {
    serde_json::to_string(value).unwrap_or_else(|error| error.to_string())
}
