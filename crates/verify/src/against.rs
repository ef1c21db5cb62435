//! Compares labels with an earlier corpus's from the same sweep, e.g. in CI.

use std::collections::{BTreeMap, BTreeSet};

use dataset::corpus::open_scenario::OpenScenario;
use dataset::corpus::{Corpus, ScenarioFolder};
use dataset::error::Result;
use dataset::tables::aircraft::AircraftRow;
use dataset::tables::frames::{Frames, TickRow};
use dataset::tables::pixel_box::TruthBox;

use crate::faults::{Faults, Finding};

/// Largest difference of a label, metres: far more than rounding, far less than any effect on a distance.
const LABEL_TOLERANCE_M: f64 = 1e-3;
/// Largest difference of a ground-truth box's centre or size, pixels: 1 mm at a distance of 1 km with a lens of 10 degrees.
const BOX_TOLERANCE_PX: f64 = 1e-2;
/// Largest difference of a visible or truncated part, or of contrast.
const RATIO_TOLERANCE: f64 = 1e-3;
/// Labels that are lengths.
const LENGTHS: [&str; 4] = [
    "dtd_m",
    "along_track_m",
    "cross_track_m",
    "height_over_target_m",
];

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
        compare_aircraft(&found.2, &expected.2, faults);
    }
}

fn labels_of(scenario: &OpenScenario) -> Result<(Frames, Vec<TruthBox>, Vec<AircraftRow>)> {
    let boxes = scenario.truth_boxes_if_labelled()?.unwrap_or_default();
    let aircraft = scenario.aircraft()?.unwrap_or_default();
    Ok((scenario.frames()?, boxes, aircraft))
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
        for (index, name) in LENGTHS.into_iter().enumerate() {
            let lengths = [found, expected].map(|tick| Some(lengths_m(tick)?[index]));
            faults.compare_m(
                ScenarioFolder::FRAMES,
                row,
                name,
                lengths,
                LABEL_TOLERANCE_M,
            );
        }
    }
}

fn compare_aircraft(found: &[AircraftRow], expected: &[AircraftRow], faults: &mut Faults) {
    const TABLE: &str = ScenarioFolder::AIRCRAFT;
    let (there, wanted) = (found.len(), expected.len());
    if there != wanted {
        faults.file(TABLE, format!("has {there} rows, expected {wanted}"));
        return;
    }
    for (row, (found, expected)) in found.iter().zip(expected).enumerate() {
        let [here, there] = [found, expected].map(|of| of.pose.position().to_ecef());
        let off_m = here.distance(there);
        if off_m > LABEL_TOLERANCE_M {
            let message = format!("is {off_m:.3} m from the expected place");
            faults.row(TABLE, row, "pose", message);
        }
        let distances = [found.dtd_m, expected.dtd_m];
        faults.compare_m(TABLE, row, "dtd_m", distances, LABEL_TOLERANCE_M);
    }
}

/// The labels with the names in [`LENGTHS`], if there are any.
fn lengths_m(tick: &TickRow) -> Option<[f64; 4]> {
    let of = tick.labels.as_ref()?;
    Some([
        of.dtd_m,
        of.along_track_m,
        of.cross_track_m,
        of.height_over_target_m,
    ])
}

fn compare_boxes(found: &[TruthBox], expected: &[TruthBox], faults: &mut Faults) {
    let by_image = |boxes: &[TruthBox]| -> BTreeMap<(u32, String, u32), TruthBox> {
        let boxes = boxes.iter().cloned();
        boxes
            .map(|of| ((of.tick, of.view.clone(), of.number()), of))
            .collect()
    };
    let (found, expected) = (by_image(found), by_image(expected));
    let images: BTreeSet<_> = found.keys().chain(expected.keys()).collect();
    for image in images {
        let [found, expected] = [&found, &expected].map(|boxes| boxes.get(image));
        let is_same = found
            .zip(expected)
            .is_some_and(|(found, expected)| are_same(found, expected));
        if !is_same {
            let shown = |of: Option<&TruthBox>| {
                of.map_or("none".into(), |of| {
                    format!("{:.2?} px, {:.3?}", numbers_px(of), ratios(of))
                })
            };
            let message = format!("is {}, expected {}", shown(found), shown(expected));
            let (tick, view, _) = image;
            faults.view_row(
                view,
                ScenarioFolder::TRUTH_BOXES,
                *tick as usize,
                "box of the tick",
                message,
            );
        }
    }
}

fn are_same(found: &TruthBox, expected: &TruthBox) -> bool {
    let near = |of: &[f64], other: &[f64], tolerance: f64| {
        of.iter()
            .zip(other)
            .all(|(of, other)| (of - other).abs() <= tolerance)
    };
    near(&numbers_px(found), &numbers_px(expected), BOX_TOLERANCE_PX)
        && near(&ratios(found), &ratios(expected), RATIO_TOLERANCE)
}

fn numbers_px(of: &TruthBox) -> [f64; 4] {
    let of = &of.pixel_box;
    [of.cx_px, of.cy_px, of.width_px, of.height_px]
}

/// Visible part, part outside the image, contrast, and part behind other aircraft.
fn ratios(of: &TruthBox) -> [f64; 4] {
    [
        of.visible_fraction,
        of.truncation,
        of.transmission,
        of.occluded_fraction.unwrap_or(0.0),
    ]
}
