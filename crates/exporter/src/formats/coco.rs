//! COCO (Lin et al. 2014): `images/`, `annotations.json`, the same by side of the split in `annotations/instances_<side>.json`, where
//! trainers and converters look for it, and `detections.json` in the form of COCO's results if a model's detections are exported beside the
//! ground truth.
//!
//! An aircraft that no detector can be expected to find (beyond the visibility, perhaps behind a cloud, or mostly outside the image) is a
//! crowd (`iscrowd` 1), which COCO's evaluation neither requires nor counts as false. Boxes are `[left, top, width, height]` in pixels from
//! the outer corner of the top-left pixel.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::iter;
use std::path::{Path, PathBuf};

use dataset::corpus::calibration::CameraEntry;
use dataset::corpus::splits::Side;
use serde::Serialize;
use serde_json::{Value, json};

use super::picture_files::{self, Part, Picture, ViewPart};
use crate::about::short_split_of;
use crate::error::Result;
use crate::file_format::{Export, FileFormat, Writing, Written};
use crate::request::{Abilities, ExportRequest};
use crate::scenarios::{LabelledBox, TruthFigures};

/// Image folder, relative to the export.
const PICTURES: &str = "images";
const ANNOTATIONS: &str = "annotations.json";
const DETECTIONS: &str = "detections.json";
const AIRCRAFT: u32 = 1;
/// Number of the licence of all images.
const LICENSE: u32 = 1;

#[derive(Serialize)]
struct Image<'a> {
    id: u64,
    file_name: &'a str,
    width: u32,
    height: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    license: Option<u32>,
    scenario: &'a str,
    view: &'a str,
    tick: u32,
    time_ns: i64,
    dtd_m: Option<f64>,
    weather: &'a str,
    time_of_day: &'a str,
    side: Option<Side>,
    calibration: &'a CameraEntry,
}

#[derive(Serialize)]
struct Annotation {
    id: u64,
    image_id: u64,
    category_id: u32,
    bbox: [f64; 4],
    area: f64,
    iscrowd: u8,
    #[serde(skip_serializing_if = "Option::is_none")]
    score: Option<f64>,
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    truth: Option<TruthFigures>,
}

#[derive(Serialize)]
struct DetectionResult {
    image_id: u64,
    category_id: u32,
    bbox: [f64; 4],
    score: f64,
}

/// The format.
pub(super) struct Coco;

impl FileFormat for Coco {
    fn abilities(&self) -> Abilities {
        Abilities {
            has_license: true,
            ..Abilities::of_stills("coco")
        }
    }

    fn write(&self, scenario: &Writing<'_>) -> Result<Value> {
        picture_files::write(scenario, PICTURES)
    }

    fn finish(&self, written: &Written<'_>) -> Result<()> {
        let Export { request, sides, .. } = written.export;
        finish(&written.folder(), request, sides, || {
            written.parts::<Part>()
        })
    }
}

/// Writes the files besides the images, part by part: together they may be larger than the memory. `sides`: those that the scenarios
/// are on.
fn finish<P: Iterator<Item = Result<Part>>>(
    folder: &Path,
    request: &ExportRequest,
    sides: &BTreeSet<Side>,
    parts: impl Fn() -> P,
) -> Result<()> {
    let mut files = AnnotationFiles::create(folder, sides)?;
    files.write(
        json!({
            "description": "Approaches recorded by dtd",
            "version": env!("CARGO_PKG_VERSION"),
            "boxes": request.boxes,
        }),
        "{\"info\":",
    )?;
    // Other programs require the list, even without a licence.
    let licenses = request.license.iter().map(|license| {
        let is_url = license.contains("://");
        let url = if is_url { license.as_str() } else { "" };
        json!({"id": LICENSE, "name": license, "url": url})
    });
    files.write(licenses.collect::<Vec<_>>(), ",\"licenses\":")?;
    files.write(
        json!([{"id": AIRCRAFT, "name": "aircraft", "supercategory": "vehicle"}]),
        ",\"categories\":",
    )?;
    files.begin(",\"images\":[")?;
    each_picture(parts(), |part, view, picture, id| {
        let image = Image {
            id,
            file_name: file_name(&picture.file),
            width: view.camera.width_px,
            height: view.camera.height_px,
            license: request.license.as_ref().map(|_| LICENSE),
            scenario: &part.scenario,
            view: &view.view,
            tick: picture.tick,
            time_ns: picture.time_ns,
            dtd_m: picture.dtd_m,
            weather: &part.weather,
            time_of_day: &part.time_of_day,
            side: part.side,
            calibration: &view.camera,
        };
        files.item(part.side, &image)
    })?;
    files.begin("],\"annotations\":[")?;
    let mut count = 0;
    each_picture(parts(), |part, _, picture, image_id| {
        for labelled in &picture.boxes {
            count += 1;
            files.item(part.side, &annotation(count, image_id, labelled))?;
        }
        Ok(())
    })?;
    files.end("]}")?;

    let mut results = None;
    each_picture(parts(), |_, _, picture, image_id| {
        for found in &picture.found {
            if results.is_none() {
                let mut begun = ListWriter::create(&folder.join(DETECTIONS))?;
                begun.begin("[")?;
                results = Some(begun);
            }
            if let Some(results) = &mut results {
                results.item(&DetectionResult {
                    image_id,
                    category_id: AIRCRAFT,
                    bbox: found.corner_and_size(),
                    score: found.score.unwrap_or(1.0),
                })?;
            }
        }
        Ok(())
    })?;
    results.map_or(Ok(()), |results| results.end("]"))
}

