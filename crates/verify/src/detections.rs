//! Detections, registrations, health and backgrounds, if there are any: they were made from the current videos, their records and tables
//! can be read and belong together, the counts and settings of the records are possible, every row refers to an image of the scenario, no
//! image has two rows of registration or of health, and no view has two backgrounds.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::PathBuf;

use serde::Deserialize;
use serde_json::Value;

use crate::faults::Faults;
use dataset::corpus::ScenarioFolder;
use dataset::corpus::detections::{self, Detection, Row};
use dataset::corpus::open_scenario::{OpenScenario, RowFault, fault_of, fault_of_registration};
use dataset::corpus::scenario::ScenarioRecord;
use dataset::files::json_file::read_json;
use dataset::files::own_path::own_path;
use dataset::numbers::limits::{self, MAX_PICTURES};
use dataset::tables::backgrounds::ViewBackground;
use dataset::tables::health::ViewHealth;
use dataset::tables::image_rows::ImageRow;
use dataset::tables::registrations::Registration;

/// The record besides the table's origin. Other programs may write less.
#[derive(Default, Deserialize)]
#[serde(default)]
struct Counts {
    pictures: Option<u64>,
    detections: Option<u64>,
    misses: Option<u64>,
    seconds: Option<f64>,
    settings: BTreeMap<String, Value>,
    registration: Option<RegistrationCounts>,
}

/// Counts of registrations in a record.
#[derive(Default, Deserialize)]
#[serde(default)]
struct RegistrationCounts {
    reference: Option<String>,
    pairs: Option<u64>,
    answered: Option<u64>,
    seconds: Option<f64>,
}

/// A model's detections in a scenario.
struct OfModel<'a> {
    folder: &'a ScenarioFolder,
    model: &'a str,
    /// Missing if it cannot be opened.
    scenario: Option<&'a OpenScenario>,
    /// Missing if `scenario.json` cannot be read.
    record: Option<&'a ScenarioRecord>,
    pictures: u64,
}

/// Checks the detections of all models. `record` is missing if `scenario.json` cannot be read.
pub(super) fn check(folder: &ScenarioFolder, record: Option<&ScenarioRecord>, faults: &mut Faults) {
    // Faults of the scenario itself are reported elsewhere.
    let scenario = folder.open().ok();
    let models = faults.keep(detections::FOLDER, detections::models_of(folder));
    let models = models.unwrap_or_default();
    for parent in [
        detections::REGISTRATIONS,
        detections::HEALTH,
        detections::BACKGROUNDS,
    ] {
        check_owners(folder, parent, &models, faults);
    }
    for model in &models {
        let of_model = OfModel {
            folder,
            model,
            scenario: scenario.as_ref(),
            record,
            pictures: record.map_or(MAX_PICTURES, ScenarioRecord::pictures),
        };
        of_model.check(faults);
    }
}

