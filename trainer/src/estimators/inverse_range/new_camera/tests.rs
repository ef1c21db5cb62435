//! New cameras of a rig whose shifts follow the contrast.

use dataset::corpus::splits::Side;
use dataset::work::watch::Silent;
use rand::SeedableRng;
use testkit::rig::placed;

use super::super::contrast_samples::{error, learned, samples, settings, without_network};
use super::*;
use crate::networks::checkpoint::Checkpoints;
use crate::samples::Samples;

/// Test flights: four approaches of a new camera, and two that judge.
fn approaches_and_others(samples: &Samples) -> [Vec<&Sample>; 2] {
    let flights = samples.of_side(Side::Test);
    let fourth = flights.iter().map(|tick| tick.scenario).min().unwrap() + 3;
    let (approaches, others) = flights
        .into_iter()
        .partition(|tick| tick.scenario <= fourth);
    [approaches, others]
}

fn refitted(
    fits: &InverseRange,
    view: usize,
    samples: &Samples,
    approaches: &[&Sample],
) -> Refitted {
    let parts = FlightParts::of(samples, approaches.iter().copied());
    let companions = &mut Companions {
        checkpoints: &mut Checkpoints::none(),
        watch: &Silent,
    };
    let new = NewCamera {
        view,
        cameras: None,
    };
    let random = ChaCha12Rng::seed_from_u64(0);
    let refitted = fits.for_new_camera(new, parts, approaches, &settings(), random, companions);
    refitted.unwrap().unwrap()
}

#[test]
fn a_network_that_still_helps_stays_and_only_what_belongs_to_the_view_changes() {
    let samples = samples(&[]);
    let (fits, _) = learned(&samples);
    let [approaches, others] = approaches_and_others(&samples);
    for view in [0, 1] {
        let of = |fits: &InverseRange| refitted(fits, view, &samples, &approaches);
        let (with, alone) = (of(&fits.all), of(&without_network(&fits.all)));
        println!("{}", with.residual.unwrap());
        assert_ne!(with.residual.unwrap().network, Outcome::Dropped);
        assert!(alone.residual.is_none());
        let error = |refitted: &Refitted| error(&refitted.fits.all, &others);
        let (with_error, alone_error) = (error(&with), error(&alone));
        assert!(with_error < 0.6 * alone_error, "{with_error} {alone_error}");
        assert_eq!(with.fits.all.without(view), fits.all.without(view));
        // Approaches that a fit did not see are also measured by it with a network.
        let parts = with.fits.others.iter().flatten();
        assert_eq!(parts.filter(|fits| fits.residual.is_some()).count(), 4);
    }
}

#[test]
fn a_network_whose_camera_turns_its_effect_round_is_trained_on_until_it_helps() {
    let (samples, reversed) = (samples(&[]), samples(&[Side::Test]));
    let (fits, _) = learned(&samples);
    let [approaches, others] = approaches_and_others(&reversed);
    let of = |fits: &InverseRange| refitted(fits, 1, &reversed, &approaches);
    let (with, alone) = (of(&fits.all), of(&without_network(&fits.all)));
    println!("{}", with.residual.unwrap());
    assert_eq!(with.residual.unwrap().network, Outcome::TrainedOn);
    assert_ne!(with.fits.all.residual, fits.all.residual);
    let [with, alone] = [&with, &alone].map(|of| error(&of.fits.all, &others));
    assert!(with < alone, "{with} {alone}");
}

#[test]
fn a_network_that_tells_nothing_of_approaches_that_it_did_not_see_is_dropped() {
    let (mut samples, reversed) = (samples(&[]), samples(&[Side::Test]));
    let (fits, _) = learned(&samples);
    // Of each pair of flights one is the other way round.
    for (sample, reversed) in samples.samples.iter_mut().zip(reversed.samples) {
        if sample.scenario % 2 == 0 {
            *sample = reversed;
        }
    }
    let [approaches, _] = approaches_and_others(&samples);
    let of = |fits: &InverseRange| refitted(fits, 1, &samples, &approaches);
    let (with, alone) = (of(&fits.all), of(&without_network(&fits.all)));
    println!("{}", with.residual.unwrap());
    assert_eq!(with.residual.unwrap().network, Outcome::Dropped);
    assert_eq!(with.fits.all, alone.fits.all);
}

