//! `scenario.json` and `calibration.json`: are they valid, and do they agree with each other?

use glam::DMat3;

use crate::faults::{Faults, LENGTH_TOLERANCE_M, RELATIVE_TOLERANCE, close};
use dataset::corpus::ScenarioFolder;
use dataset::corpus::calibration::{Calibration, CameraEntry};
use dataset::corpus::scenario::{
    MARKED_SCHEMA_VERSION, PINHOLE_SCHEMA_VERSION, RECORDED_SCHEMA_VERSION, SCHEMA_VERSION,
    ScenarioRecord, TRAFFIC_SCHEMA_VERSION,
};
use dataset::corpus::seal;
use dataset::geometry::runway::RunwayCoordinates;

const RECORD: &str = "scenario.json";
const CALIBRATION: &str = "calibration.json";

/// Reads `scenario.json`; all numbers outside their limits are faults.
pub(super) fn read(folder: &ScenarioFolder, faults: &mut Faults) -> Option<ScenarioRecord> {
    let read = ScenarioRecord::read_with_faults(&folder.record_path());
    faults.keep_with(RECORD, read)
}

/// Reads `calibration.json`; all numbers outside their limits are faults.
pub(super) fn read_calibration(
    folder: &ScenarioFolder,
    faults: &mut Faults,
) -> Option<Calibration> {
    let read = Calibration::read_with_faults(&folder.calibration_path());
    faults.keep_with(CALIBRATION, read)
}

pub(super) fn check(folder: &ScenarioFolder, record: &ScenarioRecord, faults: &mut Faults) {
    let folder_id = folder.id();
    if record.id != folder_id {
        faults.file(
            RECORD,
            format!(
                "id is {}, expected {folder_id}, the name of the folder",
                record.id
            ),
        );
    }
    let known = PINHOLE_SCHEMA_VERSION..=SCHEMA_VERSION;
    if !known.contains(&record.schema_version) {
        faults.file(
            RECORD,
            format!(
                "schema version is {}, expected {PINHOLE_SCHEMA_VERSION} to {SCHEMA_VERSION}",
                record.schema_version
            ),
        );
    }
    if let Some(Some(seal)) = faults.keep(seal::DONE, folder.seal())
        && seal.config_hash != record.config_hash
    {
        faults.file(
            seal::DONE,
            format!(
                "config_hash is {}, but scenario.json has {}",
                seal.config_hash, record.config_hash
            ),
        );
    }
    if let (Some(effective), Some(weather)) = (&record.effective_weather, record.weather())
        && let Some(what) = effective.contradiction(weather)
    {
        faults.file(
            RECORD,
            format!("effective_weather contradicts itself: {what}"),
        );
    }
    if record.recorded.is_some() && record.schema_version < RECORDED_SCHEMA_VERSION {
        let found = record.schema_version;
        faults.file(
            RECORD,
            format!("schema version is {found}, but the scenario is recorded; expected {RECORDED_SCHEMA_VERSION}"),
        );
    } else if record.required_version(PINHOLE_SCHEMA_VERSION) > record.schema_version {
        let found = record.schema_version;
        let (expected, why) = if record.traffic.is_empty() {
            let why = "the weather at the aircraft differs from the planned one";
            (MARKED_SCHEMA_VERSION, why)
        } else {
            (TRAFFIC_SCHEMA_VERSION, "the scenario has several aircraft")
        };
        faults.file(
            RECORD,
            format!(
                "schema version is {found}, but {why}, which readers of {found} would overlook; expected {expected}"
            ),
        );
    }
    let target = record.runway.touchdown_target();
    let off_m = target.to_ecef().distance(record.touchdown.to_ecef());
    if !close(off_m, 0.0, LENGTH_TOLERANCE_M) {
        faults.file(
            RECORD,
            format!("touchdown is {off_m:.3} m from {target:?}, where threshold, course and distance of the runway put it"),
        );
    }
    if let Some(touched) = record.flight_touchdown {
        let place = RunwayCoordinates::of(touched, record.touchdown, record.runway.course_true_deg);
        if !place.may_be_touchdown() {
            faults.file(
                RECORD,
                format!(
                    "flight_touchdown is {:.0} m from the target and {:.0} m beside the centreline: not on the runway",
                    place.dtd_m, place.cross_track_m
                ),
            );
        }
    }
}

pub(super) fn check_calibration(
    record: &ScenarioRecord,
    calibration: &Calibration,
    faults: &mut Faults,
) {
    let mut expected = record.views.clone();
    expected.sort();
    let found: Vec<&String> = calibration.cameras.keys().collect();
    if found != expected.iter().collect::<Vec<_>>() {
        faults.file(
            CALIBRATION,
            format!("has cameras {found:?}, but scenario.json has views {expected:?}"),
        );
    }
    if calibration.schema_version() > record.schema_version {
        let (found, expected) = (record.schema_version, calibration.schema_version());
        faults.file(
            RECORD,
            format!(
                "schema version is {found}, but calibration.json has cameras that distort or light that bends, which readers of {found} \
                 would overlook; expected {expected}"
            ),
        );
    }
    for (id, entry) in &calibration.cameras {
        if let Some(fault) = entry.fault() {
            faults.file(CALIBRATION, format!("camera {id} {fault}"));
        }
        if let Some(what) = difference(entry, record.recorded.is_some()) {
            faults.file(
                CALIBRATION,
                format!("camera {id}: {what} does not follow from where it was placed"),
            );
        }
    }
}

/// Name of the entry's part that does not follow from the placement. The principal point of a real camera is anywhere.
fn difference(entry: &CameraEntry, is_recorded: bool) -> Option<&'static str> {
    let again = CameraEntry::from_pose(entry.placed, entry.width_px, entry.height_px);
    let [ours, theirs] = [&again, entry].map(|entry| entry.camera());
    let rotations =
        [ours.ecef_from_camera, theirs.ecef_from_camera].map(|r: DMat3| r.to_cols_array());
    let turned = rotations[0]
        .iter()
        .zip(&rotations[1])
        .any(|(a, b)| !close(*a, *b, RELATIVE_TOLERANCE));
    let intrinsics = again.k.iter().flatten().zip(entry.k.iter().flatten());
    let mut scaled =
        intrinsics.map(|(a, b)| (a - b).abs() <= RELATIVE_TOLERANCE * a.abs().max(1.0));
    if !close(
        ours.center_ecef_m.distance(theirs.center_ecef_m),
        0.0,
        LENGTH_TOLERANCE_M,
    ) {
        Some("translation_m")
    } else if turned {
        Some("rotation")
    } else if !is_recorded && !scaled.all(|same| same) {
        Some("k")
    } else {
        None
    }
}
