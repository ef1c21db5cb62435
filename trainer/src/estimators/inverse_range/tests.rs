//! Fits to synthetic boxes.

use dataset::corpus::splits::Side;
use glam::DVec2;

use super::*;
use crate::samples::sides::flight_parts::FlightParts;
use crate::samples::tests::fixtures::registered_corpus;
use crate::samples::{CommonError, Samples};

fn fit(samples: &Samples, training: &[&Sample]) -> InverseRange {
    InverseRange::fit(samples.views.len(), training)
}

/// Mean and maximum error beyond 1 NM, percent, over answered test samples, and their number.
fn errors_pct<'a>(
    fitted: &InverseRange,
    test: impl IntoIterator<Item = &'a Sample>,
) -> (f64, f64, usize) {
    let beyond = test.into_iter().filter(|sample| sample.dtd_m > 1_852.0);
    let error = |sample: &Sample| {
        let distance_m = fitted.predict(sample)?;
        Some((distance_m / sample.dtd_m - 1.0).abs() * 100.0)
    };
    let errors: Vec<f64> = beyond.filter_map(error).collect();
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    (
        mean,
        errors.iter().copied().fold(0.0, f64::max),
        errors.len(),
    )
}

fn seen_by(sample: &Sample, views: &[usize]) -> Sample {
    sample.with(sample.with_boxes_that(|view, _| views.contains(&view)))
}

#[test]
fn registered_shifts_give_several_times_the_precision_of_boxes_and_both_beat_one_view() {
    let samples = Samples::synthetic(&registered_corpus(0.05), 0.05);
    let fitted = fit(&samples, &samples.of_side(Side::Train));
    let test: Vec<&Sample> = samples.of_side(Side::Test);
    let both: Vec<&Sample> = test
        .iter()
        .copied()
        .filter(|s| s.detections() == 2)
        .collect();
    let (shifts, worst, count) = errors_pct(&fitted, both.iter().copied());
    let without_shifts: Vec<Sample> = both
        .iter()
        .map(|sample| {
            let mut sample = (*sample).clone();
            sample.observed.shifts = vec![None; 2];
            sample
        })
        .collect();
    let (boxes, _, box_count) = errors_pct(&fitted, &without_shifts);
    let alone: Vec<Sample> = both.iter().map(|sample| seen_by(sample, &[1])).collect();
    let (one_view, _, one_count) = errors_pct(&fitted, &alone);
    println!(
        "{shifts:.4} % (at most {worst:.3} %), boxes {boxes:.4} %, one view {one_view:.3} %; {count} ticks"
    );
    assert!(count > 50 && box_count == count && one_count == count);
    assert!(shifts < 0.03 && worst < 0.2, "{shifts} {worst}");
    assert!(boxes > 2.0 * shifts && boxes < 0.15, "{boxes}");
    assert!(one_view > 2.0 * boxes && one_view < 5.0, "{one_view}");
}

#[test]
fn an_error_that_all_ticks_share_moves_the_distance_as_far_as_it_is_stated_to() {
    const OFF: CommonError = CommonError {
        view: 1,
        sd_px: DVec2::new(0.1, 0.02),
    };
    let samples = Samples::synthetic(&registered_corpus(0.05), 0.05);
    let fitted = fit(&samples, &samples.of_side(Side::Train));
    let both = |sample: &&Sample| sample.detections() == 2;
    let mut test = samples.of_side(Side::Test).into_iter().filter(both);
    let (far, near) = (test.next().unwrap(), test.next_back().unwrap());
    for sample in [far, near] {
        let measured = |observed: &Observation| fitted.measurements(observed)[0];
        let usual = measured(sample);
        let moved = measured(&sample.moved(|view, place_px| {
            let is_off = view == OFF.view;
            Some(place_px + if is_off { OFF.sd_px } else { DVec2::ZERO })
        }));
        let stated = measured(&sample.observed.clone().with_common([OFF]));
        let off_m = (moved.distance_m - usual.distance_m).abs();
        assert!(
            off_m > 0.05 && (stated.common_sd_m / off_m - 1.0).abs() < 0.02,
            "{off_m} m, stated as {} m",
            stated.common_sd_m
        );
        let expected = Measurement {
            common_sd_m: stated.common_sd_m,
            ..usual
        };
        assert_eq!(stated, expected);
    }
}

#[test]
fn the_cameras_stand_where_the_search_finds_them() {
    let samples = Samples::synthetic(&registered_corpus(0.05), 0.05);
    let fitted = fit(&samples, &samples.of_side(Side::Train));
    let best = &fitted.fits[0];
    assert!(best.set.registered && best.set.views == [0, 1]);
    // The rig's masts are 1,500 m behind the target.
    assert!(
        (best.setback_m - 1_500.0).abs() < 100.0,
        "{}",
        best.setback_m
    );
}

#[test]
fn flights_on_one_line_do_not_make_it_explode_beside_that_line() {
    let samples = Samples::synthetic(&registered_corpus(0.05), 0.05);
    let training = samples.of_side(Side::Train);
    for scenario in 0..4 {
        let one: Vec<&Sample> = training
            .iter()
            .copied()
            .filter(|sample| sample.scenario == scenario)
            .collect();
        let fitted = fit(&samples, &one);
        let both = |sample: &&Sample| sample.detections() == 2;
        let test = samples.of_side(Side::Test).into_iter().filter(both);
        let (mean, worst, _) = errors_pct(&fitted, test);
        println!("one flight: {mean:.3} %, at most {worst:.2} %");
        assert!(mean < 0.5, "{mean}");
    }
}

