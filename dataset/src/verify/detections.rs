//! Detections, if there are any: they were made from the current videos, their records and tables can be read and belong together,
//! the counts and settings of the records are possible, and every row refers to a picture of the scenario.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde_json::Value;

use super::Faults;
use crate::corpus::ScenarioFolder;
use crate::detections;
use crate::json_file::read_json;
use crate::limits::{self, MOST_PICTURES};
use crate::open_scenario::fault_of;
use crate::pixel_box::{Detection, read_detections_with_faults};
use crate::scenario::ScenarioRecord;

/// The rest of a record, besides the origin of its table. Other programs may write less.
#[derive(Default, Deserialize)]
#[serde(default)]
struct Counts {
    pictures: Option<u64>,
    detections: Option<u64>,
    seconds: Option<f64>,
    settings: BTreeMap<String, Value>,
}

/// Checks the detections of all models. `record` is missing if `scenario.json` cannot be read.
pub(super) fn check(folder: &ScenarioFolder, record: Option<&ScenarioRecord>, faults: &mut Faults) {
    // Faults of the scenario itself are reported elsewhere.
    let scenario = folder.open().ok();
    let pictures = record.map_or(MOST_PICTURES, ScenarioRecord::pictures);
    let models = faults.keep(detections::FOLDER, detections::models_of(folder));
    for model in models.into_iter().flatten() {
        let file = format!("{}/{model}.parquet", detections::FOLDER);
        let mut path = folder.detections_path(&model);
        let record_file = format!("{}/{model}.json", detections::FOLDER);
        let provenance = faults.keep(&record_file, detections::provenance(folder, &model));
        if provenance.is_some()
            && let Some(scenario) = &scenario
            && let Some((current, _)) = faults.keep(&file, scenario.detections_table(&model))
        {
            path = current;
        }
        if !path.exists() {
            continue;
        }
        let read = read_detections_with_faults(&path, pictures);
        let Some(found) = faults.keep_table(&file, read) else {
            continue;
        };
        for (row, detection) in found.iter().enumerate() {
            check_row(&file, row, detection, record, faults);
        }
        let path = detections::record_path(folder, &model);
        if matches!(provenance, Some(Some(_)))
            && let Some(counts) =
                faults.keep(&record_file, read_json(&path, "record of detections"))
        {
            check_counts(&record_file, &counts, found.len(), record, faults);
        }
    }
}

fn check_counts(
    file: &str,
    counts: &Counts,
    rows: usize,
    record: Option<&ScenarioRecord>,
    faults: &mut Faults,
) {
    let expected = [
        (
            "pictures",
            counts.pictures,
            record.map(ScenarioRecord::pictures),
        ),
        ("detections", counts.detections, Some(rows as u64)),
    ];
    for (what, found, expected) in expected {
        if let (Some(found), Some(expected)) = (found, expected)
            && found != expected
        {
            faults.file(file, format!("{what} is {found}, expected {expected}"));
        }
    }
    if let Some(seconds) = counts
        .seconds
        .filter(|seconds| !(0.0..=1e10).contains(seconds))
    {
        faults.file(
            file,
            format!("seconds is {seconds:e}, expected a time from 0 to 1e10"),
        );
    }
    for (name, limits) in [
        ("tile_score", limits::RATIO),
        ("score", limits::RATIO),
        ("merge_iou", limits::RATIO),
        ("most_windows", limits::WINDOWS),
    ] {
        let value = counts.settings.get(name);
        // NaN is never in range.
        let number = value.map(|value| value.as_f64().unwrap_or(f64::NAN));
        if let Some(Err(fault)) = number.map(|number| limits.check(number)) {
            faults.file(file, format!("settings.{name} {fault}"));
        }
    }
}

fn check_row(
    file: &str,
    row: usize,
    detection: &Detection,
    record: Option<&ScenarioRecord>,
    faults: &mut Faults,
) {
    let view = detection.view.as_str();
    match record.and_then(|record| fault_of(detection, record)) {
        Some((kind @ "view", message)) => faults.row(file, row, kind, message),
        Some((kind, message)) => faults.view_row(view, file, row, kind, message),
        None => {}
    }
    if detection.pixel_box.area() == 0.0 {
        let message = format!("{:?} has no area", detection.pixel_box);
        faults.view_row(view, file, row, "detection", message);
    }
}
