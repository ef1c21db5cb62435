use std::fs;
use std::sync::Mutex;

use dataset::corpus::ScenarioFolder;
use dataset::corpus::detections::{
    self, Detection, Detections, Miss, MissReason, NewTables, SearchMode,
};

use dataset::corpus::seal::seal_folder;
use dataset::files::json_file::{read_json, write_json};
use dataset::geometry::camera::Camera;
use dataset::tables::health::{HealthState, ViewHealth};
use dataset::tables::pixel_box::PixelBox;
use dataset::tables::registrations::{NoShift, Registration};
use dataset::work::watch::Silent;
use tempfile::TempDir;
use testkit::short_corpus::{self, Painter};
use testkit::watch::Calls;

use super::job::record::DetectionRecord;
use super::*;
use crate::label::label_corpus;
use crate::tiling::tests::blob_finder::{BlobFinder, paint_blob};

/// The model's hash, as far as it is in names.
const MODEL: &str = "0123456789abcdef";
const WIDTH: u32 = 1280;
const HEIGHT: u32 = 768;

fn model() -> Model {
    Model {
        identity: ModelIdentity {
            model: Some("blobs.onnx".into()),
            model_blake3: MODEL.repeat(4),
            profile_blake3: None,
        },
        profile: None,
    }
}

/// A blob that moves right with the ticks, at a different place in each view.
fn blob(view: &str, tick: u32) -> PixelBox {
    let left = if view == "left" { 100.0 } else { 630.0 } + 8.0 * f64::from(tick);
    PixelBox::from_edges(left - 0.5, 199.5, left + 15.5, 207.5)
}

/// A corpus with these scenarios, and its folder.
fn corpus(ids: &[&str]) -> (Corpus, TempDir) {
    let paint = |view: &str, tick: u32, rgb: &mut [u8]| {
        rgb.fill(20);
        paint_blob(rgb, WIDTH, &blob(view, tick));
    };
    painted(ids, &paint)
}

fn painted(ids: &[&str], paint: Painter<'_>) -> (Corpus, TempDir) {
    let root = tempfile::tempdir().unwrap();
    let corpus = short_corpus::write_with_videos(root.path(), ids, WIDTH, HEIGHT, Some(paint));
    (corpus, root)
}

fn blob_finder() -> Result<Box<dyn Detector>> {
    Ok(Box::new(BlobFinder::default()))
}

fn record(folder: &ScenarioFolder) -> DetectionRecord {
    read_json(&DetectionRecord::path(folder, MODEL), "record").unwrap()
}

fn detect(corpus: &Corpus, options: &DetectOptions) -> DetectOutcome {
    detect_with(corpus, &model(), &blob_finder, options, &Silent).unwrap()
}

/// Stored boxes of a scenario, or the reason why they are refused.
fn stored(folder: &ScenarioFolder) -> std::result::Result<Vec<Detection>, String> {
    let scenario = folder.open().unwrap();
    let detections = scenario.detections(MODEL);
    Ok(detections.map_err(|error| error.to_string())?.boxes)
}

fn two_workers() -> DetectOptions {
    DetectOptions {
        workers: 2,
        ..Default::default()
    }
}

#[test]
fn decoded_videos_give_detections_at_their_ticks_and_views() {
    let (corpus, _root) = corpus(&["0001-a", "0002-b"]);
    let steps = Mutex::new(Vec::new());
    let watch = Calls {
        advance: |done| steps.lock().unwrap().push(done),
        is_stopped: || false,
    };
    let outcome = detect_with(&corpus, &model(), &blob_finder, &two_workers(), &watch).unwrap();
    assert_eq!(outcome.detected, ["0001-a", "0002-b"]);
    assert_eq!(outcome.model_hash, MODEL);
    assert!(steps.lock().unwrap().iter().copied().eq(1..=12));
    for id in ["0001-a", "0002-b"] {
        let found = stored(&corpus.scenario(id)).unwrap();
        let keys: Vec<_> = found
            .iter()
            .map(|detection| (detection.tick, detection.view.as_str()))
            .collect();
        let expected = [
            (0, "left"),
            (0, "right"),
            (1, "left"),
            (1, "right"),
            (2, "left"),
            (2, "right"),
        ];
        assert_eq!(keys, expected);
        for detection in found {
            let offset_px = detection.pixel_box.cx_px - blob(&detection.view, detection.tick).cx_px;
            assert!(
                offset_px.abs() < 0.6,
                "{detection:?} is off by {offset_px} px"
            );
        }
    }
    assert_eq!(
        (outcome.counts.pictures, outcome.counts.detections),
        (12, 12)
    );
    assert_eq!(outcome.counts.against_truth, None);
}

