//! Stated cameras that the boxes contradict.

use std::fmt;

use super::TrainingCameras;
use super::camera_fit::CameraFit;

/// Differences up to these are not worth a word: degrees, percent and metres. An aircraft's box has its centre some metres off: in the
/// corpus of `dtd paper --frame-rate 2`, whose cameras are true, a fitted one stands 10 m off along the approach.
const MIN_TURN_DEG: f64 = 0.05;
const MIN_FOCAL_PCT: f64 = 1.0;
const MIN_MOVE_M: f64 = 15.0;
/// A difference of fewer standard deviations may be chance.
const MIN_DEVIATIONS: f64 = 5.0;

/// A view whose fitted camera differs from the stated one.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Contradiction {
    view: String,
    /// What differs, each with its standard deviation.
    differences: Vec<String>,
}

impl fmt::Display for Contradiction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "view {} {}", self.view, self.differences.join(", "))
    }
}

/// Message of a training about these views. `registered_again`: with cameras that a run has fitted.
pub(super) fn contradictions_line(found: &[Contradiction], registered_again: bool) -> String {
    let found: Vec<String> = found.iter().map(Contradiction::to_string).collect();
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
    /// The views, in this order, whose stated cameras the boxes contradict.
    pub(super) fn contradictions(&self, views: &[String]) -> Vec<Contradiction> {
        let found = views
            .iter()
            .zip(&self.fits)
            .map(|(view, fit)| Contradiction {
                view: view.clone(),
                differences: differences(fit),
            });
        found
            .filter(|found| !found.differences.is_empty())
            .collect()
    }
}

fn differences(fit: &CameraFit) -> Vec<String> {
    let CameraFit { adjustment, sd, .. } = fit;
    let is_sure =
        |value: f64, sd: f64, least: f64| value.abs() > least && value.abs() > MIN_DEVIATIONS * sd;
    let mut found = Vec::new();
    for (value, sd, [more, less]) in [
        (adjustment.pan_deg, sd.pan_deg, ["right", "left"]),
        (adjustment.tilt_deg, sd.tilt_deg, ["up", "down"]),
        (
            adjustment.roll_deg,
            sd.roll_deg,
            ["clockwise", "anticlockwise"],
        ),
    ] {
        if is_sure(value, sd, MIN_TURN_DEG) {
            let way = if value > 0.0 { more } else { less };
            found.push(format!(
                "is turned {:.2} degrees {way} (+- {sd:.2})",
                value.abs()
            ));
        }
    }
    if is_sure(adjustment.focal_pct, sd.focal_pct, MIN_FOCAL_PCT) {
        let more = if adjustment.focal_pct > 0.0 {
            "longer"
        } else {
            "shorter"
        };
        let (value, sd) = (adjustment.focal_pct.abs(), sd.focal_pct);
        found.push(format!(
            "has a focal length {value:.1} % {more} (+- {sd:.1})"
        ));
    }
    for (value, sd, [more, less]) in [
        (adjustment.north_m, sd.north_m, ["north", "south"]),
        (adjustment.east_m, sd.east_m, ["east", "west"]),
        (adjustment.up_m, sd.up_m, ["higher", "lower"]),
    ] {
        if is_sure(value, sd, MIN_MOVE_M) {
            let way = if value > 0.0 { more } else { less };
            found.push(format!("stands {:.0} m {way} (+- {sd:.0})", value.abs()));
        }
    }
    found
}
