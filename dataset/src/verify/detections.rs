//! Detections, where there are some: they were made from the videos that are there, their tables are those that their records tell of
//! and can be read, and every row is of a picture of the scenario.

use super::Faults;
use crate::corpus::ScenarioFolder;
use crate::detections;
use crate::pixel_box::read_detections;
use crate::scenario::ScenarioRecord;

pub(super) fn check(folder: &ScenarioFolder, record: &ScenarioRecord, faults: &mut Faults) {
    // What is wrong with the scenario itself is named elsewhere.
    let scenario = folder.open().ok();
    let models = faults.keep(detections::FOLDER, detections::models_of(folder));
    for model in models.into_iter().flatten() {
        let file = format!("{}/{model}.parquet", detections::FOLDER);
        let mut path = folder.detections_path(&model);
        if let Some(scenario) = &scenario
            && let Some((current, _)) = faults.keep(&file, scenario.detections_table(&model))
        {
            path = current;
        }
        if !path.exists() {
            continue;
        }
        let Some(found) = faults.keep(&file, read_detections(&path)) else {
            continue;
        };
        for (row, detection) in found.iter().enumerate() {
            let view = detection.view.as_str();
            if detection.tick >= record.ticks {
                let message = format!("is {}, expected below {}", detection.tick, record.ticks);
                faults.view_row(view, &file, row, "tick", message);
            }
            if !record.views.contains(&detection.view) {
                let message = format!("{view} is no view of the scenario");
                faults.row(&file, row, "view", message);
            }
            let edges = detection.pixel_box.edges();
            let sound = edges.iter().all(|edge| edge.is_finite())
                && detection.pixel_box.area() > 0.0
                && (0.0..=1.0).contains(&detection.score);
            if !sound {
                let message = format!(
                    "{:?} with score {} is none",
                    detection.pixel_box, detection.score
                );
                faults.view_row(view, &file, row, "detection", message);
            }
        }
    }
}