#[test]
fn a_second_run_does_nothing_until_settings_change_or_it_is_asked_again() {
    let (corpus, _root) = corpus(&["0001-a"]);
    detect(&corpus, &two_workers());
    let again = detect(&corpus, &two_workers());
    assert_eq!((again.detected.len(), again.unchanged.len()), (0, 1));
    assert_eq!(again.counts.detections, 6);
    let other = TilingSettings {
        score: 0.9,
        ..Default::default()
    };
    let mut options = DetectOptions {
        settings: other,
        ..two_workers()
    };
    assert_eq!(detect(&corpus, &options).detected.len(), 1);
    let record = record(&corpus.scenario("0001-a"));
    assert_eq!(
        (
            record.provenance.detector.model.as_deref(),
            record.device.as_str(),
            record.searching.settings,
            record.pictures
        ),
        (Some("blobs.onnx"), "cpu", other, 6)
    );
    options.force = true;
    assert_eq!(detect(&corpus, &options).detected.len(), 1);
}

#[test]
fn the_same_model_with_other_settings_has_detections_of_its_own() {
    let (corpus, _root) = corpus(&["0001-a"]);
    let with = |scale: Option<f32>| {
        let mut profile = ModelProfile::default();
        profile.input.scale = scale;
        Model::of(&ModelFile {
            path: "blobs.onnx".into(),
            onnx: b"blobs".to_vec(),
            profile: Some(profile),
        })
    };
    let [empty, one, other] = [None, Some(1.0), Some(0.5)].map(with);
    let model = Model::of(&ModelFile {
        path: "renamed.onnx".into(),
        onnx: b"blobs".to_vec(),
        profile: None,
    });
    let searched = |model: &Model| {
        let outcome = detect_with(&corpus, model, &blob_finder, &two_workers(), &Silent).unwrap();
        (outcome.detected.len(), outcome.model_hash)
    };
    let hash = blake3::hash(b"blobs").to_string();
    assert_eq!(searched(&empty), (1, hash[..16].to_owned()), "no settings");
    assert_eq!(searched(&model).0, 0, "the same content");
    let names = [&one, &other].map(|model| {
        let (searched, name) = searched(model);
        assert_eq!(searched, 1);
        name
    });
    assert!(names[0] != names[1] && !names.contains(&hash[..16].to_owned()));
    assert_eq!(
        [&empty, &one, &other].map(|model| searched(model).0),
        [0; 3]
    );
    let folder = corpus.scenario("0001-a");
    let record = |name: &str| -> DetectionRecord {
        read_json(&DetectionRecord::path(&folder, name), "record").unwrap()
    };
    assert_eq!(record(&names[0]).profile, one.profile);
    assert_eq!(record(&hash[..16]).profile, None);
    let mut all = [names[0].clone(), names[1].clone(), hash[..16].to_owned()];
    all.sort();
    assert_eq!(detections::models_of(&folder).unwrap(), all);
}

/// Replaces the detections by a table that a broken program would write: with one box changed.
fn write_changed(folder: &ScenarioFolder, change: fn(&mut Detection)) {
    let scenario = folder.open().unwrap();
    let mut found = scenario.detections(MODEL).unwrap();
    change(&mut found.boxes[0]);
    let record = record(folder);
    let made = |provenance| DetectionRecord {
        provenance,
        ..record
    };
    let (claim, detector) = (folder.claim().unwrap(), &model().identity);
    let tables = NewTables::unregistered(&found);
    detections::replace(&claim, &scenario, detector, MODEL, tables, made).unwrap();
}

/// Exchanges the videos of both views, and seals the scenario with them.
fn exchange_videos(folder: &ScenarioFolder) {
    let [left, right] = ["left", "right"].map(|view| folder.video_path(view));
    fs::rename(&right, &left).unwrap();
    fs::copy(&left, &right).unwrap();
    seal_folder(folder.root(), "config").unwrap();
}

fn lose_a_box(folder: &ScenarioFolder) {
    let mut found = stored(folder).unwrap();
    found.pop();
    let path = folder.detections_path(MODEL);
    Detections::from(found).write(&path).unwrap();
}

