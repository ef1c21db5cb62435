mod boxes;
mod detection_tables;
mod flight;
mod plan_and_split;
mod recorded_videos;
mod records;
mod registration_tables;
mod sealed_files;
mod stray_folders;

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_array::cast::AsArray;
use arrow_array::types::Float64Type;
use arrow_array::{Float64Array, RecordBatch};
use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use serde_json::{Value, json};

use super::*;
use dataset::conditions::{Clock, Conditions, Weather};
use dataset::corpus::detections::{
    self, Detection, Detections, Miss, MissReason, NewTables, SearchMode,
};
use dataset::corpus::effective_weather::{EffectiveQuantity, EffectiveWeather};
use dataset::corpus::model_identity::ModelIdentity;
use dataset::corpus::scenario::{Blocks, Flight, PINHOLE_SCHEMA_VERSION, Versions};
use dataset::corpus::splits::{Assignment, Side, Splits};
use dataset::files::json_file::{read_json, write_json};
use dataset::geometry::camera::{Camera, CameraPose};
use dataset::geometry::pose::{Controls, Pose};
use dataset::geometry::runway::RunwayCoordinates;
use dataset::numbers::frame_rate::FrameRate;
use dataset::plan::{Plan, PlannedCamera, plan_hash};
use dataset::tables::backgrounds::ViewBackground;
use dataset::tables::frames::{Frames, TickLabels, TickRow, ViewStamp};
use dataset::tables::health::{CameraTurn, HealthState, ViewHealth};
use dataset::tables::image_rows::ImageRow;
use dataset::tables::pixel_box::{PixelBox, TruthBox};
use dataset::tables::registrations::{NoShift, Registration};
use dataset::video::{VideoSettings, VideoWriter};
use testkit::changi_02l as runway;

const SIZE_PX: u32 = 64;
const TICKS: u32 = 5;
const RATE: FrameRate = FrameRate {
    numerator: 1,
    denominator: 2,
};
const SPEED_MPS: f64 = 70.0;
const VIEWS: [&str; 2] = ["left", "right"];

fn camera(view: usize) -> CameraPose {
    let at = runway().point_on_approach(-1_500.0, if view == 0 { -300.0 } else { 300.0 });
    let pose = Pose {
        latitude_deg: at.latitude_deg,
        longitude_deg: at.longitude_deg,
        altitude_msl_m: 16.71,
        heading_true_deg: if view == 0 { 197.72 } else { 208.32 },
        pitch_deg: 1.6,
        roll_deg: 0.0,
    };
    CameraPose {
        pose,
        hfov_deg: 10.0,
    }
}

/// The planned camera that [`camera`] follows from.
fn planned_camera(view: usize) -> PlannedCamera {
    PlannedCamera {
        id: VIEWS[view].into(),
        beyond_touchdown_m: Some(1_500.0),
        beyond_threshold_m: None,
        right_m: if view == 0 { -300.0 } else { 300.0 },
        height_m: 10.0,
        inward_deg: Some(5.3),
        heading_true_deg: None,
        pitch_deg: 1.6,
        hfov_deg: 10.0,
        distortion: None,
    }
}

/// A level flight along the course that passes the target between the last two ticks.
fn frame(tick: u32) -> TickRow {
    let time_s = RATE.time_of_tick(tick).seconds();
    let passing_s = 7.0;
    let at = runway().point_on_approach(SPEED_MPS * (passing_s - time_s), 3.0);
    let pose = Pose {
        latitude_deg: at.latitude_deg,
        longitude_deg: at.longitude_deg,
        altitude_msl_m: 60.0,
        heading_true_deg: 23.02,
        pitch_deg: 2.0,
        roll_deg: 0.0,
    };
    let course = runway().course_true_deg.to_radians();
    let place = RunwayCoordinates::of(
        pose.position(),
        runway().touchdown_target(),
        runway().course_true_deg,
    );
    let stamp = |view: usize| ViewStamp {
        sim_frame: 100 + u64::from(tick) * 2 + view as u64,
        pts: RATE.pts_of_tick(tick),
        echoed_pose: pose,
        echoed_camera: camera(view),
    };
    TickRow {
        tick,
        time_ns: RATE.time_of_tick(tick).0,
        pose,
        velocity_ned_mps: [SPEED_MPS * course.cos(), SPEED_MPS * course.sin(), 0.0],
        true_airspeed_mps: SPEED_MPS,
        controls: Controls {
            flap_ratio: 1.0,
            gear_ratio: 1.0,
        },
        on_ground: false,
        views: vec![stamp(0), stamp(1)],
        image_times_ns: Vec::new(),
        dtd_sd_m: None,
        labels: Some(TickLabels {
            dtd_m: place.dtd_m,
            along_track_m: place.along_track_m,
            cross_track_m: place.cross_track_m,
            height_over_target_m: place.height_over_target_m,
            time_to_touchdown_s: Some(passing_s - time_s),
        }),
    }
}

