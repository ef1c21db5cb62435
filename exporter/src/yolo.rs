//! The dataset format of Ultralytics' YOLO: `images/<side>/`, `labels/<side>/` with a line `class cx cy width height` per box, in parts of
//! the picture's sides, and `data.yaml`. Pictures without a box are negatives: they have an empty file.

use std::collections::BTreeSet;
use std::fmt::Write;
use std::fs;
use std::path::Path;

use dataset::json_file::write_unsynced;
use dataset::splits::Side;

use crate::columns_text::Kind;
use crate::croissant::{Contents, Field, FileSet, ListedFile, RecordSet, content_of, part_of_path};
use crate::error::Result;
use crate::part::{LabelledBox, Part};

const DATA: &str = "data.yaml";
const LABELS: &str = "labels";

/// Where the pictures of a side go, relative to the export.
pub(crate) fn pictures(side: Option<Side>) -> String {
    format!("images/{}", folder_of(side))
}

/// As in `data.yaml`; what has no side is for training.
fn folder_of(side: Option<Side>) -> &'static str {
    match side {
        None | Some(Side::Train) => "train",
        Some(Side::Validation) => "val",
        Some(Side::Test) => "test",
    }
}

/// Writes the files besides the pictures.
pub(crate) fn finish(folder: &Path, parts: impl Iterator<Item = Result<Part>>) -> Result<Contents> {
    let mut sides = BTreeSet::new();
    for part in parts {
        let part = part?;
        let side = folder_of(part.side);
        sides.insert(side);
        let labels = folder.join(LABELS).join(side);
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
    }
    let mut yaml = String::from("# Made by dtd export. Boxes in parts of the picture's sides.\n");
    // Both are required, even if one is empty: the other stands in.
    let first = sides.first().copied().unwrap_or("train");
    for side in ["train", "val", "test"] {
        match (sides.contains(side), side) {
            (true, _) => drop(writeln!(yaml, "{side}: images/{side}")),
            (false, "test") => {}
            (false, _) => drop(writeln!(yaml, "{side}: images/{first}")),
        }
    }
    yaml.push_str("names:\n  0: aircraft\n");
    write_unsynced(&folder.join(DATA), yaml.as_bytes())?;
    Ok(contents())
}

fn contents() -> Contents {
    let set = "labels";
    let label = |name, meaning, source| Field::new(name, Kind::Text, meaning, source);
    Contents {
        files: vec![ListedFile::new(DATA, "application/yaml")],
        sets: vec![
            FileSet::new("images", "images/*/*", "image/*", "The pictures, by split."),
            FileSet::new(
                set,
                "labels/*/*.txt",
                "text/plain",
                "Their boxes, by split.",
            ),
        ],
        records: vec![RecordSet {
            name: "pictures",
            what: "A record per picture.".into(),
            fields: vec![
                label(
                    "split",
                    "side of the split",
                    part_of_path(set, ".*labels/([a-z]+)/[^/]*$"),
                ),
                label(
                    "name",
                    "its name in images/, without the ending",
                    part_of_path(set, ".*/([^/]+)[.]txt$"),
                ),
                label(
                    "boxes",
                    "a line `class cx cy width height` per box, in parts of the picture's sides",
                    content_of(set),
                ),
            ],
        }],
        ..Contents::default()
    }
}

fn line(labelled: &LabelledBox, [width_px, height_px]: [f64; 2]) -> String {
    let [left, top, width, height] = labelled.corner_and_size();
    // Rounding must not lead out of the picture.
    let part = |value: f64, of: f64| (value / of).clamp(0.0, 1.0);
    format!(
        "0 {:.7} {:.7} {:.7} {:.7}\n",
        part(left + width / 2.0, width_px),
        part(top + height / 2.0, height_px),
        part(width, width_px),
        part(height, height_px),
    )
}
