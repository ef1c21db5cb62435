//! New cameras of a rig whose shifts follow the contrast.

use dataset::progress::Silent;
use dataset::splits::Side;
use rand::SeedableRng;

use super::super::residual_training::tests::{error, learned, samples, settings};
use super::*;
use crate::checkpoint::Checkpoints;
use crate::samples::Samples;

/// Those of a new camera of the view.
fn refitted(
    fits: &InverseRange,
    view: usize,
    zoom: Option<f64>,
    samples: &Samples,
    approaches: &[&Sample],
) -> Refitted {
    let parts = FlightParts::of(samples, approaches.iter().copied());
    let watch = &mut Watch {
        checkpoints: &mut Checkpoints::none(),
        progress: &mut Silent,
    };
    let (new, random) = (NewCamera { view, zoom }, ChaCha12Rng::seed_from_u64(0));
    let refitted = fits.for_new_camera(new, &parts, approaches, &settings(), random, watch);
    refitted.unwrap().unwrap()
}

fn without_network(fits: &InverseRange) -> InverseRange {
    InverseRange {
        residual: None,
        ..fits.clone()
    }
}

#[test]
fn after_a_refit_the_network_still_helps_and_only_what_belongs_to_the_view_has_changed() {
    let samples = samples(None);
    let (fits, _) = learned(&samples);
    let approaches = samples.of_side(Side::Train);
    for view in [0, 1] {
        let of = |fits: &InverseRange| refitted(fits, view, Some(1.0), &samples, &approaches);
        let (with, alone) = (of(&fits.all), of(&without_network(&fits.all)));
        assert!(with.residual.unwrap().is_kept() && alone.residual.is_none());
        let error = |refitted: &Refitted| error(&refitted.fits.all, &samples, Side::Test);
        let (with_error, alone_error) = (error(&with), error(&alone));
        assert!(with_error < 0.6 * alone_error, "{with_error} {alone_error}");
        assert_eq!(with.fits.all.without(view), fits.all.without(view));
        // Approaches that a fit did not see are measured by it with a network, too.
        assert_eq!(with.fits.others.len(), 4);
        let others = with.fits.others.iter().flatten();
        assert!(others.filter(|fits| fits.residual.is_some()).count() == 4);
    }
}

#[test]
fn a_network_whose_camera_turns_its_effect_round_is_trained_on_until_it_helps() {
    let (samples, reversed) = (samples(None), samples(Some(Side::Train)));
    let (fits, _) = learned(&samples);
    let approaches = reversed.of_side(Side::Train);
    let of = |fits: &InverseRange| refitted(fits, 1, Some(1.0), &reversed, &approaches);
    let (with, alone) = (of(&fits.all), of(&without_network(&fits.all)));
    let record = with.residual.unwrap();
    println!("{record:?}");
    assert!(record.is_kept());
    assert_ne!(with.fits.all.residual, fits.all.residual);
    let [with, alone] = [&with, &alone].map(|of| error(&of.fits.all, &reversed, Side::Train));
    assert!(with < alone, "{with} {alone}");
}

#[test]
fn a_network_that_tells_nothing_of_approaches_that_it_did_not_see_is_dropped() {
    let (mut samples, reversed) = (samples(None), samples(Some(Side::Train)));
    let (fits, _) = learned(&samples);
    // Of each pair of flights one is the other way round.
    for (sample, reversed) in samples.samples.iter_mut().zip(reversed.samples) {
        if sample.scenario % 2 == 0 {
            *sample = reversed;
        }
    }
    let approaches = samples.of_side(Side::Train);
    let of = |fits: &InverseRange| refitted(fits, 1, Some(1.0), &samples, &approaches);
    let (with, alone) = (of(&fits.all), of(&without_network(&fits.all)));
    println!("{:?}", with.residual);
    assert!(!with.residual.unwrap().is_kept());
    assert_eq!(with.fits.all, alone.fits.all);
}

#[test]
fn without_the_zoom_or_without_an_approach_to_judge_it_a_network_is_dropped() {
    let samples = samples(None);
    let (fits, _) = learned(&samples);
    let approaches = samples.of_side(Side::Train);
    let one: Vec<&Sample> = approaches
        .iter()
        .copied()
        .filter(|s| s.scenario == 0)
        .collect();
    for (zoom, approaches) in [(None, &approaches), (Some(1.0), &one)] {
        let found = refitted(&fits.all, 1, zoom, &samples, approaches);
        let alone = refitted(&without_network(&fits.all), 1, zoom, &samples, approaches);
        assert!(found.residual.is_none());
        assert_eq!(found.fits.all, alone.fits.all);
    }
}

#[test]
fn a_refitted_fit_makes_room_for_what_the_network_tells_of_the_light_of_the_approaches() {
    let samples = samples(None);
    let (fits, _) = learned(&samples);
    // All approaches in one light, flights later in both.
    let mut approaches = samples.of_side(Side::Train);
    approaches.retain(|sample| sample.tick.is_multiple_of(2));
    let residual = fits.all.residual.as_ref();
    let refitted = fits
        .all
        .with_view_refitted(1, residual, &approaches)
        .unwrap();
    let [before, after] = [&fits.all, &refitted].map(|fits| error(fits, &samples, Side::Test));
    assert!(after < 1.5 * before, "{after} {before}");
}

#[test]
fn a_zoomed_camera_sees_the_aircraft_larger_and_its_network_expects_that() {
    let samples = samples(None);
    let (fits, _) = learned(&samples);
    let residual = fits.all.residual.as_ref().unwrap();
    let sample = samples.of_side(Side::Test)[5].clone();
    let before_m = residual.corrected_m(&sample, sample.dtd_m);
    for (view, scale) in [(1, 1.1), (0, 1.0 / 1.1)] {
        let changed = Residual {
            inputs: residual.inputs.clone().zoomed(view, 1.1),
            layers: residual.layers.clone(),
        };
        assert_ne!(changed, *residual);
        let mut sample = sample.clone();
        sample.observed.shifts[1].as_mut().unwrap().scale *= scale;
        let after_m = changed.corrected_m(&sample, sample.dtd_m);
        assert!((after_m - before_m).abs() < 1e-6, "{after_m} {before_m}");
    }
}
