//! Labels, if there are any: distances recomputed from the poses, boxes where the camera sees the aircraft. The size of the aircraft is not
//! checked here: that is left to the pixels.

use std::collections::BTreeSet;

use glam::DVec2;

use crate::faults::{Faults, LENGTH_TOLERANCE_M, close};
use dataset::conditions::transmission;
use dataset::corpus::ScenarioFolder;
use dataset::corpus::calibration::Calibration;
use dataset::corpus::scenario::ScenarioRecord;
use dataset::geometry::pose::Pose;
use dataset::geometry::runway::RunwayCoordinates;
use dataset::numbers::limits;
use dataset::tables::aircraft::AircraftRow;
use dataset::tables::frames::{Frames, TickRow};
use dataset::tables::image_rows::ImageRow;
use dataset::tables::pixel_box::TruthBox;

/// Tolerance of recomputed times in seconds, and of recomputed shares.
const TIME_AND_SHARE_TOLERANCE: f64 = 1e-6;
/// A distance to touchdown may grow by this much between ticks before the target is passed, metres: hardly more than rounding.
const GROWTH_TOLERANCE_M: f64 = 0.01;

/// Checks a scenario's distances; returns whether it has any.
pub(super) fn check(record: &ScenarioRecord, frames: &Frames, faults: &mut Faults) -> bool {
    for (row, frame) in frames.rows.iter().enumerate() {
        check_row(record, row, frame, faults);
    }
    check_countdown(frames, faults);
    check_approach(frames, faults);
    is_labelled(frames)
}

fn is_labelled(frames: &Frames) -> bool {
    frames.rows.iter().any(|frame| frame.labels.is_some())
}

/// The ground-truth boxes, if there are any: they exist exactly if the distances do. All numbers outside their limits are faults.
pub(super) fn read_boxes(
    folder: &ScenarioFolder,
    frames: Option<&Frames>,
    most_boxes: Option<u64>,
    faults: &mut Faults,
) -> Option<Vec<TruthBox>> {
    let path = folder.truth_boxes_path();
    let boxes_exist = path.exists();
    if frames.is_some_and(Frames::is_recorded) && !boxes_exist {
        return None;
    }
    let labelled = frames.map_or(boxes_exist, is_labelled);
    if labelled != boxes_exist {
        let fault = if labelled {
            "the scenario has distances, but no ground-truth boxes; put the file back, or record the scenario again"
        } else {
            "the scenario has ground-truth boxes, but no distances; run `dtd label` again"
        };
        faults.file(ScenarioFolder::TRUTH_BOXES, fault);
    }
    let most_boxes = most_boxes.unwrap_or(limits::MAX_PICTURES);
    let boxes = boxes_exist.then(|| TruthBox::read_with_faults(&path, most_boxes))?;
    faults.keep_table(ScenarioFolder::TRUTH_BOXES, boxes)
}

fn check_row(record: &ScenarioRecord, row: usize, frame: &TickRow, faults: &mut Faults) {
    let Some(labels) = frame.labels else { return };
    let again = RunwayCoordinates::of(
        frame.pose.position(),
        record.touchdown,
        record.runway.course_true_deg,
    );
    let pairs = [
        ("dtd_m", labels.dtd_m, again.dtd_m),
        ("along_track_m", labels.along_track_m, again.along_track_m),
        ("cross_track_m", labels.cross_track_m, again.cross_track_m),
        (
            "height_over_target_m",
            labels.height_over_target_m,
            again.height_over_target_m,
        ),
    ];
    for (name, found, expected) in pairs {
        if !close(found, expected, LENGTH_TOLERANCE_M) {
            let message = format!("{name} is {found}, the pose gives {expected}");
            faults.row(ScenarioFolder::FRAMES, row, "label", message);
        }
    }
}

/// Time to touchdown is known for all ticks or for none, falls with the clock, and is 0 between the two ticks around the target.
fn check_countdown(frames: &Frames, faults: &mut Faults) {
    let left = |frame: &TickRow| frame.labels.and_then(|labels| labels.time_to_touchdown_s);
    for (row, pair) in frames.rows.windows(2).enumerate() {
        let [before, after] = pair else { continue };
        let row = row + 1;
        match (left(before), left(after)) {
            (None, None) => {}
            (Some(earlier), Some(later)) => {
                let step_s =
                    dataset::numbers::units::SimTime(after.time_ns.saturating_sub(before.time_ns))
                        .seconds();
                if !close(earlier - later, step_s, TIME_AND_SHARE_TOLERANCE) {
                    let message = format!(
                        "is {later}, expected {} from the row before",
                        earlier - step_s
                    );
                    faults.row(ScenarioFolder::FRAMES, row, "time_to_touchdown_s", message);
                }
                let passed = |frame: &TickRow| {
                    frame
                        .labels
                        .is_some_and(|labels| labels.along_track_m <= 0.0)
                };
                if !passed(before)
                    && passed(after)
                    && !(earlier >= 0.0 && later <= TIME_AND_SHARE_TOLERANCE)
                {
                    let message = format!(
                        "goes from {earlier} to {later} where the target is passed, expected 0 between"
                    );
                    faults.row(ScenarioFolder::FRAMES, row, "time_to_touchdown_s", message);
                }
            }
            _ => faults.row(
                ScenarioFolder::FRAMES,
                row,
                "time_to_touchdown_s",
                "is known for some rows only",
            ),
        }
    }
}

