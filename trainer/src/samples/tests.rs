//! Reading samples from corpora.

mod edited_files;
pub(crate) mod fixtures;

use std::path::Path;

use dataset::corpus::detections::{self, NewTables};
use dataset::corpus::model_identity::ModelIdentity;
use dataset::corpus::seal::seal_folder;
use dataset::numbers::frame_rate::FrameRate;
use dataset::tables::health::{CameraTurn, HealthState};
use dataset::tables::pixel_box::PixelBox;
use glam::DVec2;

use super::*;
use crate::samples::trusted_boxes::centre_and_size;
use fixtures::registered_corpus;
use testkit::synthetic::{Changed, MODEL_FILE, MODEL_HASH, SyntheticCorpus};

fn detection(score: f64, cx_px: f64) -> Detection {
    let pixel_box = PixelBox {
        cx_px,
        cy_px: 600.0,
        width_px: 40.0,
        height_px: 12.0,
    };
    Detection::untracked(4, "left", pixel_box, score, 0)
}

#[test]
fn whole_boxes_are_in_the_order_of_their_scores_without_any_that_the_picture_s_edge_cuts_off() {
    let samples = Samples::synthetic(&SyntheticCorpus::tiny(), 0.0);
    let cameras = BTreeMap::from([("left".to_owned(), samples.scenarios[0].cameras[0])]);
    let whole = |found: &[(f64, f64)]| -> Vec<f64> {
        let found = found.iter().map(|&(score, cx_px)| detection(score, cx_px));
        let best = whole_boxes(found.collect(), &cameras);
        let of_left = best[&(4, "left".to_owned())].iter();
        of_left.map(|found| found.pixel_box.cx_px).collect()
    };
    let found = whole(&[(0.95, 19.0), (0.5, 100.0), (0.9, 200.0), (0.7, 300.0)]);
    assert_eq!(found, [200.0, 300.0, 100.0]);
    assert!(whole(&[(0.9, 19.0)]).is_empty(), "counted, not used");
}

#[test]
fn false_boxes_on_the_training_side_change_nothing_that_is_learned_from() {
    let mut samples = Samples::synthetic(&SyntheticCorpus::tiny(), 0.0);
    let undisturbed = samples.with_true_boxes();
    let recorded: Vec<_> = samples.of_side(Side::Train).into_iter().cloned().collect();
    assert_eq!(undisturbed, recorded, "nothing to leave out yet");
    // Empty views now contain a false box.
    let mut added = 0;
    for sample in &mut samples.samples {
        for candidates in &mut sample.observed.candidates {
            if candidates.is_empty() {
                candidates.push(Candidate {
                    pixel_box: detection(0.9, 60.0).pixel_box,
                    score: 0.9,
                    track: None,
                });
                added += 1;
            }
        }
    }
    assert!(added > 10, "{added}");
    assert_eq!(samples.with_true_boxes(), undisturbed);
}

#[test]
fn every_tick_before_touchdown_is_a_sample_and_a_side_has_those_that_a_view_saw() {
    let samples = Samples::synthetic(
        &SyntheticCorpus {
            miss_ratio: 0.5,
            ..SyntheticCorpus::tiny()
        },
        0.0,
    );
    let [flown, seen] = [Side::Train, Side::Validation, Side::Test]
        .map(|side| {
            let seen = samples.of_side(side);
            assert!(seen.iter().all(|s| s.detections() >= 1));
            [samples.ticks_of_side(side).count(), seen.len()]
        })
        .into_iter()
        .fold([0; 2], |sum, of_side| {
            [sum[0] + of_side[0], sum[1] + of_side[1]]
        });
    assert_eq!(flown, samples.samples.len());
    let share = seen as f64 / flown as f64;
    assert!(
        (share - 0.75).abs() < 0.08,
        "half of each view missed at random leaves 3/4, found {share}"
    );
    let in_order = samples.samples.windows(2).all(|pair| {
        let next = pair[0].tick + 1;
        pair[1].scenario == pair[0].scenario + 1 || pair[1].tick == next
    });
    assert!(in_order, "whole flights, one after the other");
}

