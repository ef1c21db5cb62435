//! Camera fits that start from wrong calibrations.

use dataset::corpus::splits::Side;
use testkit::synthetic::SyntheticCorpus;

use super::*;
use dataset::geometry::camera::camera_adjustment::Adjustment;

fn tiny() -> Samples {
    Samples::synthetic(&SyntheticCorpus::tiny(), 0.0)
}

/// Falsifies the stated cameras of every scenario, in opposite directions for the two views.
fn state_wrongly(samples: &mut Samples, error: Adjustment) {
    let opposite = Adjustment::from_array(error.to_array().map(|number| -number));
    for scenario in &mut samples.scenarios {
        for (camera, error) in scenario.cameras.iter_mut().zip([error, opposite]) {
            *camera = error.applied_to(camera);
        }
    }
}

/// Replaces every third box in a view by a lamp.
fn add_lamps(samples: &mut Samples) -> usize {
    let mut replaced = 0;
    for (at, sample) in samples.samples.iter_mut().enumerate() {
        for view in 0..2 {
            if (at + view).is_multiple_of(3)
                && let Some(seen) = sample.observed.best_mut(view)
            {
                *seen = PixelBox {
                    cx_px: 700.0,
                    cy_px: 900.0,
                    width_px: 12.0,
                    height_px: 12.0,
                };
                replaced += 1;
            }
        }
    }
    replaced
}

fn kept(samples: &Samples) -> Vec<Sample> {
    samples.with_true_boxes()
}

fn boxes(samples: &[Sample]) -> usize {
    samples.iter().map(|sample| sample.detections()).sum()
}

/// Yaw, pitch, roll, focal length and position together, and each separately.
fn errors() -> [Adjustment; 5] {
    let none = Adjustment::default();
    [
        Adjustment {
            pan_deg: 0.2,
            ..none
        },
        Adjustment {
            tilt_deg: 0.1,
            ..none
        },
        Adjustment {
            pan_deg: 0.5,
            tilt_deg: 0.2,
            roll_deg: 1.0,
            focal_pct: 3.0,
            east_m: 5.0,
            ..none
        },
        Adjustment {
            pan_deg: -2.0,
            tilt_deg: 2.0,
            roll_deg: 2.0,
            focal_pct: 10.0,
            ..none
        },
        Adjustment {
            north_m: 20.0,
            east_m: -20.0,
            up_m: 10.0,
            focal_pct: -10.0,
            ..none
        },
    ]
}

#[test]
fn the_same_boxes_contain_the_aircraft_whatever_the_calibration_says() {
    for has_lamps in [false, true] {
        let mut samples = tiny();
        let without_lamps = boxes(&kept(&samples));
        if has_lamps {
            assert!(add_lamps(&mut samples) > 50);
        }
        let truly = kept(&samples);
        let least = if has_lamps { 0.6 } else { 1.0 };
        assert!(boxes(&truly) as f64 >= least * without_lamps as f64);
        for error in errors() {
            let mut wrong = samples.clone();
            state_wrongly(&mut wrong, error);
            let found = kept(&wrong);
            let [found_count, true_count] = [&found, &truly].map(|samples| boxes(samples));
            assert!(
                found == truly,
                "{found_count} instead of {true_count}, lamps: {has_lamps}, {error:?}"
            );
        }
    }
}

fn droppings(samples: &Samples) -> (TrainingCameras, TrainingDrops) {
    let training = samples.of_side(Side::Train);
    let cameras = TrainingCameras::of(samples, &training);
    let droppings = TrainingDrops::of(&cameras, samples, &training);
    (cameras, droppings)
}

#[test]
fn the_flight_in_which_a_camera_was_moved_is_named() {
    let mut samples = tiny();
    assert!(!droppings(&samples).1.are_unusual());
    let moved = samples.scenarios[1].id.clone();
    for sample in samples
        .samples
        .iter_mut()
        .filter(|s| s.observed.scenario == 1)
    {
        if let Some(seen) = sample.observed.best_mut(0) {
            seen.cx_px -= 250.0;
        }
    }
    let (_, droppings) = droppings(&samples);
    assert!(droppings.are_unusual());
    let said = droppings.to_string();
    assert!(said.contains(&format!("most in {moved} (left ")), "{said}");
    let left = droppings.by_view["left"];
    let share = left.share.unwrap();
    assert!((0.2..0.3).contains(&share), "{share}: one of four flights");
    assert_eq!(droppings.by_view["right"].dropped, 0);
}

#[test]
fn boxes_of_other_objects_are_counted() {
    let mut samples = tiny();
    add_lamps(&mut samples);
    let (_, droppings) = droppings(&samples);
    let share = droppings.by_view["left"].share.unwrap();
    assert!((0.25..0.4).contains(&share), "{share}");
}

#[test]
fn a_lamp_that_outnumbers_the_aircraft_in_one_flight_moves_no_camera() {
    let mut samples = tiny();
    let truly = kept(&samples);
    let mut of_flight = 0_usize;
    for sample in samples
        .samples
        .iter_mut()
        .filter(|s| s.observed.scenario == 0)
    {
        of_flight += 1;
        if !of_flight.is_multiple_of(5)
            && let Some(seen) = sample.observed.best_mut(0)
        {
            (seen.cx_px, seen.cy_px) = (300.0, 1_000.0);
        }
    }
    let others = |samples: Vec<Sample>| -> Vec<Sample> {
        let others = samples.into_iter().filter(|s| s.scenario != 0);
        others.collect()
    };
    let found = kept(&samples);
    let mut of_lamp = found.iter().filter(|s| s.scenario == 0);
    assert!(of_lamp.all(|s| s.best(0).is_none_or(|seen| seen.cx_px != 300.0)));
    assert_eq!(others(found), others(truly));
}

#[test]
fn a_wrong_calibration_is_named_and_a_true_one_is_not() {
    let mut samples = tiny();
    let views = samples.views.clone();
    let found = droppings(&samples).0.contradictions(&views);
    assert!(found.is_empty(), "{found:?}");
    let error = Adjustment {
        pan_deg: 0.5,
        ..Adjustment::default()
    };
    state_wrongly(&mut samples, error);
    let found = droppings(&samples).0.contradictions(&views);
    let [left, right] = [0, 1].map(|view: usize| &found[view]);
    assert!(
        left.contains("view left is turned 0.5") && left.contains("degrees left"),
        "{left}"
    );
    assert!(
        right.contains("view right is turned 0.5") && right.contains("degrees right"),
        "{right}"
    );
    let said = |registered_again| contradictions_line(&found, registered_again);
    assert!(said(false).contains("--registration-of RUN"));
    assert!(
        !said(true).contains("--registration-of") && said(true).contains("only `triangulation`")
    );
}
