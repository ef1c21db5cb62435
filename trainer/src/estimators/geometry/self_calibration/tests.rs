//! Cameras fitted to synthetic boxes and shifts.

use dataset::corpus::calibration::CameraEntry;
use dataset::corpus::splits::Side;
use dataset::geometry::distortion::Distortion;
use dataset::geometry::imaging::Imaging;
use testkit::synthetic::{Changed, SyntheticCorpus};

use super::*;
use crate::samples::Samples;
use crate::samples::tests::fixtures::registered_corpus;

fn fit(rig: &Cameras, samples: &Samples, training: &[&Sample]) -> Option<SelfCalibrated> {
    let config = SelfCalibrationConfig::default();
    SelfCalibrated::fit(rig, &samples.scenarios, training, &config)
}

/// A planned rig that is turned, zoomed and moved relative to the true one.
fn planned(true_rig: &Cameras, turned_deg: f64, focal_ratio: f64) -> Cameras {
    let off = |(index, (view, entry)): (usize, (&String, &CameraEntry))| {
        let sign = if index == 0 { 1.0 } else { -1.0 };
        let mut placed = entry.placed;
        placed.pose.heading_true_deg += sign * turned_deg;
        placed.pose.pitch_deg -= 0.5 * turned_deg;
        placed.pose.roll_deg += 0.3 * turned_deg;
        placed.pose.altitude_msl_m += 1.5 * sign;
        placed.hfov_deg *= focal_ratio;
        let planned = CameraEntry::from_pose(placed, entry.width_px, entry.height_px);
        (view.clone(), planned.with_imaging(&entry.imaging()))
    };
    true_rig.iter().enumerate().map(off).collect()
}

/// Mean and maximum error on test samples seen by two views, percent.
fn errors_pct(fitted: &SelfCalibrated, samples: &Samples) -> (f64, f64) {
    let locator = fitted.locator();
    let test = samples.of_side(Side::Test).into_iter();
    let errors: Vec<f64> = test
        .filter(|sample| sample.detections() == 2 && sample.dtd_m > 1_852.0)
        .map(|sample| {
            let found = locator.distance_m(sample, &samples.scenarios[sample.scenario]);
            (found.unwrap() / sample.dtd_m - 1.0).abs() * 100.0
        })
        .collect();
    assert!(errors.len() > 50);
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    (mean, errors.iter().copied().fold(0.0, f64::max))
}

/// Normalised error of each camera number.
fn deviations_off(fitted: &FittedCamera, truth: &Camera) -> [f64; UNKNOWNS] {
    let found = fitted.camera();
    let seen = found.ecef_from_camera.transpose() * truth.ecef_from_camera;
    let moved_m = Geodetic::from_ecef(truth.center_ecef_m)
        .ecef_from_ned()
        .transpose()
        * (truth.center_ecef_m - found.center_ecef_m);
    let rig = fitted.rig.camera();
    let off = Adjustment {
        pan_deg: seen.z_axis.x.asin().to_degrees(),
        tilt_deg: (-seen.z_axis.y).asin().to_degrees(),
        roll_deg: seen.x_axis.y.asin().to_degrees(),
        focal_pct: (truth.focal_px - found.focal_px) / rig.focal_px * 100.0,
        north_m: moved_m.x,
        east_m: moved_m.y,
        up_m: -moved_m.z,
    };
    let (off, sd) = (off.to_array(), fitted.sd.to_array());
    std::array::from_fn(|i| off[i] / sd[i])
}

#[test]
fn cameras_that_are_not_where_the_plan_has_them_are_found_within_their_stated_deviations() {
    let samples = Samples::synthetic(&registered_corpus(0.05), 0.5);
    let rig = planned(&samples.rig.cameras, 0.7, 0.97);
    let fitted = fit(&rig, &samples, &samples.of_side(Side::Train)).unwrap();
    for (camera, truth) in fitted.cameras.iter().zip(&samples.scenarios[0].cameras) {
        let camera = camera.as_ref().unwrap();
        let off = deviations_off(camera, truth);
        println!("off by {off:.2?} of {:?}", camera.sd);
        assert!(off.iter().all(|off| off.abs() < 4.0), "{off:?}");
        assert!(
            camera.sd.pan_deg < 0.01 && camera.sd.focal_pct < 0.3,
            "{:?}",
            camera.sd
        );
        // Half of the common 1.5 m error in height is absorbed by the height of the point.
        assert!(
            camera.sd.up_m < 2.0 && camera.ticks > 100,
            "{:?}",
            camera.sd
        );
    }
    let (mean, worst) = errors_pct(&fitted, &samples);
    println!("{mean:.4} %, at most {worst:.3} %");
    assert!(mean < 0.03 && worst < 0.2, "{mean} {worst}");
    assert!(
        (fitted.deviations.box_px[0] - 0.25).abs() < 0.05,
        "{:?}",
        fitted.deviations
    );
}