#[test]
fn contrast_is_that_over_the_distance_to_the_nearest_camera_that_has_the_aircraft_in_its_picture() {
    let samples = Samples::synthetic(&SyntheticCorpus::tiny(), 0.0);
    let sample = &samples.samples[0];
    let cameras = &samples.scenarios[0].cameras;
    let aircraft_m = sample.position.to_ecef();
    let range_m = |camera: &Camera| camera.center_ecef_m.distance(aircraft_m);
    let nearest_m = cameras.iter().map(range_m).fold(f64::INFINITY, f64::min);
    let found = best_transmission(cameras, sample.position, Some(nearest_m)).unwrap();
    assert!(
        (found - 0.02).abs() < 1e-4,
        "2 % remain at the visibility: {found}"
    );
    let above = Geodetic {
        altitude_msl_m: 40_000.0,
        ..sample.position
    };
    assert_eq!(best_transmission(cameras, above, Some(nearest_m)), None);
}

#[test]
fn every_scenario_keeps_its_own_cameras_and_another_rig_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = SyntheticCorpus {
        turned_deg: 0.3,
        ..SyntheticCorpus::tiny()
    }
    .write(folder.path())
    .unwrap();
    let samples = Samples::read(&corpus, None).unwrap();
    assert!(samples.rig.cameras_vary);
    let [first, second] = [0, 1].map(|scenario| samples.scenarios[scenario].cameras[0]);
    assert_ne!(first.ecef_from_camera, second.ecef_from_camera);

    let other = corpus.scenarios().unwrap().remove(1);
    let mut record = other.open().unwrap().record().unwrap();
    record.rig = "another".into();
    record.write(&other.record_path()).unwrap();
    seal_folder(other.root(), "synthetic").unwrap();
    let message = Samples::read(&corpus, None).unwrap_err().to_string();
    assert!(
        message.contains("rig another") && message.contains("one rig"),
        "{message}"
    );
}

#[test]
fn corpora_are_joined_by_flights_and_a_flight_that_one_of_them_tests_trains_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, seed: u64| {
        let corpus = SyntheticCorpus {
            seed,
            ..SyntheticCorpus::tiny()
        };
        corpus.write(&folder.path().join(name)).unwrap()
    };
    let [one, same, other] = [("one", 0), ("same", 0), ("other", 1)].map(|(n, s)| write(n, s));
    let alone = Samples::read(&one, None).unwrap();
    let flight = |samples: &Samples, id: &str| {
        let found = samples.scenarios.iter().find(|s| s.id == id);
        found.unwrap().flight.clone()
    };
    // In the copy, a training flight tests and a test flight trains.
    let mut splits = Splits::read(&same.splits_path()).unwrap();
    let [train, test] =
        [Side::Train, Side::Test].map(|side| splits.side(side).next().unwrap().to_owned());
    splits.scenarios.get_mut(&train).unwrap().side = Side::Test;
    splits.scenarios.get_mut(&test).unwrap().side = Side::Train;
    splits.write(&same.splits_path()).unwrap();

    let all = Samples::read_all(&[one, same, other.clone()], None).unwrap();
    let of_other = Samples::read(&other, None).unwrap();
    assert_eq!(
        all.scenarios.len(),
        alone.scenarios.len() + of_other.scenarios.len()
    );
    assert_eq!(
        all.samples.len(),
        alone.samples.len() + of_other.samples.len()
    );
    let first_of_other = &all.samples[alone.samples.len()];
    let its_scenario = &all.scenarios[first_of_other.scenario];
    assert_eq!(its_scenario.flight, of_other.scenarios[0].flight);
    let training = all.flights(Side::Train);
    assert!(
        !training.contains(&flight(&alone, &train)) && !training.contains(&flight(&alone, &test))
    );
    let expected = alone.flights(Side::Train).len() - 1 + of_other.flights(Side::Train).len();
    assert_eq!(training.len(), expected);
}

#[test]
fn corpora_with_different_rigs_do_not_train_together() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, changed: Option<Changed>| {
        let corpus = SyntheticCorpus {
            changed,
            ..SyntheticCorpus::tiny()
        };
        corpus.write(&folder.path().join(name)).unwrap()
    };
    let turned = Changed {
        view: "left",
        turned_deg: 2.0,
        zoom: 1.0,
    };
    let corpora = [write("one", None), write("turned", Some(turned))];
    let message = Samples::read_all(&corpora, None).unwrap_err().to_string();
    for word in ["turned:", "planned cameras", "left.", "--start-from"] {
        assert!(message.contains(word), "no {word:?} in {message}");
    }
}

