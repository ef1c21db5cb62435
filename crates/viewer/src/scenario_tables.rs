//! Everything about one scenario but its images, as columns: ticks, boxes, registrations, and what the runs answered. Whatever
//! cannot be read is left out and named.

use std::collections::BTreeMap;

use dataset::corpus::detections::{self, Detections, models_of};
use dataset::corpus::scenario::ScenarioRecord;
use dataset::tables::frames::TickRow;
use dataset::tables::pixel_box::{PixelBox, TruthBox};
use dataset::tables::registrations::{Registration, Shift};
use serde::Serialize;

use crate::library::Library;
use crate::opened::Opened;
use crate::path::place;
use crate::problems::Problems;
use crate::rounded::{column, thousandths};
use crate::run::Flight;
use crate::server::refusal::Refusal;

/// A scenario's tables.
#[derive(Debug, Serialize)]
pub(crate) struct ScenarioTables {
    record: ScenarioRecord,
    views: Vec<View>,
    ticks: Option<Ticks>,
    /// Findings by model.
    models: Vec<Model>,
    /// Answers in the order of the runs; `None` for a run without this scenario, or with a different one of this name.
    runs: Vec<Option<Flight>>,
    problems: Vec<String>,
}

#[derive(Debug, Serialize)]
struct View {
    id: String,
    width_px: u32,
    height_px: u32,
    hfov_deg: f64,
    /// Ground-truth boxes; `None` without labels.
    truth: Option<TruthColumns>,
}

/// A row for each tick.
#[derive(Debug, Default, Serialize)]
struct Ticks {
    time_s: Vec<f64>,
    /// `None` without labels.
    dtd_m: Option<Vec<f64>>,
    along_track_m: Vec<f64>,
    cross_track_m: Vec<f64>,
    height_over_target_m: Vec<f64>,
    ground_speed_mps: Vec<f64>,
    true_airspeed_mps: Vec<f64>,
    climb_mps: Vec<f64>,
    heading_true_deg: Vec<f64>,
    pitch_deg: Vec<f64>,
    roll_deg: Vec<f64>,
    on_ground: Vec<bool>,
}

#[derive(Debug, Default, Serialize)]
struct BoxColumns {
    tick: Vec<u32>,
    cx_px: Vec<f64>,
    cy_px: Vec<f64>,
    width_px: Vec<f64>,
    height_px: Vec<f64>,
}

#[derive(Debug, Default, Serialize)]
struct TruthColumns {
    #[serde(flatten)]
    boxes: BoxColumns,
    visible_fraction: Vec<f64>,
    transmission: Vec<f64>,
    /// 0: the first aircraft.
    aircraft_number: Vec<u32>,
}

/// A model's findings.
#[derive(Debug, Serialize)]
struct Model {
    /// Model file and hash, as far as they are known.
    name: String,
    hash: String,
    /// Detections by view.
    detections: BTreeMap<String, DetectionColumns>,
    /// Registrations by view.
    registrations: BTreeMap<String, RegistrationColumns>,
}

#[derive(Debug, Default, Serialize)]
struct DetectionColumns {
    #[serde(flatten)]
    boxes: BoxColumns,
    score: Vec<f64>,
    confirmed: Vec<bool>,
    mode: Vec<&'static str>,
    /// Images without a box, and why.
    missed_tick: Vec<u32>,
    missed_reason: Vec<&'static str>,
}

#[derive(Debug, Default, Serialize)]
struct RegistrationColumns {
    reference: String,
    tick: Vec<u32>,
    /// The point in the reference view that was followed.
    x_px: Vec<Option<f64>>,
    y_px: Vec<Option<f64>>,
    dx_px: Vec<Option<f64>>,
    dy_px: Vec<Option<f64>>,
    reason: Vec<Option<&'static str>>,
}

pub(crate) fn read(library: &Library, opened: &Opened) -> Result<ScenarioTables, Refusal> {
    let mut problems = Problems::default();
    let files = &opened.files;
    let flown = problems.or_none(files.frames().map(|frames| Some(frames.rows)));
    let truth = problems.or_none(files.truth_boxes_if_labelled());
    let cameras = problems.or_none(files.calibration().map(|all| all.cameras));
    let view = |id: &String| {
        let camera = cameras.get(id);
        View {
            id: id.clone(),
            width_px: camera.map_or(0, |camera| camera.width_px),
            height_px: camera.map_or(0, |camera| camera.height_px),
            hfov_deg: camera.map_or(0.0, |camera| thousandths(camera.placed.hfov_deg)),
            truth: truth.as_ref().map(|boxes| TruthColumns::of(boxes, id)),
        }
    };
    let views = opened.record.views.iter().map(view).collect();
    let mut models = Vec::new();
    for hash in models_of(files.folder()).unwrap_or_default() {
        models.extend(problems.or_none(model(opened, hash).map(Some)));
    }
    let id = files.id();
    let mut runs = Vec::new();
    for run in &library.runs {
        let flight = run.answers().flights.get(&id);
        let both = flight.zip(flown.as_deref());
        match both.and_then(|(flight, flown)| flight.other_than(&id, flown)) {
            None => runs.push(flight.cloned()),
            Some(other) => {
                problems.0.push(format!("run {} {other}", run.name));
                runs.push(None);
            }
        }
    }
    Ok(ScenarioTables {
        record: opened.record.clone(),
        views,
        ticks: flown.map(|rows| ticks(opened, &rows)),
        models,
        runs,
        problems: problems.0,
    })
}