#[test]
fn two_degrees_and_ten_percent_of_zoom_are_within_reach_of_the_fit() {
    let samples = Samples::synthetic(&registered_corpus(0.05), 0.5);
    let rig = planned(&samples.rig.cameras, 2.0, 1.1);
    let fitted = fit(&rig, &samples, &samples.of_side(Side::Train)).unwrap();
    let (mean, _) = errors_pct(&fitted, &samples);
    assert!(mean < 0.03, "{mean}");
}

#[test]
fn one_flight_is_enough_and_states_that_it_knows_less() {
    let samples = Samples::synthetic(&registered_corpus(0.05), 0.5);
    let training = samples.of_side(Side::Train);
    let rig = planned(&samples.rig.cameras, 0.3, 1.02);
    let all = fit(&rig, &samples, &training).unwrap();
    let sd = |fitted: &SelfCalibrated| fitted.cameras[0].as_ref().unwrap().sd;
    for scenario in 0..4 {
        let one = training.iter().filter(|s| s.scenario == scenario);
        let fitted = fit(&rig, &samples, &one.copied().collect::<Vec<_>>()).unwrap();
        let (mean, worst) = errors_pct(&fitted, &samples);
        println!("one flight: {mean:.4} %, at most {worst:.3} %");
        assert!(mean < 0.1, "{mean}");
        assert!(sd(&fitted).focal_pct > sd(&all).focal_pct);
    }
}

#[test]
fn boxes_of_other_things_hardly_move_it() {
    let samples = Samples::synthetic(&registered_corpus(0.05), 0.5);
    let mut training: Vec<Sample> = samples.of_side(Side::Train).into_iter().cloned().collect();
    for seen in training
        .iter_mut()
        .step_by(15)
        .filter_map(|s| s.observed.best_mut(1))
    {
        seen.cx_px += 300.0;
        seen.cy_px -= 150.0;
    }
    let training: Vec<&Sample> = training.iter().collect();
    let rig = planned(&samples.rig.cameras, 0.7, 0.97);
    let fitted = fit(&rig, &samples, &training).unwrap();
    let (mean, _) = errors_pct(&fitted, &samples);
    assert!(mean < 0.04, "{mean}");
}

#[test]
fn a_view_that_saw_nothing_is_not_fitted_and_two_views_are_needed_to_fit_and_to_answer() {
    let samples = Samples::synthetic(&registered_corpus(0.05), 0.5);
    let one_eyed: Vec<Sample> = samples
        .of_side(Side::Train)
        .into_iter()
        .map(|sample| sample.with(sample.with_boxes_that(|view, _| view == 0)))
        .collect();
    let rig = &samples.rig.cameras;
    assert_eq!(
        fit(rig, &samples, &one_eyed.iter().collect::<Vec<_>>()),
        None
    );
    assert_eq!(fit(rig, &samples, &[]), None);
    let fitted = fit(rig, &samples, &samples.of_side(Side::Train)).unwrap();
    let locator = fitted.locator();
    let both = samples.of_side(Side::Test).into_iter();
    let both = both.filter(|sample| sample.detections() == 2).take(20);
    for sample in both {
        let scenario = &samples.scenarios[sample.scenario];
        assert!(locator.distance_m(sample, scenario).is_some());
        let alone = sample.with_boxes_that(|view, _| view == 1);
        assert_eq!(locator.distance_m(&alone, scenario), None);
        let mut elsewhere = sample.clone();
        let seen = elsewhere.observed.best_mut(0).unwrap();
        seen.cy_px -= 300.0;
        assert_eq!(locator.distance_m(&elsewhere, scenario), None);
    }
}