impl OfModel<'_> {
    fn check(&self, faults: &mut Faults) {
        let Self { folder, model, .. } = *self;
        let registered = self.check_registrations(faults);
        self.check_health(faults);
        self.check_backgrounds(faults);
        let file = format!("{}/{model}.parquet", detections::FOLDER);
        let mut path = folder.detections_path(model);
        let record_file = format!("{}/{model}.json", detections::FOLDER);
        let provenance = faults.keep(&record_file, detections::provenance(folder, model));
        if provenance.is_some()
            && let Some(scenario) = self.scenario
            && let Some((current, _)) = faults.keep(&file, scenario.detections_table(model))
        {
            path = current;
        }
        if !path.exists() {
            return;
        }
        let read = Row::read_with_faults(&path, self.pictures);
        let Some(found) = faults.keep_table(&file, read) else {
            return;
        };
        check_rows(&file, &found, self.record, faults);
        let path = detections::record_path(folder, model);
        if matches!(provenance, Some(Some(_)))
            && let Some(counts) =
                faults.keep(&record_file, read_json(&path, "record of detections"))
        {
            check_counts(&record_file, &counts, &found, self.record, faults);
            let said = counts.registration.unwrap_or_default();
            if let Some(rows) = registered {
                check_registration_counts(&record_file, &said, &rows, faults);
            }
        }
    }

    fn check_registrations(&self, faults: &mut Faults) -> Option<Vec<Registration>> {
        let (file, rows) = self.rows(detections::REGISTRATIONS, faults)?;
        let keys = rows.iter().map(|row| {
            let fault = self
                .record
                .and_then(|record| fault_of_registration(row, record));
            (row.tick, row.view.as_str(), fault)
        });
        check_keys(&file, "registration", keys, faults);
        Some(rows)
    }

    fn check_health(&self, faults: &mut Faults) {
        if let Some((file, rows)) = self.rows::<ViewHealth>(detections::HEALTH, faults) {
            let keys = rows.iter().map(|row| {
                let fault = self
                    .record
                    .and_then(|record| fault_of(row.tick, &row.view, record));
                (row.tick, row.view.as_str(), fault)
            });
            check_keys(&file, "health", keys, faults);
        }
    }

    fn check_backgrounds(&self, faults: &mut Faults) {
        if let Some((file, rows)) = self.rows::<ViewBackground>(detections::BACKGROUNDS, faults) {
            let mut views = BTreeSet::new();
            for (number, row) in rows.iter().enumerate() {
                let fault = self
                    .record
                    .and_then(|record| fault_of(row.tick, &row.view, record));
                if let Some((column, message)) = fault {
                    faults.row(&file, number, column, message);
                } else if !views.insert(&row.view) {
                    let message = "the view has a background already";
                    faults.view_row(&row.view, &file, number, "background", message);
                }
            }
        }
    }

    /// Name and rows of a table that the record of the detections names.
    fn rows<R: ImageRow>(&self, parent: &str, faults: &mut Faults) -> Option<(String, Vec<R>)> {
        let (file, path) = self.table(parent, faults)?;
        let rows = faults.keep_table(&file, R::read_with_faults(&path, self.pictures))?;
        Some((file, rows))
    }

    /// Name and path of the table that the record of the detections names.
    fn table(&self, parent: &str, faults: &mut Faults) -> Option<(String, PathBuf)> {
        let Self { folder, model, .. } = *self;
        // Without a record of the detections there is a different fault.
        let provenance = detections::provenance(folder, model).ok()??;
        let file = format!("{parent}/{model}.parquet");
        let mut path = folder.root().join(&file);
        let tables = provenance.tables(model);
        if !tables.iter().any(|table| table.name == file) {
            if path.exists() {
                let message =
                    "is not named by the record of the detections; run `dtd detect` again";
                faults.file(&file, message);
            }
            return None;
        }
        if let Some(scenario) = self.scenario
            && let Some(Some((current, _))) = faults.keep(&file, scenario.table(parent, model))
        {
            path = current;
        }
        path.exists().then_some((file, path))
    }
}

/// Each row belongs to an image of the scenario, and no two to the same.
fn check_keys<'a>(
    file: &str,
    kind: &'static str,
    rows: impl Iterator<Item = (u32, &'a str, Option<RowFault>)>,
    faults: &mut Faults,
) {
    let mut known = BTreeSet::new();
    for (row, (tick, view, fault)) in rows.enumerate() {
        match fault {
            Some((column @ "tick", message)) => faults.view_row(view, file, row, column, message),
            Some((column, message)) => faults.row(file, row, column, message),
            None if !known.insert((tick, view)) => {
                let message = format!("tick {tick} of the view is there already");
                faults.view_row(view, file, row, kind, message);
            }
            None => {}
        }
    }
}

/// Every table of registrations, health or backgrounds belongs to detections.
fn check_owners(folder: &ScenarioFolder, parent: &str, models: &[String], faults: &mut Faults) {
    let Some(path) = faults.keep(parent, own_path(folder.root(), parent)) else {
        return;
    };
    let Ok(entries) = fs::read_dir(&path) else {
        return;
    };
    for name in entries.flatten().map(|entry| entry.file_name()) {
        let name = name.to_string_lossy();
        if let Some(model) = name.strip_suffix(".parquet")
            && !models.iter().any(|known| known == model)
        {
            let file = format!("{parent}/{name}");
            faults.file(
                &file,
                "belongs to no detections; remove it, or run `dtd detect`",
            );
        }
    }
}

fn check_registration_counts(
    file: &str,
    said: &RegistrationCounts,
    rows: &[Registration],
    faults: &mut Faults,
) {
    let answered = rows.iter().filter(|row| row.result.is_ok()).count();
    let counts = [
        ("registration.pairs", said.pairs, Some(rows.len())),
        ("registration.answered", said.answered, Some(answered)),
    ];
    check_numbers(
        file,
        &counts,
        ("registration.seconds", said.seconds),
        faults,
    );
    if let Some(reference) = &said.reference
        && let Some(other) = rows.iter().find(|row| row.reference != *reference)
    {
        let message = format!(
            "registration.reference is {reference:?}, expected {:?} as in the table",
            other.reference
        );
        faults.file(file, message);
    }
}

