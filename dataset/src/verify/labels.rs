//! Labels, where there are some: distances computed again from the poses, boxes inside their pictures.

use super::{Faults, close};
use crate::calibration::Calibration;
use crate::corpus::ScenarioFolder;
use crate::frames::{Frame, Frames};
use crate::pixel_box::TruthBox;
use crate::runway::RunwayCoordinates;
use crate::scenario::ScenarioRecord;

/// Labels agree with a second computation on another machine to far below this, metres.
const LENGTH_TOLERANCE_M: f64 = 1e-4;
/// Time to touchdown runs down with the clock to below this, seconds.
const TIME_TOLERANCE_S: f64 = 1e-6;

/// Checks the labels of a scenario; returns whether it has some.
pub(super) fn check(
    folder: &ScenarioFolder,
    record: &ScenarioRecord,
    frames: &Frames,
    calibration: Option<&Calibration>,
    faults: &mut Faults,
) -> bool {
    let labelled = frames.rows.iter().any(|frame| frame.labels.is_some());
    for (row, frame) in frames.rows.iter().enumerate() {
        check_row(record, row, frame, faults);
    }
    check_countdown(frames, faults);
    let boxes_exist = folder.truth_boxes_path().exists();
    if labelled != boxes_exist {
        let (there, missing) = if labelled {
            ("distances", "no true boxes")
        } else {
            ("true boxes", "no distances")
        };
        faults.file(
            ScenarioFolder::TRUTH_BOXES,
            format!("the scenario has {there}, but {missing}; run `dtd label` again"),
        );
    }
    if boxes_exist
        && let Some(boxes) = faults.keep(ScenarioFolder::TRUTH_BOXES, folder.truth_boxes())
        && let Some(calibration) = calibration
    {
        check_boxes(record, &boxes, calibration, faults);
    }
    labelled
}

fn check_row(record: &ScenarioRecord, row: usize, frame: &Frame, faults: &mut Faults) {
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
    let left = |frame: &Frame| frame.labels.and_then(|labels| labels.time_to_touchdown_s);
    for (row, pair) in frames.rows.windows(2).enumerate() {
        let [before, after] = pair else { continue };
        let row = row + 1;
        match (left(before), left(after)) {
            (None, None) => {}
            (Some(earlier), Some(later)) => {
                let step_s = crate::units::SimTime(after.time_ns - before.time_ns).seconds();
                if !close(earlier - later, step_s, TIME_TOLERANCE_S) {
                    let message = format!(
                        "is {later}, expected {} from the row before",
                        earlier - step_s
                    );
                    faults.row(ScenarioFolder::FRAMES, row, "time_to_touchdown_s", message);
                }
                let passed = |frame: &Frame| {
                    frame
                        .labels
                        .is_some_and(|labels| labels.along_track_m <= 0.0)
                };
                if !passed(before)
                    && passed(after)
                    && !(earlier >= 0.0 && later <= TIME_TOLERANCE_S)
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

fn check_boxes(
    record: &ScenarioRecord,
    boxes: &[TruthBox],
    calibration: &Calibration,
    faults: &mut Faults,
) {
    const FILE: &str = ScenarioFolder::TRUTH_BOXES;
    for (row, truth) in boxes.iter().enumerate() {
        let Some(camera) = calibration.cameras.get(&truth.view) else {
            faults.row(
                FILE,
                row,
                "view",
                format!("{} is no camera of the scenario", truth.view),
            );
            continue;
        };
        if truth.tick >= record.ticks {
            faults.row(
                FILE,
                row,
                "tick",
                format!(
                    "is {}, but the last one is {}",
                    truth.tick,
                    record.ticks.saturating_sub(1)
                ),
            );
        }
        let [left, top, right, bottom] = truth.pixel_box.edges();
        let (most_x, most_y) = (
            f64::from(camera.width_px) - 0.5,
            f64::from(camera.height_px) - 0.5,
        );
        let slack = 1e-6;
        let inside = left >= -0.5 - slack
            && top >= -0.5 - slack
            && right <= most_x + slack
            && bottom <= most_y + slack;
        if !inside || truth.pixel_box.area() == 0.0 {
            faults.row(
                FILE,
                row,
                "box",
                format!("{:?} is not a box inside the picture", truth.pixel_box),
            );
        }
        for (name, value) in [
            ("visible_fraction", truth.visible_fraction),
            ("truncation", truth.truncation),
            ("transmission", truth.transmission),
        ] {
            if !(0.0..=1.0).contains(&value) {
                faults.row(FILE, row, name, format!("is {value}, expected 0 to 1"));
            }
        }
    }
}
