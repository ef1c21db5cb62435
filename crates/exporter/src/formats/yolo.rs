//! The dataset format of Ultralytics' YOLO: `images/<side>/`, `labels/<side>/` with a line `class cx cy width height` per box, in parts of
//! the image's sides, `data.yaml`, and `classes.txt`. Images without a box are negatives: they have an empty file.
//!
//! `data.yaml` names a side only by its own images, so the test side is never trained on or validated with. The one exception is `val`
//! of a dataset that has a training side and no validation side: Ultralytics requires it, and it repeats `train`.

use std::collections::BTreeSet;
use std::fmt::Write;
use std::fs;
use std::path::Path;

use dataset::corpus::splits::Side;
use dataset::files::json_file::write_unsynced;
use serde_json::Value;

use super::picture_files::{self, Part};
use crate::about::short_split_of;
use crate::error::Result;
use crate::file_format::{Export, FileFormat, Writing, Written};
use crate::request::{Abilities, BoxUse};
use crate::scenarios::LabelledBox;

const DATA: &str = "data.yaml";
const LABELS: &str = "labels";
/// Names of the classes, one a line, for tools that do not read [`DATA`].
const CLASSES: &str = "classes.txt";

/// The format.
pub(super) struct Yolo;

impl FileFormat for Yolo {
    fn abilities(&self) -> Abilities {
        Abilities {
            boxes: BoxUse::Certain,
            ..Abilities::of_stills("yolo")
        }
    }

    fn check_all(&self, export: &Export<'_>) -> Result<Option<&'static str>> {
        Ok(remark_on(&export.sides))
    }

    fn write(&self, scenario: &Writing<'_>) -> Result<Value> {
        let side = short_split_of(scenario.source.selected.side);
        picture_files::write(scenario, &format!("images/{side}"))
    }

    fn finish(&self, written: &Written<'_>) -> Result<()> {
        let folder = written.folder();
        for part in written.parts::<Part>() {
            write_labels(&folder, &part?)?;
        }
        write_unsynced(&folder.join(CLASSES), b"aircraft\n")?;
        let data = data_yaml(&written.export.sides);
        Ok(write_unsynced(&folder.join(DATA), data.as_bytes())?)
    }
}

fn write_labels(folder: &Path, part: &Part) -> Result<()> {
    let labels = folder.join(LABELS).join(short_split_of(part.side));
    fs::create_dir_all(&labels).map_err(dataset::Error::io("create", &labels))?;
    for view in &part.views {
        let size_px = [view.camera.width_px, view.camera.height_px].map(f64::from);
        for picture in &view.pictures {
            let stem = Path::new(&picture.file).file_stem().unwrap_or_default();
            let lines: String = picture.boxes.iter().map(|b| line(b, size_px)).collect();
            let mut name = stem.to_owned();
            name.push(".txt");
            write_unsynced(&labels.join(name), lines.as_bytes())?;
        }
    }
    Ok(())
}

/// Parts that `data.yaml` lacks for training, as a sentence.
fn remark_on(sides: &BTreeSet<Side>) -> Option<&'static str> {
    if !sides.contains(&Side::Train) {
        Some("there is no training side, so data.yaml has no `train`")
    } else if !sides.contains(&Side::Validation) {
        Some("there is no validation side, so `val` of data.yaml repeats `train`")
    } else {
        None
    }
}

fn data_yaml(sides: &BTreeSet<Side>) -> String {
    let mut yaml = String::from("# Made by dtd export. Boxes in parts of the image's sides.\n");
    if let Some(remark) = remark_on(sides) {
        let _ = writeln!(yaml, "# Note: {remark}.");
    }
    for side in sides {
        let name = short_split_of(Some(*side));
        let _ = writeln!(yaml, "{name}: images/{name}");
        if *side == Side::Train && !sides.contains(&Side::Validation) {
            yaml.push_str("val: images/train\n");
        }
    }
    yaml.push_str("names:\n  0: aircraft\n");
    yaml
}

fn line(labelled: &LabelledBox, [width_px, height_px]: [f64; 2]) -> String {
    let [left, top, width, height] = labelled.corner_and_size();
    // Rounding must not lead out of the image.
    let part = |value: f64, of: f64| (value / of).clamp(0.0, 1.0);
    format!(
        "0 {:.7} {:.7} {:.7} {:.7}\n",
        part(left + width / 2.0, width_px),
        part(top + height / 2.0, height_px),
        part(width, width_px),
        part(height, height_px),
    )
}
