//! Scenarios that no simulator made: image times, and boxes against the track.

use dataset::corpus::ScenarioFolder;
use dataset::corpus::calibration::Calibration;
use dataset::corpus::detections::models_of;
use dataset::corpus::scenario::ScenarioRecord;
use dataset::geometry::flight::state_at;
use dataset::geometry::pose::FlightState;
use dataset::numbers::units::SimTime;
use dataset::tables::frames::Frames;
use glam::DVec2;

use crate::faults::Faults;

const TABLE: &str = ScenarioFolder::FRAMES;
/// The track may pass a box by this part of its size, since both have errors.
const BESIDE: f64 = 1.0;
/// Nanoseconds by which rounding may move an image out of its period.
const ROUNDING_NS: i64 = 1;
const NOT_CHECKED: [&str; 2] = [
    "whether images show their ticks: recorded scenarios have no answers of a simulator, and no videos",
    "ground-truth boxes: recorded scenarios have none",
];

/// Names what cannot be asked of recorded scenarios.
pub(super) fn name_unchecked(not_checked: &mut Vec<String>) {
    for question in NOT_CHECKED {
        if !not_checked.iter().any(|known| known == question) {
            not_checked.push(question.to_owned());
        }
    }
}

pub(super) fn check(
    folder: &ScenarioFolder,
    record: &ScenarioRecord,
    (frames, calibration): (Option<&Frames>, Option<&Calibration>),
    faults: &mut Faults,
) {
    let Some(frames) = frames else { return };
    check_image_times(record, frames, faults);
    if let Some(calibration) = calibration {
        check_boxes(folder, frames, calibration, faults);
    }
}

/// Images are within half a period of their ticks, and in order.
fn check_image_times(record: &ScenarioRecord, frames: &Frames, faults: &mut Faults) {
    let half_ns = (record.frame_rate.period_s() * 0.5e9) as i64 + ROUNDING_NS;
    for (index, view) in frames.views.iter().enumerate() {
        let mut last_ns = i64::MIN;
        for (row, frame) in frames.rows.iter().enumerate() {
            let Some(image_ns) = frame.image_times_ns.get(index).copied().flatten() else {
                continue;
            };
            let off_ns = image_ns.saturating_sub(frame.time_ns).saturating_abs();
            if off_ns > half_ns {
                let message = format!(
                    "image_time_ns_{view} is {image_ns}, {off_ns} ns from the tick; expected at most {half_ns}, half a period"
                );
                faults.view_row(view, TABLE, row, "image of another tick", message);
            }
            if image_ns <= last_ns {
                let message =
                    format!("image_time_ns_{view} is {image_ns}, expected more than {last_ns}");
                faults.view_row(view, TABLE, row, "images out of order", message);
            }
            last_ns = image_ns;
        }
    }
}

/// Most confirmed boxes of a view are where the camera shows the track.
fn check_boxes(
    folder: &ScenarioFolder,
    frames: &Frames,
    calibration: &Calibration,
    faults: &mut Faults,
) {
    let states: Vec<FlightState> = (frames.rows.iter())
        .map(|row| FlightState {
            time_s: SimTime(row.time_ns).seconds(),
            pose: row.pose,
            velocity_north_mps: row.velocity_ned_mps[0],
            velocity_east_mps: row.velocity_ned_mps[1],
            velocity_down_mps: row.velocity_ned_mps[2],
            true_airspeed_mps: row.true_airspeed_mps,
            controls: row.controls,
            on_ground: row.on_ground,
        })
        .collect();
    // Faults of the folder and its tables are reported by the checks of detections.
    let Ok(scenario) = folder.open() else { return };
    for model in models_of(folder).unwrap_or_default() {
        let Ok(found) = scenario.detections(&model) else {
            continue;
        };
        for (index, view) in frames.views.iter().enumerate() {
            let Some(camera) = calibration.cameras.get(view).map(|entry| entry.camera()) else {
                continue;
            };
            let (mut boxes, mut around) = (0, 0);
            for seen in found
                .boxes
                .iter()
                .filter(|seen| seen.confirmed && seen.view == *view)
            {
                let row = frames.rows.get(seen.tick as usize);
                let image_ns = row.and_then(|row| row.image_times_ns.get(index).copied().flatten());
                let Some(state) = image_ns.and_then(|at| state_at(&states, SimTime(at).seconds()))
                else {
                    let message = format!("tick {} has a box, but no image", seen.tick);
                    faults.view(TABLE, view, message);
                    continue;
                };
                boxes += 1;
                let of = seen.pixel_box;
                let reach_px = DVec2::new(of.width_px, of.height_px) * (0.5 + BESIDE);
                let is_around = camera
                    .project(state.position_ecef())
                    .is_some_and(|place_px| {
                        let off_px = (place_px - DVec2::new(of.cx_px, of.cy_px)).abs();
                        off_px.cmple(reach_px).all()
                    });
                around += usize::from(is_around);
            }
            if 2 * around < boxes {
                let message = format!(
                    "{around} of {boxes} confirmed boxes are where the camera shows the track, expected at least half: is the camera or \
                     its clock wrong?"
                );
                faults.view(&format!("detections/{model}.parquet"), view, message);
            }
        }
    }
}