#[test]
fn a_few_ticks_that_are_far_off_hardly_move_it() {
    let samples = Samples::synthetic(&registered_corpus(0.05), 0.05);
    let mut training: Vec<Sample> = samples.of_side(Side::Train).into_iter().cloned().collect();
    for sample in training.iter_mut().step_by(25) {
        sample.dtd_m *= 1.1;
    }
    let fitted = fit(&samples, &training.iter().collect::<Vec<_>>());
    let both = |sample: &&Sample| sample.detections() == 2;
    let test = samples.of_side(Side::Test).into_iter().filter(both);
    let (mean, _, _) = errors_pct(&fitted, test);
    assert!(mean < 0.05, "{mean} % with 4 % of the labels 10 % off");
}

#[test]
fn without_enough_ticks_there_is_no_fit_and_no_answer() {
    let samples = Samples::synthetic(&registered_corpus(0.05), 0.05);
    let training = samples.of_side(Side::Train);
    let both = |sample: &&&Sample| sample.detections() == 2;
    let few: Vec<&Sample> = training.iter().filter(both).copied().take(20).collect();
    let fitted = fit(&samples, &few);
    // Enough for each view alone, not for both.
    assert_eq!(fitted.fits.len(), 2);
    assert!(fitted.fits.iter().all(|fit| fit.set.views.len() == 1));
    assert!(fitted.predict(few[3]).is_some(), "the better of both views");
    assert_eq!(fitted.predict(&seen_by(few[3], &[])), None);
    let none = fit(&samples, &few[..5]);
    assert_eq!(none, InverseRange::default());
    assert_eq!(none.predict(few[3]), None);
}

#[test]
fn places_that_no_distance_fits_have_no_answer() {
    let samples = Samples::synthetic(&registered_corpus(0.05), 0.05);
    let fitted = fit(&samples, &samples.of_side(Side::Train));
    let both = |sample: &&Sample| sample.detections() == 2;
    let mut sample = samples
        .of_side(Side::Test)
        .into_iter()
        .find(both)
        .unwrap()
        .clone();
    sample.observed.shifts = vec![None; 2];
    // Closer, the left view has it further left and the right view further right. This would be beyond infinity.
    sample.observed.best_mut(0).unwrap().cx_px += 900.0;
    sample.observed.best_mut(1).unwrap().cx_px -= 900.0;
    assert_eq!(fitted.predict(&sample), None);
}

#[test]
fn a_view_is_fitted_again_without_touching_the_fits_of_others() {
    let samples = Samples::synthetic(&registered_corpus(0.05), 0.05);
    let training = samples.of_side(Side::Train);
    let fitted = fit(&samples, &training);
    let other_flights: Vec<&Sample> = training
        .iter()
        .copied()
        .filter(|sample| sample.scenario > 0)
        .collect();
    let refitted = |approaches: &[&Sample]| {
        let parts = FlightParts::of(&samples, approaches.iter().copied());
        let refitted = fitted.for_new_camera(1, parts, approaches);
        refitted.map(|refitted| refitted.all)
    };
    let of_few = refitted(&other_flights[..20]);
    let refitted = refitted(&other_flights).unwrap();
    let sets = |fitted: &InverseRange| {
        let mut sets: Vec<_> = fitted.fits.iter().map(|fit| fit.set.clone()).collect();
        sets.sort_by_key(|set| (set.views.clone(), set.registered));
        sets
    };
    assert_eq!(sets(&refitted), sets(&fitted));
    assert_eq!(refitted.without(1), fitted.without(1));
    assert_ne!(refitted.without(0), fitted.without(0));
    let own = fit(&samples, &other_flights);
    assert_eq!(refitted.without(0), own.without(0));
    assert_eq!(of_few, None);
}

#[test]
fn a_view_by_itself_is_less_precise_far_from_the_flights_that_it_learned_from_and_all_views_are_not()
 {
    let samples = Samples::synthetic(&registered_corpus(0.05), 0.05);
    let fitted = fit(&samples, &samples.of_side(Side::Train));
    let test = samples.of_side(Side::Test);
    // At a distance where flights have long joined the usual path.
    let sample = test.iter().find(|sample| sample.dtd_m < 6_000.0).unwrap();
    let moved =
        |right_px: f64| sample.moved(|_, place_px| Some(place_px + DVec2::new(right_px, 0.0)));
    let [usual, beside] = [0.0, 150.0].map(|right_px| fitted.measurements(&moved(right_px)));
    let mut alone = 0;
    for (usual, beside) in usual.iter().zip(&beside) {
        assert_eq!(usual.fit, beside.fit);
        if usual.of_one_view {
            alone += 1;
            assert!(
                beside.precision < 0.5 * usual.precision,
                "{usual:?} {beside:?}"
            );
        } else {
            assert_eq!(beside.precision, usual.precision);
        }
    }
    assert_eq!(alone, 2);
    // Without covariances, all measurements have the same precision.
    let mut unknown = fitted;
    for fit in &mut unknown.fits {
        fit.covariance_per_m2.clear();
    }
    assert!(unknown.is_of(2));
    let precisions = |right_px: f64| -> Vec<f64> {
        let measured = unknown.measurements(&moved(right_px));
        measured.iter().map(|m| m.precision).collect()
    };
    assert_eq!(precisions(0.0), precisions(150.0));
}
