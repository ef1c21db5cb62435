//! Images as separate files, for COCO and YOLO.

use std::fs;

use dataset::corpus::calibration::CameraEntry;
use dataset::corpus::splits::Side;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::error::Result;
use crate::file_format::Writing;
use crate::scenarios::{LabelledBox, ViewPictures};

/// A scenario's images, noted so that the export can be resumed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Part {
    pub(super) scenario: String,
    pub(super) weather: String,
    pub(super) time_of_day: String,
    pub(super) side: Option<Side>,
    pub(super) views: Vec<ViewPart>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct ViewPart {
    pub(super) view: String,
    pub(super) camera: CameraEntry,
    pub(super) pictures: Vec<Picture>,
}

/// An image that was written.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Picture {
    pub(super) tick: u32,
    pub(super) time_ns: i64,
    /// Distance to touchdown, if the scenario is labelled.
    pub(super) dtd_m: Option<f64>,
    /// Relative to the folder of the export, with forward slashes.
    pub(super) file: String,
    pub(super) boxes: Vec<LabelledBox>,
    /// Detections beside ground-truth boxes, if there is one model.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) found: Vec<LabelledBox>,
}

/// Writes a scenario's images into `pictures`, a folder named relative to the export. Returns the [`Part`].
pub(super) fn write(scenario: &Writing<'_>, pictures: &str) -> Result<Value> {
    let source = &scenario.source;
    let stills = scenario.export.request.stills();
    let folder = scenario.folder.join(pictures);
    fs::create_dir_all(&folder).map_err(dataset::Error::io("create", &folder))?;
    let write_view = |view: &String| -> Result<ViewPart> {
        let (_, camera) = source.view(view)?;
        let mut decoded = ViewPictures::open(source, view)?;
        let mut rgb = Vec::new();
        let mut written = Vec::new();
        for row in source.rows() {
            scenario.watch.check()?;
            if source.is_left_out(view, row.tick) {
                continue;
            }
            decoded.decode(row)?;
            let id = &source.record.id;
            let extension = stills.extension();
            let file = format!("{pictures}/{id}_{view}_{:06}.{extension}", row.tick);
            let path = scenario.folder.join(&file);
            decoded.write(&path, stills, &mut rgb)?;
            written.push(Picture {
                tick: row.tick,
                time_ns: row.time_ns,
                dtd_m: row.labels.map(|labels| labels.dtd_m),
                file,
                boxes: source.boxes_of(view, row.tick).to_vec(),
                found: source.beside(view, row.tick).to_vec(),
            });
            scenario.pictures_done(1);
        }
        Ok(ViewPart {
            view: view.clone(),
            camera: camera.clone(),
            pictures: written,
        })
    };
    let views = source.selected.views.iter().map(write_view);
    scenario.part(&Part {
        scenario: source.record.id.clone(),
        weather: source.record.weather_name().to_owned(),
        time_of_day: source.record.time_of_day().to_owned(),
        side: source.selected.side,
        views: views.collect::<Result<_>>()?,
    })
}
