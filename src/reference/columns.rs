//! The columns of a scenario's tables: names, types and limits from empty tables, meanings from the comments of the rows that fill them.

use dataset::corpus::detections::{Detection, Miss, Row};
use dataset::tables::aircraft::AircraftRow;
use dataset::tables::backgrounds::ViewBackground;
use dataset::tables::columns::TableWriter;
use dataset::tables::frames::{Frames, TickRow};
use dataset::tables::health::ViewHealth;
use dataset::tables::image_rows::ImageRow;
use dataset::tables::pixel_box::TruthBox;
use dataset::tables::registrations::Registration;
use schemars::schema_for;
use serde_json::{Value, json};

use super::markdown::table;
use super::settings::{described_values, limits};

/// Placeholder for a view in a column's name.
const VIEW: &str = "<view>";
/// Columns whose field has another name: the start of a column's name and the name of the field.
const OTHER_NAMES: [(&str, &str); 4] = [
    ("velocity_", "velocity_ned_mps"),
    ("echo_", "echoed_pose"),
    ("camera_", "echoed_camera"),
    ("reason", "result"),
];

pub(super) fn sections() -> String {
    let frames = Frames {
        views: vec![VIEW.into()],
        rows: Vec::new(),
    };
    let tables = [
        (
            "frames.parquet",
            frames.columns(),
            json!(schema_for!(TickRow)),
        ),
        (
            "boxes_truth.parquet",
            TruthBox::columns_with_traffic(&[]),
            json!(schema_for!(TruthBox)),
        ),
        (
            "aircraft.parquet",
            AircraftRow::columns(&[]),
            json!(schema_for!(AircraftRow)),
        ),
        (
            "detections/&lt;model&gt;.parquet",
            Row::columns(&[]),
            json!(schema_for!((Detection, Miss))),
        ),
        (
            "registrations/&lt;model&gt;.parquet",
            Registration::columns(&[]),
            json!(schema_for!(Registration)),
        ),
        (
            "health/&lt;model&gt;.parquet",
            ViewHealth::columns(&[]),
            json!(schema_for!(ViewHealth)),
        ),
        (
            "backgrounds/&lt;model&gt;.parquet",
            ViewBackground::columns(&[]),
            json!(schema_for!(ViewBackground)),
        ),
    ];
    tables
        .iter()
        .map(|(file, columns, rows)| format!("## {file}\n\n") + &section(columns, rows))
        .collect()
}

fn section(columns: &TableWriter, rows: &Value) -> String {
    let definitions = rows["$defs"].as_object().unwrap();
    let fields: Vec<(&String, &Value)> = [rows]
        .into_iter()
        .chain(definitions.values())
        .filter_map(|part| part["properties"].as_object())
        .flatten()
        .collect();
    let field = |name: &str| {
        fields
            .iter()
            .find(|(key, _)| *key == name)
            .map(|(_, field)| *field)
    };
    let suffix = format!("_{VIEW}");
    let mut lines: Vec<[String; 4]> = Vec::new();
    let mut values = String::new();
    for (column, range) in columns.columns() {
        let base = column.name().trim_end_matches(&suffix);
        let is_pose = |start: &&&str| {
            let rest = base.strip_prefix(**start);
            rest.is_some_and(|rest| rest != "hfov_deg")
        };
        let (name, range, found) = if let Some(start) = ["echo_", "camera_"].iter().find(is_pose) {
            // The pose of the aircraft or of a camera: one line for its six numbers.
            (format!("{start}<pose column>{suffix}"), None, None)
        } else {
            let own = base.trim_start_matches("camera_");
            (column.name().clone(), range, field(own))
        };
        let other = || {
            let (_, key) = OTHER_NAMES
                .iter()
                .find(|(start, _)| base.starts_with(start))?;
            field(key)
        };
        let found = found
            .or_else(other)
            .unwrap_or_else(|| panic!("no field for the column {name}"));
        let null = if column.is_nullable() { ", null" } else { "" };
        let line = [
            format!("`{name}`"),
            format!("{}{null}", type_name(&column.data_type().to_string())),
            range
                .map(|range| limits(Some(range.least), Some(range.most)))
                .unwrap_or_default(),
            found["description"].as_str().unwrap_or_default().to_owned(),
        ];
        if lines.last() != Some(&line) {
            values += &described_values(&name, found, rows);
            lines.push(line);
        }
    }
    table(["column", "type", "limits", "meaning"], &lines) + &values
}

fn type_name(arrow: &str) -> &str {
    match arrow {
        "Float64" => "f64",
        "Int64" => "i64",
        "UInt32" => "u32",
        "UInt64" => "u64",
        "Boolean" => "bool",
        "Binary" => "bytes",
        "Utf8" => "string",
        other => panic!("a name for the type {other}"),
    }
}