/// A corpus with detections from the synthetic model and a second model.
fn of_two_models(folder: &Path, other: &ModelIdentity) -> Corpus {
    let corpus = SyntheticCorpus::tiny().write(folder).unwrap();
    let first = corpus.scenarios().unwrap().remove(0);
    let source = first.open().unwrap();
    let found = source.detections(MODEL_HASH).unwrap();
    let tables = NewTables::unregistered(&found);
    let claim = first.claim().unwrap();
    detections::replace(&claim, &source, other, &other.name(), tables, |made| made).unwrap();
    corpus
}

#[test]
fn of_several_models_one_is_chosen_by_hash_or_by_file_name() {
    let folder = tempfile::tempdir().unwrap();
    let other = ModelIdentity {
        model: Some("other.onnx".into()),
        model_blake3: "0f".repeat(32),
        profile_blake3: None,
    };
    let corpus = of_two_models(folder.path(), &other);
    let asked = |asked: Option<&str>| {
        let read = Samples::read(&corpus, asked);
        read.map(|samples| samples.detections.hash)
            .map_err(|error| error.to_string())
    };
    let listed = format!("other.onnx ({}), {MODEL_FILE} ({MODEL_HASH})", other.name());
    let message = asked(None).unwrap_err();
    assert!(message.contains(&listed), "{message}");
    for name in [MODEL_HASH, MODEL_FILE] {
        assert_eq!(asked(Some(name)).as_deref(), Ok(MODEL_HASH));
    }
    let message = asked(Some("third.onnx")).unwrap_err();
    assert!(
        message.contains("third.onnx") && message.contains(&listed),
        "{message}"
    );
    let chosen = |name: &str| {
        let folders = corpus.scenarios().unwrap();
        let chosen = choose_detections(&corpus, &folders, Some(name));
        chosen.map(|detections| detections.hash).unwrap()
    };
    assert_eq!(chosen("other.onnx"), other.name());
    assert_eq!(chosen(&other.name()), other.name());
}

#[test]
fn a_file_name_of_two_models_is_no_choice_and_both_are_listed_by_hash() {
    let folder = tempfile::tempdir().unwrap();
    let other = ModelIdentity {
        model: Some(MODEL_FILE.into()),
        model_blake3: MODEL_HASH.into(),
        profile_blake3: Some("a".repeat(64)),
    };
    let corpus = of_two_models(folder.path(), &other);
    let message = Samples::read(&corpus, Some(MODEL_FILE));
    let message = message.unwrap_err().to_string();
    for hash in [MODEL_HASH, &other.name()] {
        let listed = format!("{MODEL_FILE} ({hash})");
        assert!(message.contains(&listed), "{message}");
    }
    assert!(Samples::read(&corpus, Some(MODEL_HASH)).is_ok());
}

/// Makes a scenario replay a recording under a name.
fn replay(corpus: &Corpus, id: &str, file: &str, blake3: &str) {
    let folder = corpus.scenario(id);
    let mut record = folder.open().unwrap().record().unwrap();
    record.flight = Flight::Recorded {
        file: file.into(),
        blake3: blake3.into(),
    };
    record.write(&folder.record_path()).unwrap();
    seal_folder(folder.root(), "synthetic").unwrap();
}

#[test]
fn a_renamed_copy_of_a_recording_is_the_same_flight_and_may_not_be_on_two_sides() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = SyntheticCorpus::tiny().write(folder.path()).unwrap();
    let content = "ab".repeat(32);
    replay(&corpus, "0000", "calm.csv", &content);
    replay(&corpus, "0001", "renamed.csv", &content);
    let samples = Samples::read(&corpus, None).unwrap();
    assert_eq!(samples.flights(Side::Train).len(), 3, "of four scenarios");
    // 0006 is on the test side.
    replay(&corpus, "0006", "held-out.csv", &content);
    let message = Samples::read(&corpus, None).unwrap_err().to_string();
    for needed in [
        "0000",
        "0006",
        "the same flight",
        "training side",
        "test side",
    ] {
        assert!(message.contains(needed), "{needed}: {message}");
    }
}