fn ticks(opened: &Opened, rows: &[TickRow]) -> Ticks {
    let labels: Option<Vec<f64>> = rows.iter().map(|row| Some(row.labels?.dtd_m)).collect();
    let places: Vec<_> = rows.iter().map(|row| place(opened, row)).collect();
    let speed = |[north, east, _]: [f64; 3]| north.hypot(east);
    Ticks {
        time_s: column(rows.iter().map(|row| row.time_ns as f64 / 1e9)),
        dtd_m: labels.map(column),
        along_track_m: column(places.iter().map(|at| at.along_track_m)),
        cross_track_m: column(places.iter().map(|at| at.cross_track_m)),
        height_over_target_m: column(places.iter().map(|at| at.height_over_target_m)),
        ground_speed_mps: column(rows.iter().map(|row| speed(row.velocity_ned_mps))),
        true_airspeed_mps: column(rows.iter().map(|row| row.true_airspeed_mps)),
        climb_mps: column(rows.iter().map(|row| -row.velocity_ned_mps[2])),
        heading_true_deg: column(rows.iter().map(|row| row.pose.heading_true_deg)),
        pitch_deg: column(rows.iter().map(|row| row.pose.pitch_deg)),
        roll_deg: column(rows.iter().map(|row| row.pose.roll_deg)),
        on_ground: rows.iter().map(|row| row.on_ground).collect(),
    }
}

impl BoxColumns {
    fn push(&mut self, tick: u32, pixel_box: &PixelBox) {
        self.tick.push(tick);
        self.cx_px.push(thousandths(pixel_box.cx_px));
        self.cy_px.push(thousandths(pixel_box.cy_px));
        self.width_px.push(thousandths(pixel_box.width_px));
        self.height_px.push(thousandths(pixel_box.height_px));
    }
}

impl TruthColumns {
    fn of(boxes: &[TruthBox], view: &str) -> Self {
        let mut columns = Self::default();
        for real in boxes.iter().filter(|real| real.view == view) {
            columns.boxes.push(real.tick, &real.pixel_box);
            columns
                .visible_fraction
                .push(thousandths(real.visible_fraction));
            columns.transmission.push(thousandths(real.transmission));
            columns.aircraft_number.push(real.number());
        }
        columns
    }
}

fn model(opened: &Opened, hash: String) -> dataset::Result<Model> {
    let files = &opened.files;
    let found = files.detections(&hash)?;
    let registrations = files.registrations(&hash)?;
    Ok(Model {
        name: detections::named(files.folder(), &hash).to_string(),
        detections: detection_columns(&found),
        registrations: registration_columns(&registrations.unwrap_or_default()),
        hash,
    })
}

fn detection_columns(found: &Detections) -> BTreeMap<String, DetectionColumns> {
    let mut views: BTreeMap<String, DetectionColumns> = BTreeMap::new();
    for detection in &found.boxes {
        let columns = views.entry(detection.view.clone()).or_default();
        columns.boxes.push(detection.tick, &detection.pixel_box);
        columns.score.push(thousandths(detection.score));
        columns.confirmed.push(detection.confirmed);
        columns.mode.push(detection.mode.word());
    }
    for miss in &found.misses {
        let columns = views.entry(miss.view.clone()).or_default();
        columns.missed_tick.push(miss.tick);
        columns.missed_reason.push(miss.reason.word());
    }
    views
}

fn registration_columns(rows: &[Registration]) -> BTreeMap<String, RegistrationColumns> {
    let mut views: BTreeMap<String, RegistrationColumns> = BTreeMap::new();
    for row in rows {
        let columns = views.entry(row.view.clone()).or_default();
        columns.reference.clone_from(&row.reference);
        columns.tick.push(row.tick);
        let result = row.result.as_ref();
        let px = |of: fn(&Shift) -> f64| result.ok().map(|shift| thousandths(of(shift)));
        columns.x_px.push(px(|shift| shift.x_px));
        columns.y_px.push(px(|shift| shift.y_px));
        columns.dx_px.push(px(|shift| shift.dx_px));
        columns.dy_px.push(px(|shift| shift.dy_px));
        columns
            .reason
            .push(result.err().map(|reason| reason.word()));
    }
    views
}
