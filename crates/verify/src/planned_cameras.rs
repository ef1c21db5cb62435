//! Compares `calibration.json` with `plan.json`: are the cameras placed, aimed and configured as planned?
//!
//! The plan has masts, a scenario's aim, the placement error of each mast, and the lens, air and sensor; together they determine each
//! camera and its image quality. A calibration that is consistent with itself, the tables and the labels may still belong to another rig.

use serde_json::json;

use crate::faults::{Faults, LENGTH_TOLERANCE_M, RELATIVE_TOLERANCE, close};
use dataset::corpus::calibration::{Calibration, CameraEntry};
use dataset::numbers::units::Degrees;

const CALIBRATION: &str = "calibration.json";

/// Compares a scenario's cameras with the planned ones. The set of cameras is checked with `scenario.json`.
pub(super) fn check(
    id: &str,
    planned: &[(String, CameraEntry)],
    calibration: &Calibration,
    faults: &mut Faults,
) {
    for (view, planned) in planned {
        if let Some(found) = calibration.cameras.get(view) {
            compare(planned, found, |what, planned, found| {
                let message =
                    format!("{what} was planned as {planned} (plan.json), but recorded as {found}");
                faults.of_view(id, CALIBRATION, view, message);
            });
        }
    }
}

fn compare(
    planned: &CameraEntry,
    found: &CameraEntry,
    mut differs: impl FnMut(&str, String, String),
) {
    if (found.width_px, found.height_px) != (planned.width_px, planned.height_px) {
        let [a, b] = [planned, found].map(|c| format!("{}x{}", c.width_px, c.height_px));
        differs("size in pixels", a, b);
    }
    let [here, there] = [planned, found].map(|camera| camera.placed.pose.position());
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
    let [planned, recorded] = [planned, found].map(CameraEntry::imaging);
    if planned.distortion != recorded.distortion {
        let [a, b] = [planned.distortion, recorded.distortion].map(|lens| json!(lens).to_string());
        differs("distortion", a, b);
    }
    if planned.refraction_coefficient != recorded.refraction_coefficient {
        let [a, b] = [planned, recorded].map(|air| air.refraction_coefficient.to_string());
        differs("refraction_coefficient", a, b);
    }
    if planned.degradation != recorded.degradation {
        let [a, b] =
            [planned.degradation, recorded.degradation].map(|sensor| json!(sensor).to_string());
        differs("degradation", a, b);
    }
}