#[test]
fn a_live_flight_is_the_same_at_any_picture_rate() {
    let read = |numerator, denominator| {
        let frame_rate = FrameRate {
            numerator,
            denominator,
        };
        let corpus = SyntheticCorpus {
            frame_rate,
            ..SyntheticCorpus::tiny()
        };
        Samples::synthetic(&corpus, 0.0).scenarios[0].flight.clone()
    };
    let flight = read(1, 3);
    for (numerator, denominator) in [(1, 10), (1, 2), (7, 1), (30_000, 1_000)] {
        assert_eq!(read(numerator, denominator), flight);
    }
}

#[test]
fn live_flights_are_the_same_if_their_paths_are_whatever_they_are_called() {
    let read = |seed| {
        let corpus = SyntheticCorpus {
            seed,
            ..SyntheticCorpus::tiny()
        };
        Samples::synthetic(&corpus, 0.0).scenarios
    };
    let [one, again, other] = [read(0), read(0), read(1)];
    for ((one, again), other) in one.iter().zip(&again).zip(&other) {
        assert_eq!(one.flight, again.flight);
        assert_ne!(one.flight, other.flight);
        assert_eq!(one.id, other.id);
    }
}

#[test]
fn a_trajectory_that_the_split_names_differently_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = SyntheticCorpus::tiny().write(folder.path()).unwrap();
    let mut splits = Splits::read(&corpus.splits_path()).unwrap();
    splits.scenarios.first_entry().unwrap().get_mut().trajectory = "renamed".into();
    splits.write(&corpus.splits_path()).unwrap();
    let message = Samples::read(&corpus, None).unwrap_err().to_string();
    assert!(message.contains("renamed"), "{message}");
}

/// Stores the health table of cameras that are turned at some ticks.
fn with_health(corpus: &Corpus, of: impl Fn(u32) -> Vec<(HealthState, Option<CameraTurn>)>) {
    for folder in corpus.scenarios().unwrap() {
        let source = folder.open().unwrap();
        let record = source.record().unwrap();
        let cameras = source.calibration().unwrap().cameras;
        let mut found = source.detections(MODEL_HASH).unwrap();
        let mut registrations = source.registrations(MODEL_HASH).unwrap().unwrap();
        let turned = |tick: u32, view: &str, place: DVec2| {
            let index = record.views.iter().position(|of| of == view).unwrap();
            let Some(turn) = of(tick)[index].1 else {
                return place;
            };
            let camera = cameras[view].camera();
            let shift_px = DVec2::new(turn.shift_x_px, turn.shift_y_px);
            let turn = camera.turn(shift_px, turn.roll_deg.to_radians());
            camera.pixel_of(turn * camera.image_of(place).extend(1.0))
        };
        for seen in &mut found.boxes {
            let place = DVec2::new(seen.pixel_box.cx_px, seen.pixel_box.cy_px);
            let there = turned(seen.tick, &seen.view, place);
            (seen.pixel_box.cx_px, seen.pixel_box.cy_px) = (there.x, there.y);
        }
        let is_turned = |tick: u32| of(tick).iter().any(|(_, turn)| turn.is_some());
        for row in registrations.iter_mut().filter(|row| is_turned(row.tick)) {
            if let Ok(shift) = &mut row.result {
                let from = DVec2::new(shift.x_px, shift.y_px);
                let to = from + DVec2::new(shift.dx_px, shift.dy_px);
                let from = turned(row.tick, &row.reference, from);
                let to = turned(row.tick, &row.view, to);
                (shift.x_px, shift.y_px) = (from.x, from.y);
                (shift.dx_px, shift.dy_px) = (to.x - from.x, to.y - from.y);
            }
        }
        let rows = (0..record.ticks).flat_map(|tick| {
            let views = record.views.iter().cloned().zip(of(tick));
            views.map(move |(view, (state, motion))| ViewHealth {
                tick,
                view,
                state,
                motion,
                state_live: state,
            })
        });
        let health: Vec<_> = rows.collect();
        let tables = NewTables {
            detections: &found,
            registrations: Some(&registrations),
            health: Some(&health),
            backgrounds: None,
        };
        let claim = folder.claim().unwrap();
        let model = detections::provenance(&folder, MODEL_HASH)
            .unwrap()
            .unwrap();
        let model = &model.detector;
        detections::replace(&claim, &source, model, MODEL_HASH, tables, |made| made).unwrap();
    }
}

