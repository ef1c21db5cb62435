//! Pictures as separate files, for COCO and YOLO.

use std::fs;
use std::path::Path;

use dataset::work::watch::Watch;

use crate::error::Result;
use crate::part::{Part, Picture, ViewPart};
use crate::pictures::ViewPictures;
use crate::request::ExportRequest;
use crate::source::Source;

/// Writes the pictures of a scenario into `pictures`, a folder named relative to the export.
pub(crate) fn write(
    source: &Source<'_>,
    request: &ExportRequest,
    export: &Path,
    pictures: &str,
    watch: &dyn Watch,
    picture_done: &dyn Fn(),
) -> Result<Part> {
    let folder = export.join(pictures);
    fs::create_dir_all(&folder).map_err(dataset::Error::io("create", &folder))?;
    let write_view = |view: &String| -> Result<ViewPart> {
        let (_, camera) = source.view(view)?;
        let mut decoded = ViewPictures::open(source, view)?;
        let mut rgb = Vec::new();
        let mut written = Vec::new();
        for row in &source.frames.rows {
            watch.check()?;
            decoded.decode(row)?;
            if !source.is_asked_for(row.tick) || source.is_left_out(view, row.tick) {
                continue;
            }
            decoded.convert(&mut rgb)?;
            let id = &source.record.id;
            let extension = request.stills().extension();
            let file = format!("{pictures}/{id}_{view}_{:06}.{extension}", row.tick);
            let path = export.join(&file);
            request.stills().write(&path, &rgb, decoded.size_px())?;
            written.push(Picture {
                tick: row.tick,
                time_ns: row.time_ns,
                dtd_m: row.labels.map(|labels| labels.dtd_m),
                file,
                boxes: source.boxes_of(view, row.tick).to_vec(),
                found: source.beside(view, row.tick).to_vec(),
            });
            picture_done();
        }
        Ok(ViewPart {
            view: view.clone(),
            camera: camera.clone(),
            pictures: written,
        })
    };
    let views = source.selected.views.iter().map(write_view);
    Ok(Part {
        scenario: source.record.id.clone(),
        weather: source.record.conditions.weather_name.clone(),
        time_of_day: source.record.conditions.time_of_day.clone(),
        side: source.selected.side,
        views: views.collect::<Result<_>>()?,
    })
}
