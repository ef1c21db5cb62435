//! Stated cameras that contradict the boxes.

use sight::sight::CERTAIN_SD;

use super::TrainingCameras;
use super::camera_fit::CameraFit;

/// Minimum reported differences: degrees, percent and metres. Box centres are some metres away from the labelled point: in the
/// corpus of `dtd paper --frame-rate 2`, whose cameras are true, a fitted camera is 10 m off along the approach.
const MIN_TURN_DEG: f64 = 0.05;
const MIN_FOCAL_PCT: f64 = 1.0;
const MIN_MOVE_M: f64 = 15.0;

/// Training message about these views. `registered_again`: the views are registered with fitted cameras.
pub(super) fn contradictions_line(found: &[String], registered_again: bool) -> String {
    let effect = if registered_again {
        "the views are registered with cameras that a run has fitted, so of the estimators only `triangulation` depends on it"
    } else {
        "which boxes count does not depend on calibration.json, but `triangulation` and the registration of the views do: `dtd detect CORPUS \
         --registration-of RUN` repeats the registration with the cameras that this run fits; then train again"
    };
    format!(
        "calibration.json contradicts the boxes: by these, {}; {effect}",
        found.join("; ")
    )
}

impl TrainingCameras {
    /// Views with stated cameras that contradict the boxes, each with the differences.
    pub(super) fn contradictions(&self, views: &[String]) -> Vec<String> {
        let found = views.iter().zip(&self.fits);
        let found = found.map(|(view, fit)| (view, differences(fit)));
        found
            .filter(|(_, differences)| !differences.is_empty())
            .map(|(view, differences)| format!("view {view} {}", differences.join(", ")))
            .collect()
    }
}

/// Significant differences with their standard deviations.
fn differences(fit: &CameraFit) -> Vec<String> {
    let CameraFit { adjustment, sd, .. } = fit;
    let ways = [
        ["right", "left"],
        ["up", "down"],
        ["clockwise", "anticlockwise"],
        ["longer", "shorter"],
        ["north", "south"],
        ["east", "west"],
        ["higher", "lower"],
    ];
    let numbers = adjustment.to_array().into_iter().zip(sd.to_array());
    let differences = numbers.zip(ways).enumerate();
    differences
        .filter_map(|(number, ((value, sd), [more, less]))| {
            let (by, way) = (value.abs(), if value > 0.0 { more } else { less });
            let (least, words) = match number {
                0..3 => (
                    MIN_TURN_DEG,
                    format!("is turned {by:.2} degrees {way} (+- {sd:.2})"),
                ),
                3 => (
                    MIN_FOCAL_PCT,
                    format!("has a focal length {by:.1} % {way} (+- {sd:.1})"),
                ),
                _ => (MIN_MOVE_M, format!("stands {by:.0} m {way} (+- {sd:.0})")),
            };
            (by > least && by > CERTAIN_SD * sd).then_some(words)
        })
        .collect()
}