const STEADY: (HealthState, Option<CameraTurn>) = (HealthState::Steady, None);

fn turn(part: f64) -> Option<CameraTurn> {
    Some(CameraTurn {
        shift_x_px: 5.0 * part,
        shift_y_px: -3.0 * part,
        roll_deg: 0.2 * part,
        shift_sd_px: 0.02,
    })
}

#[test]
fn boxes_and_shifts_of_cameras_that_moved_are_where_the_usual_direction_would_see_them() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = registered_corpus(0.0).write(folder.path()).unwrap();
    let before = Samples::read(&corpus, None).unwrap();
    // One is turned in mid flight, the other one shakes.
    with_health(&corpus, |tick| {
        let turned = match tick {
            0..10 => (HealthState::Steady, turn(0.0)),
            _ => (HealthState::Moved, turn(1.0)),
        };
        let shaken = [0.0, -1.0, 1.0, 0.5][tick as usize % 4];
        vec![turned, (HealthState::Shaking, turn(shaken))]
    });
    let after = Samples::read(&corpus, None).unwrap();
    // Nearer to the edge, the turn decides whether a box is whole.
    let is_inside = |(_, seen): (usize, &PixelBox)| {
        let [left, top, right, bottom] = seen.edges();
        left > 20.0 && top > 20.0 && right < 1_900.0 && bottom < 1_260.0
    };
    let pairs = before.samples.iter().zip(&after.samples);
    let mut compared = 0;
    for (one, other) in pairs.filter(|(one, _)| one.seen().all(is_inside)) {
        compared += 1;
        for view in 0..2 {
            let centre = |of: &Sample| Some(centre_and_size(of.best(view)?).0);
            match (centre(one), centre(other)) {
                (Some(one), Some(other)) => assert!(one.distance(other) < 1e-3),
                (one, other) => assert_eq!(one, other),
            }
        }
        for view in 0..2 {
            match (one.shift(view), other.shift(view)) {
                (Some(one), Some(other)) => {
                    assert!(
                        one.shift_px.distance(other.shift_px) < 0.02,
                        "{one:?} {other:?}"
                    );
                    let added_px = 0.02_f64.hypot(0.02);
                    let most_px = one.sd_px.to_array().map(|sd_px| sd_px.hypot(added_px));
                    assert!(other.sd_px.cmpge(one.sd_px).all(), "{other:?}");
                    assert!(other.sd_px.cmple(most_px.into()).all(), "{other:?}");
                }
                (one, other) => assert_eq!(one, other),
            }
        }
    }
    assert!(compared > 100, "{compared}");
    let corrections = after.scenarios.iter().map(|of| of.corrections);
    let line = Corrections::line(corrections).unwrap();
    assert!(line.ends_with("corrected, 0 left out"), "{line}");
    assert_eq!(
        Corrections::line(before.scenarios.iter().map(|of| of.corrections)),
        None
    );
}

#[test]
fn a_view_that_is_frozen_or_off_by_an_unknown_amount_does_not_count() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = registered_corpus(0.0).write(folder.path()).unwrap();
    let before = Samples::read(&corpus, None).unwrap();
    with_health(&corpus, |tick| match tick % 4 {
        0 => vec![(HealthState::Frozen, None), STEADY],
        1 => vec![STEADY, (HealthState::Shaking, None)],
        2 => vec![(HealthState::Moved, None), STEADY],
        _ => vec![(HealthState::Unknown, None), (HealthState::Unknown, None)],
    });
    let after = Samples::read(&corpus, None).unwrap();
    for (one, other) in before.samples.iter().zip(&after.samples) {
        let gone = [Some(0), Some(1), Some(0), None][one.tick as usize % 4];
        for view in 0..2 {
            let is_gone = gone == Some(view) || one.best(view).is_none();
            assert_eq!(other.best(view).is_none(), is_gone, "tick {}", one.tick);
        }
        assert!(gone.is_none() || other.shift(1).is_none());
    }
}