fn frames() -> Frames {
    Frames {
        views: VIEWS.map(str::to_owned).to_vec(),
        rows: (0..TICKS).map(frame).collect(),
    }
}

fn record(id: &str) -> ScenarioRecord {
    ScenarioRecord {
        schema_version: PINHOLE_SCHEMA_VERSION,
        id: id.into(),
        trajectory: format!("live-{id}"),
        seed: Some(1),
        plan_hash: Some("plan".into()),
        config_hash: "config".into(),
        aircraft: "B737-800".into(),
        traffic: Vec::new(),
        frame_rate: RATE,
        ticks: TICKS,
        runway: runway(),
        touchdown: runway().touchdown_target(),
        flight_touchdown: None,
        geoid: None,
        conditions: Some(Conditions {
            time_of_day: "06:00".into(),
            clock: Clock {
                day_of_year: 171,
                zulu_time_s: 79_200.0,
            },
            weather_name: "clear".into(),
            weather: Weather {
                visibility_m: 40_000.0,
                clouds: Vec::new(),
                rain_ratio: 0.0,
                wind_speed_mps: 0.0,
                wind_from_true_deg: 0.0,
                turbulence_ratio: 0.0,
            },
        }),
        effective_weather: None,
        flight: Flight::Live,
        rig: "pair".into(),
        views: VIEWS.map(str::to_owned).to_vec(),
        blocks: None,
        graphics: None,
        recorded: None,
        versions: Versions {
            dtd: "0".into(),
            simulator: Some("none".into()),
            capture_link: Some(1),
            pixels: Some("link".into()),
            encoder: None,
        },
    }
}

fn write_video(path: &Path, ticks: u32) {
    write_video_at(path, ticks, RATE);
}

fn write_video_at(path: &Path, ticks: u32, rate: FrameRate) {
    let mut writer =
        VideoWriter::create(path, &VideoSettings::default(), SIZE_PX, SIZE_PX, rate).unwrap();
    for tick in 0..ticks {
        writer
            .write(&vec![100 + tick as u8; (SIZE_PX * SIZE_PX * 3) as usize])
            .unwrap();
    }
    writer.finish().unwrap();
}

/// A corpus of two labelled scenarios.
struct Example {
    _folder: tempfile::TempDir,
    corpus: Corpus,
}

const IDS: [&str; 2] = ["0600-clear-r1", "0600-clear-r2"];

impl Example {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let corpus = Corpus::create(folder.path()).unwrap();
        for id in IDS {
            let scenario = corpus.scenario(id);
            fs::create_dir_all(scenario.root().join("views")).unwrap();
            record(id).write(&scenario.record_path()).unwrap();
            let cameras = VIEWS
                .iter()
                .enumerate()
                .map(|(index, view)| (*view, camera(index)));
            Calibration::from_poses(cameras, SIZE_PX, SIZE_PX)
                .write(&scenario.calibration_path())
                .unwrap();
            frames().write(&scenario.frames_path()).unwrap();
            TruthBox::write(&truth_boxes(), &scenario.truth_boxes_path()).unwrap();
            VIEWS
                .iter()
                .for_each(|view| write_video(&scenario.video_path(view), TICKS));
            seal::seal_folder(scenario.root(), "config").unwrap();
        }
        let planned = IDS.map(|id| {
            let record = record(id);
            json!({ "id": id, "time_of_day": "06:00", "weather": "clear", "seed": 1, "flight": "live", "ticks": TICKS,
                "config_hash": "config", "trajectory": record.trajectory,
                "parameters": { "conditions": record.conditions, "start_dtd_m": 5_000.0, "flight": record.flight } })
        });
        let record = record(IDS[0]);
        let cameras = [0, 1].map(planned_camera);
        let common = json!({ "aircraft": record.aircraft, "runway": record.runway, "rig": record.rig, "cameras": cameras,
            "picture": { "frame_rate": record.frame_rate.to_string(), "width_px": SIZE_PX, "height_px": SIZE_PX },
            "video": VideoSettings::default() });
        let plan = json!({ "plan_version": 2, "plan_hash": plan_hash(IDS.map(|id| (id, "config"))), "corpus": "example",
            "sweep_blake3": "sweep", "common": common, "scenarios": planned });
        write_json(&corpus.plan_path(), &plan).unwrap();
        splits([Side::Train, Side::Test])
            .write(&corpus.splits_path())
            .unwrap();
        Self {
            _folder: folder,
            corpus,
        }
    }

    fn scenario(&self) -> ScenarioFolder {
        self.corpus.scenario(IDS[0])
    }

    /// Changes the table of the first scenario, seals it again, and returns the findings.
    fn with_table(change: impl FnOnce(&mut Vec<TickRow>)) -> String {
        Self::with(|example| {
            let mut table = frames();
            change(&mut table.rows);
            table.write(&example.scenario().frames_path()).unwrap();
        })
    }

    /// Changes the first scenario, seals it again, and returns the findings.
    fn with(change: impl FnOnce(&Self)) -> String {
        let example = Self::new();
        change(&example);
        seal::seal_folder(example.scenario().root(), "config").unwrap();
        example.findings()
    }

    fn with_record(change: impl FnOnce(&mut ScenarioRecord)) -> String {
        Self::with(|example| {
            let mut record = record(IDS[0]);
            change(&mut record);
            write_json(&example.scenario().record_path(), &record).unwrap();
        })
    }

    fn findings(&self) -> String {
        let report = verify(&self.corpus);
        report
            .findings
            .iter()
            .map(|finding| format!("{finding}\n"))
            .collect()
    }

    fn path(&self, name: &str) -> PathBuf {
        self.scenario().root().join(name)
    }
}