/// The distance falls until the target is passed.
fn check_approach(frames: &Frames, faults: &mut Faults) {
    for (row, pair) in frames.rows.windows(2).enumerate() {
        let [Some(before), Some(after)] = [pair[0].labels, pair[1].labels] else {
            continue;
        };
        let approaching = before.along_track_m > 0.0 && after.along_track_m > 0.0;
        if approaching && after.dtd_m > before.dtd_m + GROWTH_TOLERANCE_M {
            let message = format!(
                "grows from {} to {} before the target is passed",
                before.dtd_m, after.dtd_m
            );
            faults.row(ScenarioFolder::FRAMES, row + 1, "dtd_m", message);
        }
    }
}

/// Every box is inside its image and contains the aircraft's centre of gravity, and every centre of gravity in an image has one.
pub(super) fn check_boxes(
    record: &ScenarioRecord,
    (frames, rows): (&Frames, Option<&[AircraftRow]>),
    boxes: &[TruthBox],
    calibration: &Calibration,
    faults: &mut Faults,
) {
    const FILE: &str = ScenarioFolder::TRUTH_BOXES;
    // Without its table, other aircraft cannot be checked.
    let count = rows.map_or(1, |_| record.aircraft_count());
    let pose_of = |tick: usize, number: u32| -> Option<Pose> {
        match (number, rows) {
            (0, _) => Some(frames.rows.get(tick)?.pose),
            (_, Some(rows)) if number < count => {
                let row = rows.get(tick * count as usize + number as usize)?;
                Some(row.pose)
            }
            _ => None,
        }
    };
    let has_traffic = !record.traffic.is_empty();
    let mut boxed = BTreeSet::new();
    for (row, truth) in boxes.iter().enumerate() {
        let view = truth.view.as_str();
        let Some(camera) = calibration.cameras.get(view) else {
            let message = format!("{view} is not a camera of the scenario");
            faults.row(FILE, row, "view", message);
            continue;
        };
        if truth.tick as usize >= frames.rows.len() {
            let last = frames.rows.len().saturating_sub(1);
            let message = format!("is {}, but the last one is {last}", truth.tick);
            faults.view_row(view, FILE, row, "tick", message);
            continue;
        }
        let number = truth.number();
        if number >= record.aircraft_count() || truth.aircraft_number.is_some() != has_traffic {
            let found = truth.aircraft_number;
            let message = format!(
                "is {}, but scenario.json lists {} other aircraft",
                found.map_or("missing".into(), |number| number.to_string()),
                record.traffic.len()
            );
            faults.view_row(view, FILE, row, "aircraft_number", message);
            continue;
        }
        if !boxed.insert((truth.tick, view, number)) {
            let message = format!("is {}, which has a box already", truth.tick);
            faults.view_row(view, FILE, row, "tick", message);
        }
        check_box(row, truth, (camera.width_px, camera.height_px), faults);
        let camera = camera.camera();
        let Some(pose) = pose_of(truth.tick as usize, number) else {
            continue;
        };
        let centre_ecef_m = pose.position().to_ecef();
        let range_m = centre_ecef_m.distance(camera.center_ecef_m);
        let Some(weather) = record.weather() else {
            continue;
        };
        let transmission = transmission(range_m, weather.visibility_m);
        if !close(truth.transmission, transmission, TIME_AND_SHARE_TOLERANCE) {
            let message = format!(
                "is {}, distance and visibility give {transmission}",
                truth.transmission
            );
            faults.view_row(view, FILE, row, "transmission", message);
        }
        let centre = camera.project(centre_ecef_m);
        let holds = |at: DVec2| {
            let [left, top, right, bottom] = truth.pixel_box.edges();
            at.x >= left && at.x <= right && at.y >= top && at.y <= bottom
        };
        if truth.truncation == 0.0 && !centre.is_some_and(holds) {
            let message = format!(
                "{} is not around the aircraft's centre of gravity, which falls on {}",
                in_words(truth),
                centre.map_or("no pixel".into(), |at| format!(
                    "({:.1}, {:.1})",
                    at.x, at.y
                ))
            );
            faults.view_row(view, FILE, row, "box", message);
        }
    }
    let ticks = 0..frames.rows.len();
    let all = ticks.flat_map(|tick| (0..count).map(move |number| (tick, number)));
    for (tick, number) in all {
        let Some(pose) = pose_of(tick, number) else {
            continue;
        };
        for (view, camera) in &calibration.cameras {
            let camera = camera.camera();
            let seen = camera.project(pose.position().to_ecef()).is_some_and(|at| {
                at.x >= 0.0
                    && at.y >= 0.0
                    && at.x <= f64::from(camera.width_px - 1)
                    && at.y <= f64::from(camera.height_px - 1)
            });
            if seen && !boxed.contains(&(tick as u32, view.as_str(), number)) {
                let which = if number == 0 {
                    "the aircraft".to_owned()
                } else {
                    format!("aircraft {number}")
                };
                let message = format!("tick {tick} has {which} in the image, but no box");
                faults.view(FILE, view, message);
            }
        }
    }
}

fn in_words(truth: &TruthBox) -> String {
    let [left, top, right, bottom] = truth.pixel_box.edges();
    format!("the box from ({left:.1}, {top:.1}) to ({right:.1}, {bottom:.1})")
}

fn check_box(row: usize, truth: &TruthBox, size_px: (u32, u32), faults: &mut Faults) {
    const FILE: &str = ScenarioFolder::TRUTH_BOXES;
    let view = truth.view.as_str();
    let [left, top, right, bottom] = truth.pixel_box.edges();
    let (most_x, most_y) = (f64::from(size_px.0) - 0.5, f64::from(size_px.1) - 0.5);
    let slack = 1e-6;
    let inside = left >= -0.5 - slack
        && top >= -0.5 - slack
        && right <= most_x + slack
        && bottom <= most_y + slack;
    if !inside || truth.pixel_box.area() == 0.0 {
        let message = format!("{} is not inside the image", in_words(truth));
        faults.view_row(view, FILE, row, "box", message);
    }
}