#[test]
fn detections_that_do_not_belong_to_the_scenario_are_refused_and_made_again() {
    let (corpus, _root) = corpus(&["0001-a"]);
    let folder = corpus.scenario("0001-a");
    let late = |folder: &ScenarioFolder| write_changed(folder, |found| found.tick = 3);
    let elsewhere = |folder: &ScenarioFolder| {
        write_changed(folder, |found| found.view = "lift".into());
    };
    type Change<'a> = &'a dyn Fn(&ScenarioFolder);
    let cases: [(Change<'_>, &[&str]); 4] = [
        (&late, &["row 5: tick is 3, expected below 3"]),
        (&elsewhere, &["row 0: view lift is not a view"]),
        (&lose_a_box, &["its hash differs"]),
        (
            &exchange_videos,
            &["made from other videos", "run `dtd detect`"],
        ),
    ];
    for (spoil, words) in cases {
        detect(&corpus, &two_workers());
        spoil(&folder);
        let message = stored(&folder).unwrap_err();
        for word in words {
            assert!(message.contains(word), "{word} in {message}");
        }
        assert_eq!(detect(&corpus, &two_workers()).detected, ["0001-a"]);
        assert_eq!(stored(&folder).unwrap().len(), 6);
    }
}

#[test]
fn a_record_whose_model_is_not_the_one_of_its_name_is_refused() {
    let (corpus, _root) = corpus(&["0001-a"]);
    let folder = corpus.scenario("0001-a");
    for hash in [
        "",
        "a model of mine",
        &"f".repeat(64),
        &"0123456789ABCDEF".repeat(4),
    ] {
        detect(&corpus, &two_workers());
        let mut record = record(&folder);
        record.provenance.detector.model_blake3 = hash.into();
        write_json(&DetectionRecord::path(&folder, MODEL), &record).unwrap();
        let message = stored(&folder).unwrap_err();
        assert!(message.contains("begin with 0123456789abcdef"), "{message}");
        assert_eq!(detect(&corpus, &two_workers()).detected, ["0001-a"]);
    }
}

#[test]
fn a_scenario_of_another_name_or_of_other_parameters_is_not_opened() {
    let (corpus, _root) = corpus(&["0001-a", "0002-b"]);
    let (one, copy) = (corpus.scenario("0001-a"), corpus.scenario("0003-c"));
    fs::rename(one.root(), copy.root()).unwrap();
    let message = copy.open().unwrap_err().to_string();
    assert!(
        message.contains("\"0001-a\", expected \"0003-c\""),
        "{message}"
    );
    let other = corpus.scenario("0002-b");
    seal_folder(other.root(), "other config").unwrap();
    let message = other.open().unwrap_err().to_string();
    assert!(message.contains("expected \"other config\""), "{message}");
    let outcome = detect(&corpus, &two_workers());
    assert_eq!((outcome.detected.len(), outcome.failed.len()), (0, 2));
}

#[test]
fn detections_are_compared_with_labels_where_there_are_any() {
    let (corpus, _root) = corpus(&["0001-a"]);
    label_corpus(&corpus, &Silent).unwrap();
    // The painted blobs are nowhere near the aircraft: all detections are false, and the aircraft is never found.
    let outcome = detect(&corpus, &two_workers());
    let truth = outcome.counts.against_truth.unwrap();
    assert_eq!((truth.found, truth.false_detections), (0, 6));
    let told: Vec<_> = outcome
        .false_boxes
        .iter()
        .map(|of| (of.scenario.as_str(), of.view.as_str(), of.boxes, of.tracks))
        .collect();
    assert_eq!(told, [("0001-a", "left", 3, 1), ("0001-a", "right", 3, 1)]);
    assert_eq!(
        dataset::corpus::seal::faults(corpus.scenario("0001-a").root()).unwrap(),
        Vec::<String>::new()
    );
}

#[test]
fn a_detector_that_cannot_be_made_is_an_error_and_not_a_loss() {
    let (corpus, _root) = corpus(&["0001-a"]);
    let make = || Err(Error::model(Path::new("gone.onnx"), "is not there"));
    let result = detect_with(&corpus, &model(), &make, &two_workers(), &Silent);
    assert!(result.unwrap_err().to_string().contains("is not there"));
}

#[test]
fn detections_that_a_killed_process_decided_but_did_not_rename_are_read_and_settled() {
    let (corpus, _root) = corpus(&["0001-a"]);
    detect(&corpus, &two_workers());
    let folder = corpus.scenario("0001-a");
    let table = folder.detections_path(MODEL);
    let new = table.with_extension("parquet.new");
    fs::rename(&table, &new).unwrap();
    assert_eq!(stored(&folder).unwrap().len(), 6);
    let again = DetectOptions {
        force: true,
        ..two_workers()
    };
    assert_eq!(detect(&corpus, &again).detected, ["0001-a"]);
    assert!(table.exists() && !new.exists());
    assert_eq!(stored(&folder).unwrap().len(), 6);
}

fn registered(folder: &ScenarioFolder) -> Vec<Registration> {
    let scenario = folder.open().unwrap();
    scenario.registrations(MODEL).unwrap().unwrap()
}

fn health(folder: &ScenarioFolder) -> Option<Vec<ViewHealth>> {
    folder.open().unwrap().health(MODEL).unwrap()
}

#[test]
fn every_picture_has_a_state_and_a_black_ground_an_unknown_one() {
    let (corpus, _root) = corpus(&["0001-a"]);
    let outcome = detect(&corpus, &two_workers());
    assert_eq!(outcome.unhealthy, []);
    assert_eq!(outcome.without_background, ["0001-a left", "0001-a right"]);
    let rows = health(&corpus.scenario("0001-a")).unwrap();
    let pictures: Vec<_> = rows
        .iter()
        .map(|row| (row.tick, row.view.as_str()))
        .collect();
    let expected = (0..3).flat_map(|tick| [(tick, "left"), (tick, "right")]);
    assert_eq!(pictures, expected.collect::<Vec<_>>());
    assert!(rows.iter().all(|row| row.state == HealthState::Unknown));
    let shaking = rows.iter().cloned().map(|row| ViewHealth {
        state: if row.tick > 0 {
            HealthState::Shaking
        } else {
            row.state
        },
        ..row
    });
    let counted = Unhealthy::of("0001-a", &shaking.collect::<Vec<_>>());
    assert_eq!(counted.len(), 2);
    assert_eq!((counted[0].view.as_str(), counted[0].shaking), ("left", 2));
}

/// Detects without a detector: stored results must suffice.
fn detect_without(corpus: &Corpus) -> DetectOutcome {
    let make = || Err(Error::model(Path::new("gone.onnx"), "is not there"));
    detect_with(corpus, &model(), &make, &two_workers(), &Silent).unwrap()
}

#[test]
fn every_view_is_registered_with_the_first_at_every_tick() {
    let (corpus, _root) = corpus(&["0001-a"]);
    let outcome = detect(&corpus, &two_workers());
    assert_eq!(
        (outcome.registrations.pairs, outcome.registrations.answered),
        (3, 3)
    );
    let rows = registered(&corpus.scenario("0001-a"));
    assert_eq!(rows.len(), 3);
    for (tick, row) in (0..).zip(rows) {
        assert_eq!(
            (row.tick, row.view.as_str(), row.reference.as_str()),
            (tick, "right", "left")
        );
        let shift = row.result.unwrap();
        let expected_px = blob("right", tick).cx_px - blob("left", tick).cx_px;
        assert!((shift.dx_px - expected_px).abs() < 0.2, "{shift:?}");
        assert!(shift.dy_px.abs() < 0.2, "{shift:?}");
        assert!(
            (shift.x_px - blob("left", tick).cx_px).abs() < 0.6,
            "{shift:?}"
        );
    }
}

#[test]
fn a_tick_that_one_view_does_not_show_has_a_reason_and_no_shift() {
    let paint = |view: &str, tick: u32, rgb: &mut [u8]| {
        rgb.fill(20);
        if view == "left" || tick != 1 {
            paint_blob(rgb, WIDTH, &blob(view, tick));
        }
    };
    let (corpus, _root) = painted(&["0001-a"], &paint);
    let outcome = detect(&corpus, &two_workers());
    let results: Vec<_> = registered(&corpus.scenario("0001-a"))
        .into_iter()
        .map(|row| row.result.err())
        .collect();
    assert_eq!(results, [None, Some(NoShift::NoBox), None]);
    let unanswered = BTreeMap::from([("no-box", 1)]);
    assert_eq!(outcome.registrations.unanswered, unanswered);
    let found = corpus.scenario("0001-a").open().unwrap().detections(MODEL);
    let nothing = Miss {
        tick: 1,
        view: "right".into(),
        mode: SearchMode::Full,
        reason: MissReason::Nothing,
    };
    assert_eq!(found.unwrap().misses, [nothing]);
}

#[test]
fn detections_of_earlier_versions_are_registered_without_detecting_again() {
    let (corpus, _root) = corpus(&["0001-a"]);
    detect(&corpus, &two_workers());
    let folder = corpus.scenario("0001-a");
    let found = Detections::from(stored(&folder).unwrap());
    let before = registered(&folder);
    let before_record = record(&folder);
    let made = |provenance| DetectionRecord {
        provenance,
        registration: None,
        ..before_record.clone()
    };
    let tables = NewTables::unregistered(&found);
    let (claim, scenario) = (folder.claim().unwrap(), folder.open().unwrap());
    let detector = &model().identity;
    detections::replace(&claim, &scenario, detector, MODEL, tables, made).unwrap();
    drop(claim);
    assert_eq!(folder.open().unwrap().registrations(MODEL).unwrap(), None);
    assert_eq!(health(&folder), None);
    let outcome = detect_without(&corpus);
    assert_eq!(outcome.failed, []);
    assert_eq!((outcome.registered.len(), outcome.detected.len()), (1, 0));
    assert_eq!(stored(&folder).unwrap(), found.boxes);
    assert_eq!(registered(&folder), before);
    assert_eq!(health(&folder).map(|rows| rows.len()), Some(6));
    let seconds = [&before_record, &record(&folder)].map(|record| record.seconds);
    assert_eq!(seconds[0], seconds[1], "the detection took as long");
    assert_eq!(detect_without(&corpus).unchanged, ["0001-a"]);
}

#[test]
fn views_are_registered_again_with_fitted_cameras_and_nothing_is_searched() {
    let (corpus, _root) = corpus(&["0001-a"]);
    let make = || Err(Error::model(Path::new("gone.onnx"), "is not there"));
    let with = |cameras: BTreeMap<String, Camera>| {
        let options = DetectOptions {
            registration_of: Some(FittedCameras {
                run_blake3: "ab".repeat(32),
                cameras,
            }),
            ..two_workers()
        };
        detect_with(&corpus, &model(), &make, &options, &Silent).unwrap()
    };
    let folder = corpus.scenario("0001-a");
    let calibration = folder.open().unwrap().calibration().unwrap();
    let mut cameras: BTreeMap<String, Camera> = (calibration.cameras.iter())
        .map(|(view, entry)| (view.clone(), entry.camera()))
        .collect();
    let reason = with(cameras.clone()).failed[0].reason.clone();
    assert!(reason.contains("run `dtd detect`"), "{reason}");

    detect(&corpus, &two_workers());
    let (boxes, before) = (stored(&folder).unwrap(), registered(&folder));
    cameras.get_mut("right").unwrap().focal_px *= 1.2;
    assert_eq!(with(cameras.clone()).registered, ["0001-a"]);
    assert_eq!(stored(&folder).unwrap(), boxes);
    let after = registered(&folder);
    assert_ne!(after, before);
    assert_eq!(with(cameras.clone()).unchanged, ["0001-a"]);
    assert_eq!(detect_without(&corpus).unchanged, ["0001-a"]);
    assert_eq!(registered(&folder), after);

    // Health of an earlier version is measured again, but never with unrequested cameras.
    let mut record = record(&folder);
    record.health = None;
    write_json(&DetectionRecord::path(&folder, MODEL), &record).unwrap();
    let reason = detect_without(&corpus).failed[0].reason.clone();
    assert!(reason.contains("--registration-of"), "{reason}");
    assert_eq!(registered(&folder), after);
    assert_eq!(with(cameras.clone()).registered, ["0001-a"]);
    assert_eq!(registered(&folder), after);

    cameras.remove("right");
    let other = DetectOptions {
        registration_of: Some(FittedCameras {
            run_blake3: "cd".repeat(32),
            cameras,
        }),
        ..two_workers()
    };
    let outcome = detect_with(&corpus, &model(), &make, &other, &Silent).unwrap();
    let reason = &outcome.failed[0].reason;
    assert!(
        reason.contains("no fitted camera of view right"),
        "{reason}"
    );
}

#[test]
fn registrations_that_are_damaged_are_refused_and_made_again() {
    let (corpus, _root) = corpus(&["0001-a"]);
    detect(&corpus, &two_workers());
    let folder = corpus.scenario("0001-a");
    let before = registered(&folder);
    let table = folder.root().join(format!("registrations/{MODEL}.parquet"));
    let cut = fs::read(&table).unwrap().len() as u64 - 5;
    fs::OpenOptions::new()
        .write(true)
        .open(&table)
        .unwrap()
        .set_len(cut)
        .unwrap();
    let refused = folder.open().unwrap().registrations(MODEL).unwrap_err();
    assert!(
        refused.to_string().contains("its hash differs"),
        "{refused}"
    );
    assert_eq!(detect_without(&corpus).registered, ["0001-a"]);
    assert_eq!(registered(&folder), before);
}

#[test]
fn a_scenario_is_written_as_soon_as_its_last_view_is_done() {
    let (corpus, _root) = corpus(&["0001-a", "0002-b"]);
    let one_worker = DetectOptions {
        workers: 1,
        ..Default::default()
    };
    let first = corpus.scenario("0001-a");
    let there = Mutex::new(Vec::new());
    let watch = Calls {
        advance: |done| {
            if [6, 7].contains(&done) {
                there.lock().unwrap().push(stored(&first).is_ok());
            }
        },
        is_stopped: || false,
    };
    detect_with(&corpus, &model(), &blob_finder, &one_worker, &watch).unwrap();
    assert_eq!(*there.lock().unwrap(), [false, true]);
}

#[test]
fn a_run_that_is_stopped_keeps_what_is_done_and_the_next_one_does_the_rest() {
    let (corpus, _root) = corpus(&["0001-a", "0002-b", "0003-c"]);
    let one_worker = DetectOptions {
        workers: 1,
        ..Default::default()
    };
    // In the second image of the second scenario.
    let searched = AtomicUsize::new(0);
    let watch = Calls {
        advance: |done| searched.store(done as usize, Ordering::Relaxed),
        is_stopped: || searched.load(Ordering::Relaxed) >= 8,
    };
    let stopped = detect_with(&corpus, &model(), &blob_finder, &one_worker, &watch).unwrap();
    assert_eq!(stopped.detected, ["0001-a"]);
    assert_eq!(stopped.left, ["0002-b", "0003-c"]);
    assert_eq!(stopped.failed, []);
    let rest = detect(&corpus, &one_worker);
    assert_eq!(rest.detected, ["0002-b", "0003-c"]);
    assert_eq!(rest.unchanged, ["0001-a"]);
}

#[test]
fn two_runs_share_the_scenarios_and_both_end_when_all_are_searched() {
    let ids = ["0001-a", "0002-b", "0003-c", "0004-d"];
    let (corpus, _root) = corpus(&ids);
    let held = corpus.scenario("0001-a").claim_search().unwrap();
    assert!(matches!(held, Claimed::Mine(_)));
    let (first, second) = thread::scope(|scope| {
        let [first, second] = [(); 2].map(|()| scope.spawn(|| detect(&corpus, &two_workers())));
        // Somebody who ends without having searched it, when all others are done.
        while ids[1..]
            .iter()
            .any(|id| stored(&corpus.scenario(id)).is_err())
        {
            thread::sleep(POLL_INTERVAL);
        }
        drop(held);
        (first.join().unwrap(), second.join().unwrap())
    });
    let mut searched = [first.detected, second.detected].concat();
    searched.sort();
    assert_eq!(searched, ids);
    assert_eq!(first.unchanged.len() + second.unchanged.len(), ids.len());
}

#[test]
fn a_part_of_the_scenarios_leaves_the_others_to_other_runs() {
    let (corpus, _root) = corpus(&["0001-a", "0002-b"]);
    let part = DetectOptions {
        only: Some(["0002-b".to_owned()].into()),
        ..two_workers()
    };
    assert_eq!(detect(&corpus, &part).detected, ["0002-b"]);
    assert!(stored(&corpus.scenario("0001-a")).is_err());
    let rest = detect(&corpus, &two_workers());
    assert_eq!(
        (rest.detected, rest.unchanged),
        (vec!["0001-a".into()], vec!["0002-b".into()])
    );
}

mod bad_videos;