#[test]
fn a_third_view_without_boxes_leaves_the_other_two_as_they_are() {
    let mut samples = Samples::synthetic(&registered_corpus(0.05), 0.5);
    let mut rig = samples.rig.cameras.clone();
    let third = rig["right"].clone();
    rig.insert("third".into(), third);
    for sample in &mut samples.samples {
        sample.observed.candidates.push(Vec::new());
        sample.observed.shifts.push(None);
    }
    let fitted = fit(&rig, &samples, &samples.of_side(Side::Train)).unwrap();
    assert!(fitted.cameras[..2].iter().all(Option::is_some) && fitted.cameras[2].is_none());
    let (mean, _) = errors_pct(&fitted, &samples);
    assert!(mean < 0.03, "{mean}");
}

#[test]
fn lenses_of_the_rig_count_and_bent_light_goes_into_tilt_and_height() {
    let imaging = |refraction_coefficient: f64| Imaging {
        distortion: Some(Distortion {
            k1: -2.0,
            p1: 0.002,
            ..Distortion::default()
        }),
        refraction_coefficient,
        degradation: None,
    };
    let samples = Samples::synthetic(
        &SyntheticCorpus {
            imaging: imaging(0.13),
            ..registered_corpus(0.05)
        },
        0.5,
    );
    let mut rig = samples.rig.cameras.clone();
    for entry in rig.values_mut() {
        *entry = entry.clone().with_imaging(&imaging(0.0));
    }
    let fitted = fit(&rig, &samples, &samples.of_side(Side::Train)).unwrap();
    let (mean, _) = errors_pct(&fitted, &samples);
    assert!(mean < 0.04, "{mean}");
}

#[test]
fn cameras_that_differ_between_scenarios_give_their_mean_and_a_large_deviation() {
    let samples = Samples::synthetic(
        &SyntheticCorpus {
            turned_deg: 0.1,
            ..registered_corpus(0.05)
        },
        0.5,
    );
    let fitted = fit(
        &samples.rig.nominal,
        &samples,
        &samples.of_side(Side::Train),
    )
    .unwrap();
    // A turn of 0.1 degrees is 19 pixels.
    let [right_px, down_px] = fitted.deviations.box_px;
    assert!(right_px > 3.0 && down_px < 1.0, "{right_px} {down_px}");
    let camera = fitted.cameras[0].as_ref().unwrap();
    let camera_from_ecef = camera.rig.camera().ecef_from_camera.transpose();
    let training = samples.scenarios.iter().filter(|s| s.side == Side::Train);
    let turns_deg: Vec<f64> = training
        .map(|scenario| camera_from_ecef * scenario.cameras[0].ecef_from_camera.z_axis)
        .map(|axis| axis.x.asin().to_degrees())
        .collect();
    let mean_deg = turns_deg.iter().sum::<f64>() / turns_deg.len() as f64;
    let found_deg = camera.adjustment.pan_deg;
    assert!(
        (found_deg - mean_deg).abs() < 0.05,
        "{found_deg} {mean_deg}"
    );
}

#[test]
fn a_turned_and_zoomed_camera_is_fitted_again_and_the_other_one_is_not_touched() {
    let before = Samples::synthetic(&registered_corpus(0.05), 0.5);
    let training = before.of_side(Side::Train);
    let fitted = fit(&before.rig.cameras, &before, &training).unwrap();
    let after = Samples::synthetic(
        &SyntheticCorpus {
            changed: Some(Changed {
                view: "left",
                turned_deg: 2.0,
                zoom: 1.1,
            }),
            ..registered_corpus(0.05)
        },
        0.5,
    );
    let config = SelfCalibrationConfig::default();
    let flights = after.of_side(Side::Train);
    let refitted = fitted
        .refitted(0, None, &after.scenarios, &flights, &config)
        .unwrap();
    assert_eq!(refitted.without(0), fitted.without(0));
    let (old, _) = errors_pct(&fitted, &before);
    let (new, _) = errors_pct(&refitted, &after);
    println!("{old:.4} %, refitted {new:.4} %");
    assert!(new < 1.3 * old, "{new} {old}");
    let camera = refitted.cameras[0].as_ref().unwrap();
    let truth = &after.scenarios[0].cameras[0];
    // The second camera and the point on the aircraft are taken as exact.
    let off = deviations_off(camera, truth);
    assert!(
        (camera.adjustment.pan_deg - 2.0).abs() < 0.01 && off[3].abs() < 10.0,
        "{off:?}"
    );
    let few = &flights[..MIN_TICKS / 2];
    assert_eq!(
        fitted.refitted(0, None, &after.scenarios, few, &config),
        None
    );
}
