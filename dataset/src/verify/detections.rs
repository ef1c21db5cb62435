//! Detections, where there are some: their tables can be read, and every row is of a picture of the scenario.

use std::fs;

use super::Faults;
use crate::corpus::ScenarioFolder;
use crate::pixel_box::read_detections;
use crate::scenario::ScenarioRecord;

pub(super) fn check(folder: &ScenarioFolder, record: &ScenarioRecord, faults: &mut Faults) {
    let Ok(entries) = fs::read_dir(folder.detections_folder()) else {
        return;
    };
    let mut tables: Vec<_> = entries
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|ending| ending == "parquet"))
        .collect();
    tables.sort();
    for path in tables {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let file = format!("detections/{name}");
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
