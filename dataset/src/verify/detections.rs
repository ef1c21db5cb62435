//! Detections, if there are any: they were made from the current videos, their records and tables can be read and belong together,
//! and every row refers to a picture of the scenario.

use super::Faults;
use crate::corpus::ScenarioFolder;
use crate::detections;
use crate::limits::MOST_PICTURES;
use crate::pixel_box::{Detection, read_detections_with_faults};
use crate::scenario::ScenarioRecord;

/// Checks the detections of all models. `record` is missing if `scenario.json` cannot be read.
pub(super) fn check(folder: &ScenarioFolder, record: Option<&ScenarioRecord>, faults: &mut Faults) {
    // Faults of the scenario itself are reported elsewhere.
    let scenario = folder.open().ok();
    let pictures = record.map_or(MOST_PICTURES, ScenarioRecord::pictures);
    let models = faults.keep(detections::FOLDER, detections::models_of(folder));
    for model in models.into_iter().flatten() {
        let file = format!("{}/{model}.parquet", detections::FOLDER);
        let mut path = folder.detections_path(&model);
        let provenance = faults.keep(
            &format!("{}/{model}.json", detections::FOLDER),
            detections::provenance(folder, &model),
        );
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
    if let Some(record) = record {
        if detection.tick >= record.ticks {
            let message = format!("is {}, expected below {}", detection.tick, record.ticks);
            faults.view_row(view, file, row, "tick", message);
        }
        if !record.views.contains(&detection.view) {
            let message = format!("{view} is no view of the scenario");
            faults.row(file, row, "view", message);
        }
    }
    if detection.pixel_box.area() == 0.0 {
        let message = format!("{:?} is none", detection.pixel_box);
        faults.view_row(view, file, row, "detection", message);
    }
}