#[test]
fn of_a_single_flight_and_its_copies_nothing_is_learned_about_a_network_and_it_stays() {
    let mut samples = samples(&[]);
    let (fits, _) = learned(&samples);
    let first = samples
        .scenarios
        .iter()
        .position(|s| s.side == Side::Test)
        .unwrap();
    samples.scenarios[first + 1].flight = samples.scenarios[first].flight.clone();
    let [mut approaches, _] = approaches_and_others(&samples);
    approaches.retain(|tick| tick.scenario <= first + 1);
    let found = refitted(&fits.all, 1, &samples, &approaches);
    assert!(found.residual.is_none());
    assert_eq!(found.fits.all.residual, fits.all.residual);
    assert_ne!(found.fits.all.fits, fits.all.fits);
}

#[test]
fn a_network_on_fits_without_the_view_is_not_touched() {
    let samples = samples(&[]);
    let (mut fits, _) = learned(&samples);
    let approaches = samples.of_side(Side::Test);
    let of_second = fits.all.fits.iter().position(|fit| fit.set.views == [1]);
    fits.all.residual.as_mut().unwrap().inputs.fit = of_second.unwrap();
    let found = refitted(&fits.all, 0, &samples, &approaches);
    assert!(found.residual.is_none());
    assert_eq!(found.fits.all.residual, fits.all.residual);
}

#[test]
fn a_refitted_fit_makes_room_for_what_the_network_tells_of_the_light_of_the_approaches() {
    let samples = samples(&[]);
    let (fits, _) = learned(&samples);
    // All approaches in one light, flights later in both.
    let [mut approaches, others] = approaches_and_others(&samples);
    approaches.retain(|sample| sample.tick.is_multiple_of(2));
    let residual = fits.all.residual.as_ref().unwrap();
    let with_error: Vec<Sample> = approaches.iter().map(|s| residual.with_error(s)).collect();
    let with_error: Vec<&Sample> = with_error.iter().collect();
    let refitted = fits.all.corrected(residual, &with_error).unwrap();
    let [before, after] = [&fits.all, &refitted].map(|fits| error(fits, &others));
    assert!(after < 1.5 * before, "{after} {before}");
}

#[test]
fn a_network_expects_the_aircraft_as_large_as_a_zoomed_and_moved_camera_shows_it() {
    let samples = samples(&[]);
    let (fits, _) = learned(&samples);
    let residual = fits.all.residual.as_ref().unwrap();
    let approaches = samples.of_side(Side::Test);
    let old = Camera::from_pose(&placed("right"), 1920, 1280);
    let mut new = placed("right");
    new.hfov_deg *= 0.9;
    new.pose.latitude_deg += 0.002;
    let new = Camera::from_pose(&new, 1920, 1280);
    let sample = approaches[5].clone();
    let aircraft_m = sample.position.to_ecef();
    let [old_size, new_size] = [&old, &new].map(|c| c.focal_px / c.to_camera(aircraft_m).z);
    let larger = new_size / old_size;
    let before_m = residual.corrected_m(&sample, sample.dtd_m);
    for (view, scale) in [(1, larger), (0, larger.recip())] {
        let changed = Residual {
            inputs: residual
                .inputs
                .for_new_camera(view, [old, new], &approaches),
            layers: residual.layers.clone(),
        };
        let mut sample = sample.clone();
        sample.observed.shifts[1].as_mut().unwrap().scale *= scale;
        let after_m = changed.corrected_m(&sample, sample.dtd_m);
        assert!(
            (after_m / before_m - 1.0).abs() < 2e-6,
            "{after_m} {before_m}"
        );
        let unchanged_m = residual.corrected_m(&sample, sample.dtd_m);
        assert!(
            (unchanged_m / before_m - 1.0).abs() > 1e-5,
            "{unchanged_m} {before_m}"
        );
    }
}
