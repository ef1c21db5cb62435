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
use dataset::plan::{Plan, PlannedCamera};
use dataset::tables::frames::{Frames, TickLabels, TickRow, ViewStamp};
use dataset::tables::health::{HealthState, ViewHealth};
use dataset::tables::image_rows::ImageRow;
use dataset::tables::pixel_box::{PixelBox, TruthBox};
use dataset::tables::registrations::{NoShift, Registration};
use dataset::video::{VideoSettings, VideoWriter, refine_time_base};
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

/// That camera as planned.
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
        seed: 1,
        plan_hash: "plan".into(),
        config_hash: "config".into(),
        aircraft: "B737-800".into(),
        frame_rate: RATE,
        ticks: TICKS,
        runway: runway(),
        touchdown: runway().touchdown_target(),
        flight_touchdown: None,
        geoid: None,
        conditions: Conditions {
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
        },
        effective_weather: None,
        flight: Flight::Live,
        rig: "pair".into(),
        views: VIEWS.map(str::to_owned).to_vec(),
        blocks: None,
        versions: Versions {
            dtd: "0".into(),
            simulator: "none".into(),
            capture_link: 1,
            pixels: "link".into(),
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

const IDS: [&str; 2] = ["0001-0600-clear-r1", "0002-0600-clear-r2"];

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
            json!({ "id": id, "seed": 1, "config_hash": "config", "trajectory": record.trajectory,
                "parameters": { "conditions": record.conditions, "flight": record.flight } })
        });
        let record = record(IDS[0]);
        let cameras = [0, 1].map(planned_camera);
        let common = json!({ "aircraft": record.aircraft, "runway": record.runway, "rig": record.rig, "cameras": cameras,
            "picture": { "frame_rate": record.frame_rate.to_string(), "width_px": SIZE_PX, "height_px": SIZE_PX } });
        write_plan(&corpus, &common, &planned);
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

