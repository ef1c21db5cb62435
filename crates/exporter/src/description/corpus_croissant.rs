//! `croissant.json` of a corpus: its files as they are, with the hashes of the manifests that seal its scenarios.

use std::collections::BTreeSet;
use std::fs;
use std::path::PathBuf;

use dataset::corpus::detections::models_of;
use dataset::corpus::seal::{self, MANIFEST};
use dataset::corpus::{Corpus, ScenarioFolder};
use dataset::files::json_file::{read_json, write_json};
use dataset::files::own_path::own_path;
use serde_json::{Value, json};

use crate::description::about::About;
use crate::description::columns_text::{BOXES, Column, DETECTIONS, Kind, TICKS};
use crate::description::croissant::{
    CROISSANT, Contents, Field, FileSet, JSON, ListedFile, PARQUET, RecordSet, describe,
    json_path_in, part_of_path,
};
use crate::error::{Error, Result};
use crate::export::ExportOutcome;
use crate::scenarios::sides;

const RECORDS: &str = "scenario-records";
const CALIBRATIONS: &str = "calibrations";
const VIDEOS: &str = "videos";
const FRAMES: &str = "frames";
const TRUTH_BOXES: &str = "boxes-truth";
const DETECTED: &str = "detections-tables";

/// Columns of `frames.parquet` after `dtd label`.
const LABELS: [&str; 5] = [
    "dtd_m",
    "along_track_m",
    "cross_track_m",
    "height_over_target_m",
    "time_to_touchdown_s",
];

/// Writes `croissant.json` into the corpus, which describes it as it is now; returns its path, and what it describes.
///
/// # Errors
/// The corpus has no scenario, a record or table does not match its seal, or the file cannot be written.
pub fn describe_corpus(
    corpus: &Corpus,
    license: Option<String>,
) -> Result<(PathBuf, ExportOutcome)> {
    let path = own_path(corpus.root(), CROISSANT)?;
    write_json(&path, &description(corpus, license)?)?;
    let mut described = ExportOutcome::default();
    for folder in corpus.scenarios()? {
        let scenario = folder.open()?;
        let frames = scenario.frames()?;
        described.scenarios += 1;
        described.pictures += (frames.rows.len() * frames.views.len()) as u64;
        let boxes = scenario.truth_boxes_if_labelled()?;
        described.boxes += boxes.map_or(0, |boxes| boxes.len() as u64);
    }
    let written = fs::metadata(&path).map_err(dataset::Error::io("read the size of", &path))?;
    described.bytes = written.len();
    Ok((path, described))
}

/// Returns whether the corpus's `croissant.json` matches what this version would write for the current corpus; `None` if there is none.
///
/// # Errors
/// See [`describe_corpus`]; also fails if `croissant.json` cannot be read.
pub fn is_described_as_it_is(corpus: &Corpus) -> Result<Option<bool>> {
    let path = own_path(corpus.root(), CROISSANT)?;
    if !path.exists() {
        return Ok(None);
    }
    let found: Value = read_json(&path, "description of the corpus")?;
    let license = found["license"].as_str().map(str::to_owned);
    Ok(Some(description(corpus, license)? == found))
}

fn description(corpus: &Corpus, license: Option<String>) -> Result<Value> {
    let mut about = About::new(corpus, license)?;
    let mut contents = Contents::default();
    for (name, form) in [
        (Corpus::SWEEP, "application/toml"),
        (Corpus::PLAN, JSON),
        (Corpus::SPLITS, JSON),
    ] {
        if own_path(corpus.root(), name)?.is_file() {
            contents.files.push(ListedFile::new(name, form));
        }
    }
    let sides = sides(corpus, false)?;
    let (mut scenarios, mut labelled, mut detected) = (Vec::new(), Vec::new(), Vec::new());
    let mut videos = Vec::new();
    let mut models = BTreeSet::new();
    for folder in corpus.scenarios()? {
        let (id, scenario) = (folder.id(), folder.open()?);
        let record = scenario.record()?;
        about.add(&record, sides.get(&id).map(|assignment| assignment.side));
        for view in &record.views {
            videos.push(format!("scenarios/{id}/{}", scenario.video_name(view)?));
        }
        if scenario.truth_boxes_if_labelled()?.is_some() {
            labelled.push(id.clone());
        }
        for model in models_of(&folder)? {
            detected.push(format!("scenarios/{id}/detections/{model}.parquet"));
            models.insert(model);
        }
        let manifest = seal::current_path(folder.root(), MANIFEST)?;
        let manifest = manifest.file_name().unwrap_or_default().to_string_lossy();
        let name = format!("scenarios/{id}/{manifest}");
        contents.files.push(ListedFile::new(name, "text/plain"));
        scenarios.push(id);
    }
    if scenarios.is_empty() {
        return Err(Error::Nothing);
    }
    about.models = models;
    let in_each = |ids: &[String], name: &str| -> Vec<String> {
        ids.iter()
            .map(|id| format!("scenarios/{id}/{name}"))
            .collect()
    };
    let all_labelled = labelled.len() == scenarios.len();
    let tables = [
        (
            RECORDS,
            in_each(&scenarios, "scenario.json"),
            JSON,
            "All parameters of a scenario.",
        ),
        (
            CALIBRATIONS,
            in_each(&scenarios, "calibration.json"),
            JSON,
            "The cameras of a scenario.",
        ),
        (
            VIDEOS,
            videos,
            "video/mp4",
            "A video per scenario and view, an image per tick.",
        ),
        (
            FRAMES,
            in_each(&scenarios, ScenarioFolder::FRAMES),
            PARQUET,
            "The ticks of a scenario.",
        ),
        (
            TRUTH_BOXES,
            in_each(&labelled, ScenarioFolder::TRUTH_BOXES),
            PARQUET,
            "Ground-truth boxes.",
        ),
        (DETECTED, detected, PARQUET, "Boxes that a model found."),
    ];
    for (id, includes, form, what) in tables {
        if !includes.is_empty() {
            let set = FileSet::new(id, "", form, what);
            contents.sets.push(FileSet { includes, ..set });
        }
    }
    contents.records = vec![records(), ticks(all_labelled)];
    if !labelled.is_empty() {
        contents.records.push(boxes());
    }
    if !about.models.is_empty() {
        contents.records.push(detections());
    }
    describe(corpus.root(), &about, &contents)
}