/// All images with their numbers, from 1.
fn each_picture(
    parts: impl Iterator<Item = Result<Part>>,
    mut visit: impl FnMut(&Part, &ViewPart, &Picture, u64) -> Result<()>,
) -> Result<()> {
    let mut id = 0;
    for part in parts {
        let part = part?;
        for view in &part.views {
            for picture in &view.pictures {
                id += 1;
                visit(&part, view, picture, id)?;
            }
        }
    }
    Ok(())
}

/// Path relative to the export.
fn annotations_of(side: Side) -> String {
    format!("annotations/instances_{}.json", short_split_of(Some(side)))
}

/// The annotations of all images, and by side. An image has the same number in each.
struct AnnotationFiles {
    all: ListWriter,
    sides: BTreeMap<Side, ListWriter>,
}

impl AnnotationFiles {
    fn create(folder: &Path, sides: &BTreeSet<Side>) -> Result<Self> {
        let by_side = folder.join("annotations");
        fs::create_dir_all(&by_side).map_err(dataset::Error::io("create", &by_side))?;
        let of_side = |side: &Side| {
            let file = ListWriter::create(&folder.join(annotations_of(*side)))?;
            Ok((*side, file))
        };
        Ok(Self {
            all: ListWriter::create(&folder.join(ANNOTATIONS))?,
            sides: sides.iter().map(of_side).collect::<Result<_>>()?,
        })
    }

    fn each(&mut self) -> impl Iterator<Item = &mut ListWriter> {
        iter::once(&mut self.all).chain(self.sides.values_mut())
    }

    fn write(&mut self, value: impl Serialize, before: &str) -> Result<()> {
        self.each().try_for_each(|file| file.write(&value, before))
    }

    fn begin(&mut self, text: &str) -> Result<()> {
        self.each().try_for_each(|file| file.begin(text))
    }

    /// Items without a side count as training data.
    fn item(&mut self, side: Option<Side>, item: &impl Serialize) -> Result<()> {
        self.all.item(item)?;
        let of_side = self.sides.get_mut(&side.unwrap_or(Side::Train));
        of_side.map_or(Ok(()), |file| file.item(item))
    }

    fn end(self, text: &str) -> Result<()> {
        self.all.end(text)?;
        self.sides.into_values().try_for_each(|file| file.end(text))
    }
}

/// A JSON file with long lists, written item by item.
struct ListWriter {
    path: PathBuf,
    file: BufWriter<File>,
    is_first: bool,
}

impl ListWriter {
    fn create(path: &Path) -> Result<Self> {
        let file = File::create(path).map_err(dataset::Error::io("create", path))?;
        Ok(Self {
            path: path.to_owned(),
            file: BufWriter::new(file),
            is_first: true,
        })
    }

    fn text(&mut self, text: &str) -> Result<()> {
        let written = self.file.write_all(text.as_bytes());
        Ok(written.map_err(dataset::Error::io("write", &self.path))?)
    }

    fn write(&mut self, value: impl Serialize, before: &str) -> Result<()> {
        self.text(before)?;
        let written = serde_json::to_writer(&mut self.file, &value);
        Ok(written.map_err(|e| dataset::Error::io("write", &self.path)(e.into()))?)
    }

    fn begin(&mut self, text: &str) -> Result<()> {
        self.is_first = true;
        self.text(text)
    }

    fn item(&mut self, item: &impl Serialize) -> Result<()> {
        let before = if self.is_first { "\n" } else { ",\n" };
        self.is_first = false;
        self.write(item, before)
    }

    fn end(mut self, text: &str) -> Result<()> {
        self.text(text)?;
        self.text("\n")?;
        Ok(self
            .file
            .flush()
            .map_err(dataset::Error::io("write", &self.path))?)
    }
}

/// COCO's names are relative to the folder of the images.
fn file_name(file: &str) -> &str {
    let name = file.strip_prefix(PICTURES);
    name.map_or(file, |name| name.trim_start_matches('/'))
}

fn annotation(id: u64, image_id: u64, labelled: &LabelledBox) -> Annotation {
    let bbox = labelled.corner_and_size();
    Annotation {
        id,
        image_id,
        category_id: AIRCRAFT,
        bbox,
        area: bbox[2] * bbox[3],
        iscrowd: u8::from(labelled.truth.is_some_and(|truth| truth.is_ignored())),
        score: labelled.score,
        truth: labelled.truth,
    }
}