fn write_plan(corpus: &Corpus, common: &Value, scenarios: &[Value]) {
    let mut hasher = blake3::Hasher::new();
    for scenario in scenarios {
        let [id, config_hash] = ["id", "config_hash"].map(|key| scenario[key].as_str().unwrap());
        hasher.update(format!("{id} {config_hash}\n").as_bytes());
    }
    let plan_hash = hasher.finalize().to_string();
    let plan = json!({ "plan_hash": plan_hash, "sweep_blake3": "sweep", "common": common, "scenarios": scenarios });
    write_json(&corpus.plan_path(), &plan).unwrap();
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

#[test]
fn a_sound_corpus_has_no_findings_and_everything_was_looked_at() {
    let report = verify(&Example::new().corpus);
    assert_eq!(report.findings, Vec::new());
    assert!(report.is_sound());
    assert_eq!(
        (
            report.scenarios,
            report.ticks,
            report.pictures,
            report.labelled
        ),
        (2, 10, 20, 2)
    );
}

#[test]
fn a_flipped_byte_is_found_in_every_file() {
    let example = Example::new();
    for file in [
        "scenario.json",
        "calibration.json",
        "frames.parquet",
        "boxes_truth.parquet",
        "views/left.mp4",
        "views/right.mp4",
    ] {
        let whole = fs::read(example.path(file)).unwrap();
        let mut flipped = whole.clone();
        flipped[whole.len() / 2] ^= 1;
        fs::write(example.path(file), flipped).unwrap();
        assert_found(
            &example.findings(),
            &format!("{file} does not match its seal"),
        );
        fs::write(example.path(file), whole).unwrap();
    }
}

#[test]
fn changes_of_the_frames_are_found_in_their_rows() {
    type Change = fn(&mut Vec<TickRow>);
    let changes: [(Change, &[&str]); 12] = [
        (
            |rows| rows[2].pose = rows[3].pose,
            &[
                "frames.parquet row 2 view left: pose drawn is not the tick's",
                "row 2: label: dtd_m",
                "flight is not continuous",
            ],
        ),
        (
            |rows| {
                let pose = rows[3].pose;
                (rows[2].pose, rows[2].labels) = (pose, rows[3].labels);
                let stamps = rows[2].views.iter_mut();
                stamps.for_each(|stamp| stamp.echoed_pose = pose);
            },
            &["row 2: flight is not continuous"],
        ),
        (
            |rows| rows[4].views[1].echoed_pose.altitude_msl_m += 0.011,
            &["frames.parquet row 4 view right: pose drawn is not the tick's: position"],
        ),
        (
            |rows| rows[1].labels.as_mut().unwrap().dtd_m += 0.001,
            &["frames.parquet row 1: label: dtd_m"],
        ),
        (
            |rows| {
                for row in rows {
                    let labels = row.labels.as_mut().unwrap();
                    *labels.time_to_touchdown_s.as_mut().unwrap() += 2.5;
                }
            },
            &["row 4: time_to_touchdown_s: goes from 3.5 to 1.5"],
        ),
        (
            |rows| {
                let [first, second, ..] = &mut rows[..] else {
                    unreachable!("there are five");
                };
                std::mem::swap(&mut first.pose, &mut second.pose);
                std::mem::swap(&mut first.labels, &mut second.labels);
            },
            &["row 1: dtd_m: grows"],
        ),
        (
            |rows| drop(rows.remove(2)),
            &["has 4 rows, but scenario.json says 5 ticks"],
        ),
        (
            |rows| rows[3] = rows[2].clone(),
            &[
                "row 3: tick: is 2, expected 3",
                "row 3 view left: simulator frames out of order",
            ],
        ),
        (
            |rows| rows[0].views.swap(0, 1),
            &[
                "row 0 view left: camera drawn is not the calibrated one",
                "row 0 view right: simulator frames out of order",
            ],
        ),
        (
            |rows| rows[1].time_ns += 1,
            &["row 1: time: time_ns is 2000000001"],
        ),
        (
            |rows| rows[1].views[0].pts = 1,
            &["row 1 view left: timestamp: pts_left is 1, expected 2"],
        ),
        (
            |rows| rows.iter_mut().for_each(|row| row.time_ns += 5),
            &["time: 2 more rows"],
        ),
    ];
    for (change, words) in changes {
        let findings = Example::with_table(change);
        words
            .iter()
            .for_each(|words| assert_found(&findings, words));
    }
    let within = |rows: &mut Vec<TickRow>| rows[4].views[1].echoed_pose.altitude_msl_m += 0.009;
    assert_eq!(Example::with_table(within), "");
    let findings = Example::with(|example| {
        let path = example.scenario().frames_path();
        overwrite(&path, "true_airspeed_mps", 3, f64::NAN);
    });
    assert_found(&findings, "row 3: true_airspeed_mps NaN is out of range");
}

/// Changes a recording's frames in a block of five ticks, some of them shown again, and returns the findings.
fn with_block(repeated_ticks: u32, change: impl FnOnce(&mut Vec<TickRow>)) -> String {
    Example::with(|example| {
        let mut record = record(IDS[0]);
        record.blocks = Some(Blocks {
            ticks: TICKS,
            frames_behind: vec![0],
            count: 2,
            measured: 2,
            held_ticks: 0,
            repeated_ticks,
        });
        write_json(&example.scenario().record_path(), &record).unwrap();
        let mut table = frames();
        for (tick, row) in table.rows.iter_mut().enumerate() {
            for (view, stamp) in row.views.iter_mut().enumerate() {
                stamp.sim_frame = (100 * view + tick) as u64;
            }
        }
        change(&mut table.rows);
        table.write(&example.scenario().frames_path()).unwrap();
    })
}

#[test]
fn ticks_that_were_exchanged_in_a_block_are_found_unless_so_many_were_shown_again() {
    let exchange = |rows: &mut Vec<TickRow>| {
        let [first, second] = [1, 3].map(|row: usize| rows[row].views[1].sim_frame);
        rows[1].views[1].sim_frame = second;
        rows[3].views[1].sim_frame = first;
    };
    assert_eq!(with_block(0, |_| {}), "");
    assert_found(
        &with_block(0, exchange),
        "row 2 view right: simulator frames out of order: by sim_frame, 2 ticks were drawn after later ones",
    );
    // Lost, and shown again after all others.
    let lost = |rows: &mut Vec<TickRow>| rows[1].views[0].sim_frame = 50;
    assert_eq!(with_block(1, lost), "");
    assert_found(&with_block(0, lost), "1 ticks were drawn after later ones");
    assert_found(
        &with_block(1, exchange),
        "2 ticks were drawn after later ones",
    );
}

#[test]
fn a_dropped_picture_and_a_truncated_video_are_found() {
    let findings =
        Example::with(|example| write_video(&example.path("views/right.mp4"), TICKS - 1));
    assert_found(
        &findings,
        "views/right.mp4 view right: has 4 images, but scenario.json says 5 ticks",
    );
    let findings = Example::with(|example| {
        let path = example.path("views/left.mp4");
        let bytes = fs::read(&path).unwrap();
        fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    });
    assert_found(&findings, "views/left.mp4 view left: cannot read it");
}

#[test]
fn times_of_a_video_are_compared_whatever_its_unit_of_time() {
    let findings = Example::with(|example| {
        refine_time_base(&example.path("views/left.mp4")).unwrap();
    });
    assert_eq!(findings, "");
    let findings = Example::with(|example| {
        let path = example.path("views/left.mp4");
        let twice_as_fast = FrameRate {
            numerator: 1,
            denominator: 1,
        };
        write_video_at(&path, TICKS, twice_as_fast);
    });
    assert_found(
        &findings,
        "row 1 view left: timestamp: is 1 in units of 1/1 s, expected 2 in units of 1/1 s",
    );
}

/// A reported visibility, with or without its mark.
fn reported(visibility_m: f64, is_marked: bool) -> Option<EffectiveWeather> {
    let mark = is_marked.then_some(EffectiveQuantity::Visibility);
    Some(EffectiveWeather {
        visibility_m: Some(visibility_m),
        differing: mark.into_iter().collect(),
        ..EffectiveWeather::default()
    })
}

#[test]
fn a_marked_scenario_is_named_and_is_no_fault() {
    let example = Example::new();
    let mut record = record(IDS[0]);
    record.effective_weather = reported(20_000.0, true);
    record.schema_version = record.required_version(PINHOLE_SCHEMA_VERSION);
    record.write(&example.scenario().record_path()).unwrap();
    seal::seal_folder(example.scenario().root(), "config").unwrap();
    let report = verify(&example.corpus);
    assert!(report.is_sound(), "{:?}", report.findings);
    let marked: Vec<_> = report.marked().collect();
    let expected = ["visibility is 20000 m, planned was 40000 m".to_owned()];
    assert_eq!(marked, [(IDS[0], &expected[..])]);
    let said = report.weather["clear"].to_string();
    assert_eq!(
        said,
        "visibility 20000 m, 1 of 2 without a report, 1 of 2 marked"
    );
}

#[test]
fn a_record_that_contradicts_itself_or_cannot_be_is_found() {
    type Change = fn(&mut ScenarioRecord);
    let changes: [(Change, &str); 9] = [
        (
            |record| record.touchdown.latitude_deg += 1e-5,
            "touchdown is 1.1",
        ),
        (|record| record.schema_version = 99, "has schema version 99"),
        (|record| record.schema_version = 0, "schema version is 0"),
        (
            |record| record.conditions.weather.rain_ratio = 2.0,
            "conditions.weather.rain_ratio 2 is out of range; expected a rain intensity from 0 to 1",
        ),
        (
            |record| record.conditions.weather.rain_ratio = 2.0,
            "0001-0600-clear-r1/scenario.json: conditions was planned",
        ),
        (
            |record| record.effective_weather = reported(20_000.0, false),
            "visibility is 20000 m, planned was 40000 m, and it is not among `differing`",
        ),
        (
            |record| record.effective_weather = reported(39_000.0, true),
            "visibility is among `differing`, and is as planned",
        ),
        (
            |record| record.effective_weather = reported(20_000.0, true),
            "schema version is 1, but the weather at the aircraft differs",
        ),
        (
            |record| record.effective_weather = reported(-5.0, true),
            "effective_weather.visibility_m -5 is out of range",
        ),
    ];
    for (change, words) in changes {
        assert_found(&Example::with_record(change), words);
    }
}

#[test]
fn a_moved_camera_is_found() {
    let findings = Example::with(|example| {
        let path = example.path("calibration.json");
        let mut calibration = Calibration::read(&path).unwrap();
        calibration
            .cameras
            .get_mut("left")
            .unwrap()
            .ecef_from_camera
            .translation_m[0] += 0.01;
        calibration.write(&path).unwrap();
    });
    assert_found(
        &findings,
        "calibration.json: camera left: translation_m does not follow",
    );
}

#[test]
fn a_missing_column_and_missing_boxes_are_found() {
    let findings = Example::with(|example| {
        dataset::tables::columns::TableWriter::new()
            .u32("tick", [0])
            .write(&example.scenario().frames_path())
            .unwrap();
    });
    assert_found(&findings, "has no column latitude_deg");
    let findings =
        Example::with(|example| fs::remove_file(example.path("boxes_truth.parquet")).unwrap());
    assert_found(&findings, "has distances, but no ground-truth boxes");
}

#[test]
fn a_leaking_split_is_found_by_what_was_flown_and_by_what_is_listed() {
    let example = Example::new();
    let mut shared = record(IDS[1]);
    shared.trajectory = format!("live-{}", IDS[0]);
    let scenario = example.corpus.scenario(IDS[1]);
    shared.write(&scenario.record_path()).unwrap();
    seal::seal_folder(scenario.root(), "config").unwrap();
    assert!(
        example
            .findings()
            .contains(": leak: trajectory live-0001-0600-clear-r1"),
        "{}",
        example.findings()
    );

    let mut listed = splits([Side::Train, Side::Test]);
    for assignment in listed.scenarios.values_mut() {
        assignment.trajectory = shared.trajectory.clone();
    }
    write_json(&example.corpus.splits_path(), &listed).unwrap();
    let findings = example.findings();
    let words = "is on two sides: 0001-0600-clear-r1 is on the training side";
    assert!(findings.contains(words), "{findings}");
}

/// A registration of the right view at tick 0.
fn registration() -> Registration {
    Registration {
        tick: 0,
        view: "right".into(),
        reference: "left".into(),
        result: Err(NoShift::Faint),
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

/// An example with these tables of the model `aaaa`, and these fields in their record.
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

/// An example with registrations, without detections, and this about registrations in their record.
fn registered(rows: &[Registration], said: &Value) -> Example {
    let nothing_found = Detections::default();
    let tables = NewTables {
        registrations: Some(rows),
        ..NewTables::unregistered(&nothing_found)
    };
    with_tables(tables, &json!({ "registration": said }))
}

#[test]
fn damaged_missing_and_foreign_registrations_are_found() {
    let said = json!({"method": 1, "reference": "left", "pairs": 1, "answered": 0, "seconds": 0.5});
    let table = "registrations/aaaa.parquet";
    let change = |spoil: &dyn Fn(&Path)| {
        let example = registered(&[registration()], &said);
        spoil(&example.scenario().registrations_path("aaaa"));
        example.findings()
    };
    assert_eq!(change(&|_| {}), "");
    let cut = |path: &Path| {
        let bytes = fs::read(path).unwrap();
        fs::write(path, &bytes[..bytes.len() - 9]).unwrap();
    };
    let others = |path: &Path| {
        let row = Registration {
            result: Err(NoShift::Lost),
            ..registration()
        };
        Registration::write(&[row], path).unwrap();
    };
    let unowned = |path: &Path| {
        fs::copy(path, path.with_file_name("bbbb.parquet")).unwrap();
    };
    type Spoil<'a> = &'a dyn Fn(&Path);
    let cases: [(Spoil<'_>, &str); 4] = [
        (&cut, "its hash differs"),
        (&others, "its hash differs"),
        (
            &|path| fs::remove_file(path).unwrap(),
            "is missing, though there is a record of it",
        ),
        (&unowned, "bbbb.parquet: belongs to no detections"),
    ];
    for (spoil, words) in cases {
        let findings = change(spoil);
        assert!(
            findings.contains(words) && findings.contains("registrations/"),
            "{findings}"
        );
    }
    let findings = change(&cut);
    assert!(
        findings.contains(table) && !findings.contains("registration.pairs"),
        "{findings}"
    );
    let example = registered(&[registration()], &said);
    let path = detections::record_path(&example.scenario(), "aaaa");
    let mut record: Value = read_json(&path, "record").unwrap();
    let fields = record.as_object_mut().unwrap();
    fields.remove("registrations_blake3");
    write_json(&path, &record).unwrap();
    let findings = example.findings();
    assert!(
        findings.contains("is not named by the record of the detections"),
        "{findings}"
    );
}

#[test]
fn damaged_and_foreign_health_and_two_states_of_a_picture_are_found() {
    let row = |tick: u32, view: &str| ViewHealth {
        tick,
        view: view.into(),
        state: HealthState::Steady,
        motion: None,
        state_live: HealthState::Steady,
        lag: None,
        vertical_px: None,
    };
    let watched = |rows: &[ViewHealth]| {
        let nothing_found = Detections::default();
        let tables = NewTables {
            health: Some(rows),
            ..NewTables::unregistered(&nothing_found)
        };
        with_tables(tables, &json!({}))
    };
    assert_eq!(watched(&[row(0, "left"), row(0, "right")]).findings(), "");
    for (rows, words) in [
        (
            [row(0, "left"), row(0, "left")],
            "tick 0 of the view is there already",
        ),
        (
            [row(0, "left"), row(9_999, "left")],
            "is 9999, expected below",
        ),
        ([row(0, "left"), row(0, "above")], "above is not a view"),
    ] {
        let findings = watched(&rows).findings();
        assert!(
            findings.contains(words) && findings.contains("health/"),
            "{findings}"
        );
    }
    let example = watched(&[row(0, "left")]);
    let path = example.scenario().health_path("aaaa");
    ViewHealth::write(&[row(0, "right")], &path).unwrap();
    assert!(example.findings().contains("its hash differs"));
}

#[test]
fn registrations_of_no_picture_of_the_scenario_or_with_other_counts_are_found() {
    let row = registration;
    let no_tick = Registration { tick: 99, ..row() };
    let no_view = Registration {
        view: "lift".into(),
        ..row()
    };
    let itself = Registration {
        reference: "right".into(),
        ..row()
    };
    for (rows, said, words) in [
        (vec![no_tick], json!({}), "tick: is 99"),
        (vec![no_view], json!({}), "view: lift is not a view"),
        (vec![itself], json!({}), "right is the view itself"),
        (
            vec![row(), row()],
            json!({}),
            "tick 0 of the view is there already",
        ),
        (
            vec![row()],
            json!({"pairs": 7}),
            "registration.pairs is 7, expected 1",
        ),
        (
            vec![row()],
            json!({"answered": 1}),
            "registration.answered is 1, expected 0",
        ),
        (
            vec![row()],
            json!({"reference": "right"}),
            "registration.reference is \"right\"",
        ),
        (
            vec![row()],
            json!({"seconds": -1.0}),
            "registration.seconds is -1e0",
        ),
    ] {
        let findings = registered(&rows, &said).findings();
        assert!(findings.contains(words), "{findings}");
    }
}

/// A box of the first image.
fn detection() -> Detection {
    let pixel_box = PixelBox::from_edges(10.0, 10.0, 20.0, 20.0);
    Detection::untracked(0, "left", pixel_box, 0.5, 0)
}

/// The reason why an image has no box.
fn miss(tick: u32) -> Miss {
    Miss {
        tick,
        view: "left".into(),
        mode: SearchMode::Full,
        reason: MissReason::Nothing,
    }
}

/// The findings after these detections were made, with this record.
fn with_detections(found: &Detections, record: &Value) -> String {
    with_tables(NewTables::unregistered(found), record).findings()
}

#[test]
fn a_faint_box_that_does_not_count_is_found() {
    let settings = json!({"settings": {"score": 0.7, "faint_score": 0.4}});
    for (confirmed, words) in [
        (true, ""),
        (
            false,
            "settings.score is above 0.5, the score of a box that does not count",
        ),
    ] {
        let found = Detection {
            confirmed,
            ..detection()
        };
        let findings = with_detections(&vec![found].into(), &settings);
        assert_eq!(findings.is_empty(), words.is_empty(), "{findings}");
        assert!(findings.contains(words), "{findings}");
    }
}

#[test]
fn counts_settings_and_models_that_cannot_be_are_found_in_records_of_detections() {
    let sound = json!({"pictures": 10, "detections": 1, "misses": 1, "seconds": 0.1,
        "settings": {"tile_score": 0.15, "score": 0.3, "merge_iou": 0.3, "most_windows": 6}});
    let found = Detections {
        boxes: vec![detection()],
        misses: vec![miss(1)],
    };
    assert_eq!(with_detections(&found, &sound), "");
    for (record, words) in [
        (json!({"pictures": 9}), "pictures is 9, expected 10"),
        (json!({"detections": 4_000_000_000_u64}), "expected 1"),
        (json!({"misses": 2}), "misses is 2, expected 1"),
        (json!({"detections": -1}), "record of detections"),
        (json!({"seconds": -1.0}), "seconds is -1"),
        (
            json!({"settings": {"score": 1e308}}),
            "settings.score 1e308 is out of range",
        ),
        (
            json!({"settings": {"faint_score": 2}}),
            "settings.faint_score 2 is out of range",
        ),
        (
            json!({"settings": {"score": 0.7, "faint_score": 0.6}}),
            "settings.faint_score is above 0.5, the score of a box of view left at tick 0",
        ),
        (
            json!({"settings": {"most_windows": 0}}),
            "settings.most_windows 0",
        ),
        (json!({"model_blake3": "mine"}), "64 hexadecimal digits"),
        (json!({"model_blake3": "b".repeat(64)}), "begin with aaaa"),
        (
            json!({"profile_blake3": "a".repeat(64)}),
            "whose hash begins with aaaa",
        ),
    ] {
        let findings = with_detections(&found, &record);
        assert!(
            findings.contains("aaaa.json") && findings.contains(words),
            "{findings}"
        );
    }
}

#[test]
fn a_reason_for_no_box_beside_a_box_or_of_no_picture_is_found() {
    for (tick, words) in [
        (
            0,
            "tick 0 of the view has the reason \"nothing\" for no box, and other rows too",
        ),
        (99, "tick: is 99, expected below 5"),
    ] {
        let found = Detections {
            boxes: vec![detection()],
            misses: vec![miss(tick)],
        };
        let findings = with_detections(&found, &json!({}));
        assert!(findings.contains(words), "{findings}");
    }
}

#[test]
fn the_sealed_video_is_looked_at_whatever_lies_beside_it() {
    let example = Example::new();
    let folder = example.scenario();
    fs::write(folder.root().join("views/left.mov"), "no video").unwrap();
    let findings = example.findings();
    assert_found(&findings, "views/left.mov is not listed in MANIFEST.b3");
    assert_eq!(findings.lines().count(), 1, "{findings}");
}

#[test]
fn a_folder_whose_name_is_no_text_is_found() {
    use std::os::unix::ffi::OsStrExt;

    let example = Example::new();
    let name = std::ffi::OsStr::from_bytes(b"0003\xff");
    let path = example.corpus.root().join("scenarios").join(name);
    fs::create_dir(&path).unwrap();
    fs::copy(
        example.scenario().root().join(seal::DONE),
        path.join(seal::DONE),
    )
    .unwrap();
    let findings = example.findings();
    assert!(findings.contains("not UTF-8"), "{findings}");
}

#[test]
fn a_folder_without_a_seal_is_found() {
    let example = Example::new();
    fs::remove_file(example.path("DONE.json")).unwrap();
    assert_found(&example.findings(), "is not complete");
}

#[test]
fn what_is_no_scenario_is_called_so() {
    let example = Example::new();
    let scenarios = example.corpus.root().join("scenarios");
    fs::write(scenarios.join(".DS_Store"), "").unwrap();
    fs::create_dir(scenarios.join("backup")).unwrap();
    let findings = example.findings();
    for name in [".DS_Store", "backup"] {
        let words = format!("scenarios/{name}: not a scenario");
        assert!(findings.contains(&words), "{findings}");
    }
    assert!(!findings.contains(seal::DONE), "{findings}");
}

#[test]
fn a_fault_names_its_file_once() {
    let example = Example::new();
    fs::write(example.path("scenario.json"), "{").unwrap();
    fs::write(example.path("frames.parquet"), "PAR1").unwrap();
    fs::remove_file(example.path("calibration.json")).unwrap();
    fs::write(example.corpus.plan_path(), "{").unwrap();
    let findings = example.findings();
    let root = example.corpus.root().display().to_string();
    assert!(!findings.contains(&root), "{findings}");
    let words = "plan.json: is not a valid plan";
    assert!(findings.contains(words), "{findings}");
}

#[test]
fn boxes_that_are_missing_moved_doubled_or_not_numbers_are_found() {
    type Change = fn(&mut Vec<TruthBox>);
    let changes: [(&str, Change); 5] = [
        ("but no box", |boxes| drop(boxes.remove(1))),
        ("is not around the aircraft's centre of gravity", |boxes| {
            boxes[0].pixel_box.cx_px += 4.0;
        }),
        ("which has a box already", |boxes| {
            boxes.push(boxes[0].clone());
        }),
        ("is not inside the image", |boxes| {
            boxes[0].pixel_box.width_px += 500.0;
        }),
        ("distance and visibility give", |boxes| {
            boxes[0].transmission *= 0.9;
        }),
    ];
    for (words, change) in changes {
        let findings = Example::with(|example| {
            let mut boxes = truth_boxes();
            change(&mut boxes);
            TruthBox::write(&boxes, &example.scenario().truth_boxes_path()).unwrap();
        });
        assert_found(&findings, words);
        assert!(findings.contains("boxes_truth.parquet"), "{findings}");
    }
    let findings = Example::with(|example| {
        let path = example.scenario().truth_boxes_path();
        overwrite(&path, "width_px", 0, f64::NAN);
    });
    let words = "boxes_truth.parquet row 0: width_px NaN is out of range";
    assert_found(&findings, words);
}

#[test]
fn a_planned_scenario_that_is_missing_is_a_fault_only_if_the_corpus_should_be_complete() {
    let example = Example::new();
    fs::remove_dir_all(example.scenario().root()).unwrap();
    let quick = VerifyOptions {
        decode: false,
        complete: false,
    };
    let report = verify_with(&example.corpus, quick, &Silent).unwrap();
    assert_eq!(report.findings, Vec::new());
    assert_eq!(
        (report.missing, report.pictures),
        (vec![IDS[0].to_owned()], 0)
    );
    let complete = VerifyOptions {
        complete: true,
        ..quick
    };
    let report = verify_with(&example.corpus, complete, &Silent).unwrap();
    assert_eq!(report.findings.len(), 1);
    assert_eq!(
        report.findings[0].to_string(),
        format!(
            "plan.json scenario {}: planned, but not in the corpus",
            IDS[0]
        )
    );
}

#[test]
fn a_corpus_without_a_plan_has_no_fault_and_what_needs_the_plan_is_named() {
    let example = Example::new();
    let not_checked = |options| {
        let report = verify_with(&example.corpus, options, &Silent).unwrap();
        (report.not_checked, report.findings)
    };
    let quick = VerifyOptions {
        decode: false,
        complete: false,
    };
    fs::remove_file(example.corpus.plan_path()).unwrap();
    let (named, findings) = not_checked(quick);
    assert_eq!(findings, []);
    assert!(
        named.len() == 1 && named[0].contains("no plan.json"),
        "{named:?}"
    );
    fs::remove_file(example.corpus.splits_path()).unwrap();
    let (named, findings) = not_checked(quick);
    assert_eq!(findings, []);
    assert!(
        named.len() == 2 && named[1].contains("no splits.json"),
        "{named:?}"
    );
    // Whether a corpus is complete depends on its plan, and a corpus with a sweep was generated together with a plan.
    let complete = VerifyOptions {
        complete: true,
        ..quick
    };
    assert_eq!(not_checked(complete).1.len(), 1);
    fs::write(example.corpus.sweep_path(), "").unwrap();
    let (named, findings) = not_checked(quick);
    assert_eq!((named, findings.len()), (vec![], 2));
}

/// An example in whose plan texts were replaced.
fn with_plan(changes: &[(&str, &str)]) -> Example {
    let example = Example::new();
    let mut plan = fs::read_to_string(example.corpus.plan_path()).unwrap();
    for (text, other) in changes {
        assert!(plan.contains(text), "{text}");
        plan = plan.replace(text, other);
    }
    fs::write(example.corpus.plan_path(), plan).unwrap();
    example
}

#[test]
fn a_changed_plan_does_not_have_its_hash_any_more() {
    let change = ("\"config_hash\": \"config\"", "\"config_hash\": \"other\"");
    let findings = with_plan(&[change]).findings();
    for words in [
        "plan.json: plan_hash is",
        "config_hash was planned as \"other\"",
    ] {
        assert!(findings.contains(words), "{findings}");
    }
}

#[test]
fn a_plan_that_does_not_name_its_sweep_is_a_fault_as_other_verbs_refuse_it() {
    let example = with_plan(&[("\"sweep_blake3\"", "\"sweep\"")]);
    let findings = example.findings();
    let words = "plan.json: sweep_blake3 cannot be read: invalid type: null, expected a string; expected the BLAKE3 hash of corpus.toml";
    assert!(findings.contains(words), "{findings}");
    assert!(Plan::of_corpus(&example.corpus).is_err());
}

#[test]
fn a_value_of_a_plan_that_cannot_be_read_is_named_and_hides_no_other() {
    let example = with_plan(&[
        ("\"pitch_deg\": 1.6", "\"pitch_deg\": \"up\""),
        ("\"rig\": \"pair\"", "\"rig\": [5]"),
        ("\"seed\": 1,", "\"seed\": 2, \"of_a_later_version\": {},"),
    ]);
    let findings = example.findings();
    for words in [
        "plan.json scenario {id}: its cameras cannot be compared with calibration.json: cameras cannot be read: invalid type: string \"up\", expected f64",
        "{id}/scenario.json: rig was planned as [5] (plan.json), but recorded as \"pair\"",
        "{id}/scenario.json: seed was planned as 2 (plan.json), but recorded as 1",
    ] {
        for id in IDS {
            assert!(findings.contains(&words.replace("{id}", id)), "{findings}");
        }
    }
    assert_eq!(findings.lines().count(), 6, "{findings}");
}