fn records() -> RecordSet {
    let field = |name, kind, meaning, path: &str| {
        Field::new(name, kind, meaning, json_path_in(RECORDS, path))
    };
    RecordSet {
        name: "scenarios",
        what: "A record per scenario: a recorded approach.".into(),
        fields: vec![
            field("scenario", Kind::Text, "identifier", "$.id"),
            field(
                "trajectory",
                Kind::Text,
                "what is flown; scenarios of one trajectory are on one side of the split",
                "$.trajectory",
            ),
            field(
                "weather",
                Kind::Text,
                "name of the weather",
                "$.conditions.weather_name",
            ),
            field(
                "time_of_day",
                Kind::Text,
                "local time, HH:MM",
                "$.conditions.time_of_day",
            ),
            field(
                "visibility_m",
                Kind::F64,
                "meteorological visibility",
                "$.conditions.weather.visibility_m",
            ),
            field("aircraft", Kind::Text, "type of the aircraft", "$.aircraft"),
            field(
                "airport",
                Kind::Text,
                "ICAO identifier of the airport",
                "$.runway.airport",
            ),
            field("runway", Kind::Text, "name of the runway", "$.runway.name"),
            field("ticks", Kind::U32, "number of ticks", "$.ticks"),
            field(
                "simulator",
                Kind::Text,
                "what drew the images",
                "$.versions.simulator",
            ),
            field(
                "config_hash",
                Kind::Text,
                "BLAKE3 hash of all parameters",
                "$.config_hash",
            ),
        ],
    }
}

/// Columns of tables of single scenarios, after the scenario's identifier, which is in the path.
fn of_tables<'a>(set: &str, columns: impl Iterator<Item = &'a Column>) -> Vec<Field> {
    let scenario = part_of_path(set, ".*scenarios/([^/]+)/");
    let mut fields = vec![Field::new(
        "scenario",
        Kind::Text,
        "identifier of the scenario",
        scenario,
    )];
    fields.extend(columns.filter(|column| column.name != "scenario").map(|column| Field {
        column: *column,
        source: json!({"fileSet": {"@id": set}, "extract": {"column": in_corpus(column.name)}}),
    }));
    fields
}

/// The name in the corpus of a column that exports call otherwise.
fn in_corpus(column: &'static str) -> &'static str {
    match column {
        "truncated_fraction" => "truncation",
        "transmission_ratio" => "transmission",
        other => other,
    }
}

fn ticks(are_labelled: bool) -> RecordSet {
    let columns = TICKS.columns.iter();
    let there = columns.filter(|column| are_labelled || !LABELS.contains(&column.name));
    RecordSet {
        name: TICKS.name,
        what: format!("A record per {}.", TICKS.row),
        fields: of_tables(FRAMES, there),
    }
}

fn boxes() -> RecordSet {
    // Visibility follows from the scenario's weather and is not stored.
    let columns = BOXES.columns.iter();
    let stored = columns.filter(|column| !["sight", "is_expected"].contains(&column.name));
    RecordSet {
        name: BOXES.name,
        what: format!("A record per {}.", BOXES.row),
        fields: of_tables(TRUTH_BOXES, stored),
    }
}

fn detections() -> RecordSet {
    let columns = DETECTIONS
        .columns
        .iter()
        .filter(|column| column.name != "model");
    let mut fields = of_tables(DETECTED, columns);
    let model = part_of_path(DETECTED, ".*detections/([^/]+)[.]parquet$");
    let meaning = "start of the hash of the model and its settings";
    fields.push(Field::new("model", Kind::Text, meaning, model));
    RecordSet {
        name: DETECTIONS.name,
        what: "A record per detected box, or per image without one, whose numbers are missing."
            .into(),
        fields,
    }
}