/// Compares the counts in a record with its table, and checks that its time is possible.
fn check_numbers(
    file: &str,
    counts: &[(&str, Option<u64>, Option<usize>)],
    (name, seconds): (&str, Option<f64>),
    faults: &mut Faults,
) {
    for (what, found, expected) in counts {
        if let (Some(found), Some(expected)) = (found, expected)
            && *found != *expected as u64
        {
            faults.file(file, format!("{what} is {found}, expected {expected}"));
        }
    }
    if let Some(seconds) = seconds.filter(|seconds| !(0.0..=1e10).contains(seconds)) {
        let message = format!("{name} is {seconds:e}, expected a time from 0 to 1e10");
        faults.file(file, message);
    }
}

/// Checks that boxes below `score` are confirmed, and that none is below `faint_score`.
fn check_scores(file: &str, counts: &Counts, rows: &[Row], faults: &mut Faults) {
    let setting = |name| counts.settings.get(name).and_then(Value::as_f64);
    let (Some(score), Some(faint)) = (setting("score"), setting("faint_score")) else {
        return;
    };
    for row in rows {
        let Row::Box(found) = row else { continue };
        let counts = found.confirmed || found.counts_live == Some(true);
        let (name, least, what) = if counts {
            ("faint_score", faint.min(score), "a box")
        } else {
            ("score", score, "a box that does not count")
        };
        if found.score < least {
            let Detection {
                view, tick, score, ..
            } = found;
            let message = format!(
                "settings.{name} is above {score}, the score of {what} of view {view} at tick {tick}"
            );
            faults.file(file, message);
            return;
        }
    }
}

fn check_counts(
    file: &str,
    counts: &Counts,
    rows: &[Row],
    record: Option<&ScenarioRecord>,
    faults: &mut Faults,
) {
    let boxes = rows.iter().filter(|row| matches!(row, Row::Box(_))).count();
    let pictures = record.map(|record| record.pictures() as usize);
    let numbers = [
        ("pictures", counts.pictures, pictures),
        ("detections", counts.detections, Some(boxes)),
        ("misses", counts.misses, Some(rows.len() - boxes)),
    ];
    check_numbers(file, &numbers, ("seconds", counts.seconds), faults);
    check_scores(file, counts, rows, faults);
    for (name, limits) in [
        ("tile_score", limits::RATIO),
        ("score", limits::RATIO),
        ("faint_score", limits::RATIO),
        ("merge_iou", limits::RATIO),
        ("most_windows", limits::WINDOWS),
    ] {
        let value = counts.settings.get(name);
        // NaN is never in range.
        let number = value.map(|value| value.as_f64().unwrap_or(f64::NAN));
        if let Some(Err(fault)) = number.map(|number| limits.check(number)) {
            faults.file(file, format!("settings.{name} {fault}"));
        }
    }
}

/// Every row belongs to an image of the scenario, boxes have an area, and an image with the reason why it has no box has none.
fn check_rows(file: &str, rows: &[Row], record: Option<&ScenarioRecord>, faults: &mut Faults) {
    let mut rows_of_pictures = BTreeMap::<_, usize>::new();
    for row in rows {
        *rows_of_pictures
            .entry((row.tick(), row.view()))
            .or_default() += 1;
    }
    for (number, row) in rows.iter().enumerate() {
        let view = row.view().as_str();
        match record.and_then(|record| fault_of(row.tick(), row.view(), record)) {
            Some((kind @ "view", message)) => faults.row(file, number, kind, message),
            Some((kind, message)) => faults.view_row(view, file, number, kind, message),
            None => {}
        }
        let message = match row {
            Row::Box(found) if found.pixel_box.area() == 0.0 => {
                format!("{:?} has no area", found.pixel_box)
            }
            Row::Miss(miss) if rows_of_pictures[&(row.tick(), row.view())] > 1 => format!(
                "tick {} of the view has the reason {:?} for no box, and other rows too",
                miss.tick,
                miss.reason.word()
            ),
            Row::Box(_) | Row::Miss(_) => continue,
        };
        faults.view_row(view, file, number, "detection", message);
    }
}
