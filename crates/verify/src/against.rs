//! Compares labels with those of an earlier corpus from the same sweep, e.g. in CI.

use dataset::corpus::open_scenario::OpenScenario;
use dataset::corpus::{Corpus, ScenarioFolder};
use dataset::error::Result;
use dataset::tables::frames::Frames;
use dataset::tables::pixel_box::TruthBox;

use crate::faults::{Faults, Finding};

/// Largest difference of a label, metres: far more than rounding, far less than any effect on a distance.
const LABEL_TOLERANCE_M: f64 = 1e-3;
/// Largest difference of a ground-truth box's centre or size, pixels.
const BOX_TOLERANCE_PX: f64 = 1e-2;

/// Differences of a corpus's labels from the expected ones. Scenarios that are not expected are left alone.
///
/// # Errors
/// The expected corpus cannot be listed.
pub fn against(corpus: &Corpus, expected: &Corpus) -> Result<Vec<Finding>> {
    let mut findings = Vec::new();
    for expected in expected.scenarios()? {
        let id = expected.id();
        let mut faults = Faults::of_scenario(&id);
        compare(&corpus.scenario(&id), &expected, &mut faults);
        findings.extend(faults.into_findings());
    }
    Ok(findings)
}

fn compare(found: &ScenarioFolder, expected: &ScenarioFolder, faults: &mut Faults) {
    if !found.root().exists() {
        faults.file(
            ScenarioFolder::RECORD,
            "is missing; the expected corpus has the scenario",
        );
        return;
    }
    let labels = |folder: &ScenarioFolder| labels_of(&folder.open()?);
    let found = faults.keep(ScenarioFolder::FRAMES, labels(found));
    let expected = labels(expected).map_err(|error| {
        faults.file(
            ScenarioFolder::FRAMES,
            format!("the expected one cannot be read: {error}"),
        );
    });
    if let (Some(found), Ok(expected)) = (found, expected) {
        compare_frames(&found.0, &expected.0, faults);
        compare_boxes(&found.1, &expected.1, faults);
    }
}

fn labels_of(scenario: &OpenScenario) -> Result<(Frames, Vec<TruthBox>)> {
    let boxes = scenario.truth_boxes_if_labelled()?;
    Ok((scenario.frames()?, boxes.unwrap_or_default()))
}

fn compare_frames(found: &Frames, expected: &Frames, faults: &mut Faults) {
    let (there, wanted) = (found.rows.len(), expected.rows.len());
    if there != wanted {
        faults.file(
            ScenarioFolder::FRAMES,
            format!("has {there} ticks, expected {wanted}"),
        );
    }
    for (row, (found, expected)) in found.rows.iter().zip(&expected.rows).enumerate() {
        let dtd_m = [found, expected].map(|tick| tick.labels.map(|labels| labels.dtd_m));
        let [found_m, expected_m] = dtd_m;
        let is_same = match (found_m, expected_m) {
            (Some(found_m), Some(expected_m)) => (found_m - expected_m).abs() <= LABEL_TOLERANCE_M,
            (found_m, expected_m) => found_m == expected_m,
        };
        if !is_same {
            let shown =
                |dtd_m: Option<f64>| dtd_m.map_or("none".into(), |dtd_m| format!("{dtd_m:.3}"));
            let message = format!("is {}, expected {}", shown(found_m), shown(expected_m));
            faults.row(ScenarioFolder::FRAMES, row, "dtd_m", message);
        }
    }
}

fn compare_boxes(found: &[TruthBox], expected: &[TruthBox], faults: &mut Faults) {
    let (there, wanted) = (found.len(), expected.len());
    if there != wanted {
        faults.file(
            ScenarioFolder::TRUTH_BOXES,
            format!("has {there} boxes, expected {wanted}"),
        );
    }
    for (row, (found, expected)) in found.iter().zip(expected).enumerate() {
        let is_same_image = found.tick == expected.tick && found.view == expected.view;
        let numbers = |of: &TruthBox| {
            let of = &of.pixel_box;
            [of.cx_px, of.cy_px, of.width_px, of.height_px]
        };
        let pairs = numbers(found).into_iter().zip(numbers(expected));
        let is_same = pairs
            .into_iter()
            .all(|(found, expected)| (found - expected).abs() <= BOX_TOLERANCE_PX);
        if !(is_same_image && is_same) {
            let shown = |of: &TruthBox| format!("{:.2?} px at tick {}", numbers(of), of.tick);
            let message = format!("is {}, expected {}", shown(found), shown(expected));
            faults.view_row(
                &found.view,
                ScenarioFolder::TRUTH_BOXES,
                row,
                "box",
                message,
            );
        }
    }
}