/// Overwrites a number in a table with one that our own programs do not write.
fn overwrite(path: &Path, column: &str, row: usize, number: f64) {
    let reader = ParquetRecordBatchReaderBuilder::try_new(File::open(path).unwrap()).unwrap();
    let batch = reader.build().unwrap().next().unwrap().unwrap();
    let schema = batch.schema();
    let mut columns = batch.columns().to_vec();
    let column = &mut columns[schema.index_of(column).unwrap()];
    let mut numbers = column.as_primitive::<Float64Type>().values().to_vec();
    numbers[row] = number;
    *column = Arc::new(Float64Array::from(numbers));
    let batch = RecordBatch::try_new(schema.clone(), columns).unwrap();
    let mut writer = ArrowWriter::try_new(File::create(path).unwrap(), schema, None).unwrap();
    writer.write(&batch).unwrap();
    writer.close().unwrap();
}

/// Boxes around every centre of gravity inside an image.
fn truth_boxes() -> Vec<TruthBox> {
    let mut boxes = Vec::new();
    for frame in frames().rows {
        for (index, view) in VIEWS.iter().enumerate() {
            let camera = Camera::from_pose(&camera(index), SIZE_PX, SIZE_PX);
            let centre = frame.pose.position().to_ecef();
            let range_m = centre.distance(camera.center_ecef_m);
            let seen = camera.project(centre).and_then(|at| {
                let unclipped = PixelBox {
                    cx_px: at.x,
                    cy_px: at.y,
                    width_px: 6.0,
                    height_px: 3.0,
                };
                let inside = unclipped.clipped_to(SIZE_PX, SIZE_PX)?;
                Some((inside, 1.0 - inside.area() / unclipped.area()))
            });
            let Some((pixel_box, truncation)) = seen else {
                continue;
            };
            boxes.push(TruthBox {
                tick: frame.tick,
                view: (*view).into(),
                class: "aircraft".into(),
                pixel_box,
                visible_fraction: 1.0,
                truncation,
                transmission: (-3.912 * range_m / 40_000.0).exp(),
                aircraft_number: None,
                occluded_fraction: None,
            });
        }
    }
    boxes
}

fn splits(sides: [Side; 2]) -> Splits {
    let of = |(id, side): (&str, Side)| {
        (
            id.to_owned(),
            Assignment {
                trajectory: format!("live-{id}"),
                side,
            },
        )
    };
    Splits {
        by: "trajectory".into(),
        scenarios: IDS.into_iter().zip(sides).map(of).collect(),
    }
}

/// The model `aaaa`, without settings.
fn aaaa() -> ModelIdentity {
    ModelIdentity {
        model: None,
        model_blake3: "a".repeat(64),
        profile_blake3: None,
    }
}

/// An example with tables of the model `aaaa`, whose record has these fields.
fn with_tables(tables: NewTables<'_>, said: &Value) -> Example {
    let example = Example::new();
    let folder = example.scenario();
    let source = folder.open().unwrap();
    let claim = folder.claim().unwrap();
    let record = |provenance| {
        let mut made = serde_json::to_value(provenance).unwrap();
        let fields = said.as_object().unwrap().clone();
        made.as_object_mut().unwrap().extend(fields);
        made
    };
    detections::replace(&claim, &source, &aaaa(), "aaaa", tables, record).unwrap();
    example
}

/// Asserts that there are findings, and that every finding concerns the first scenario and contains the words.
fn assert_found(findings: &str, words: &str) {
    assert!(
        findings.contains(words),
        "expected {words:?} in: {findings}"
    );
    assert!(
        findings.lines().all(|line| line.contains(IDS[0])),
        "{findings}"
    );
}
