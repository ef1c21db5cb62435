//! Shifts that follow another part of the aircraft where one view shows it with more contrast, as lamps do at night.

use dataset::progress::Silent;
use dataset::splits::Side;
use rand::SeedableRng;
use testkit::synthetic::SyntheticCorpus;

use super::*;
use crate::checkpoint::Checkpoints;
use crate::config::Optimisation;
use crate::samples::{DistanceRange, Samples};

/// Samples of such a corpus; on one of the sides it may be the other way round.
pub(in super::super) fn samples(reversed: Option<Side>) -> Samples {
    let corpus = |by_contrast| SyntheticCorpus {
        shift_noise_px: Some(0.02),
        shift_by_contrast: Some(by_contrast),
        ..SyntheticCorpus::tiny()
    };
    let read = |corpus: SyntheticCorpus| {
        let folder = tempfile::tempdir().unwrap();
        let corpus = corpus.write(folder.path()).unwrap();
        let range = DistanceRange {
            min_nm: 0.3,
            max_nm: None,
        };
        Samples::read(&corpus, None, range).unwrap()
    };
    let (mut samples, other) = (read(corpus(1e-4)), read(corpus(-1e-4)));
    let sides: Vec<Side> = samples.scenarios.iter().map(|s| s.side).collect();
    for (sample, other) in samples.samples.iter_mut().zip(other.samples) {
        if Some(sides[sample.scenario]) == reversed {
            *sample = other;
        }
    }
    samples
}

pub(in super::super) fn settings() -> ResidualConfig {
    ResidualConfig {
        hidden: vec![8],
        optimisation: Optimisation {
            steps: 400,
            batch_size: 64,
            learning_rate: 1e-2,
        },
    }
}

/// The fits, and what the networks were worth.
pub(in super::super) fn learned(samples: &Samples) -> (CrossFitted, ResidualRecord) {
    let training = samples.of_side(Side::Train);
    let validation: Vec<Sample> = samples
        .of_side(Side::Validation)
        .into_iter()
        .cloned()
        .collect();
    let mut fits = CrossFitted::fit(samples, &training);
    let config = settings();
    let watch = &mut Watch {
        checkpoints: &mut Checkpoints::none(),
        progress: &mut Silent,
    };
    let random = ChaCha12Rng::seed_from_u64(0);
    let record = fits.learn_residuals(&training, &validation, &config, random, watch);
    (fits, record.unwrap().unwrap())
}

/// Mean error at the ticks with a shift, of the distance.
pub(in super::super) fn error(fits: &InverseRange, samples: &Samples, side: Side) -> f64 {
    let answered = samples.of_side(side).into_iter().filter_map(|sample| {
        let measured = fits.measurement(0, sample)?;
        Some((measured.distance_m / sample.dtd_m - 1.0).abs())
    });
    let errors: Vec<f64> = answered.collect();
    assert!(errors.len() > 20);
    errors.iter().sum::<f64>() / errors.len() as f64
}

#[test]
fn an_error_that_contrast_tells_is_learned_and_flights_that_a_network_did_not_see_gain_by_it() {
    let samples = samples(None);
    let (fits, record) = learned(&samples);
    println!("{record:?}");
    assert!(record.is_kept());
    assert!(record.corrected_mape_pct < 0.5 * record.formula_mape_pct);
    let mut plain = fits.all.clone();
    plain.residual = None;
    let [with, without] = [&fits.all, &plain].map(|fits| error(fits, &samples, Side::Test));
    assert!(with < 0.5 * without, "{with} {without}");
    // Each network of a part is another one, of a formula that is another one.
    assert_eq!(fits.others.len(), 4);
    for others in fits.others.iter().flatten() {
        assert!(others.residual.is_some() && others.residual != fits.all.residual);
        let mut plain = others.clone();
        plain.residual = None;
        let [with, without] = [others, &plain].map(|fits| error(fits, &samples, Side::Test));
        assert!(with < 0.8 * without, "{with} {without}");
    }
}

#[test]
fn what_the_validation_side_contradicts_is_not_kept() {
    let samples = samples(Some(Side::Validation));
    let (fits, record) = learned(&samples);
    println!("{record:?}");
    assert!(!record.is_kept());
    assert!(
        fits.all.residual.is_none()
            && fits
                .others
                .iter()
                .flatten()
                .all(|fits| fits.residual.is_none())
    );
}

#[test]
fn a_registration_unlike_all_others_moves_the_distance_no_further_than_an_unusual_one() {
    let samples = samples(None);
    let (fits, _) = learned(&samples);
    let mut sample = samples.of_side(Side::Test)[5].clone();
    let formula_m = fits.all.formula(0, &sample).unwrap().distance_m;
    let residual = fits.all.residual.as_ref().unwrap();
    let mut corrected_m = |gain: f64| {
        for shift in sample.observed.shifts.iter_mut().flatten() {
            shift.gain = gain;
        }
        residual.corrected_m(&sample, formula_m)
    };
    let [usual, unusual, absurd] = [1.2, 30.0, 1e6].map(&mut corrected_m);
    assert_ne!(usual, unusual);
    assert_eq!(unusual, absurd);
    assert!(
        (absurd / formula_m - 1.0).abs() < 0.02,
        "{absurd} {formula_m}"
    );
    assert_eq!(corrected_m(-1.0), formula_m, "there is no such contrast");
}

#[test]
fn damaged_numbers_are_noticed() {
    let samples = samples(None);
    let (fits, _) = learned(&samples);
    assert!(fits.all.is_of(2));
    let damaged = |damage: &dyn Fn(&mut serde_json::Value)| {
        let mut numbers = serde_json::to_value(&fits.all).unwrap();
        damage(&mut numbers["residual"]);
        let read: InverseRange = serde_json::from_value(numbers).unwrap();
        read.is_of(2)
    };
    assert!(damaged(&|_| ()));
    assert!(!damaged(&|residual| residual["views"] = [2].into()));
    assert!(!damaged(
        &|residual| residual["usual"] = Vec::<f64>::new().into()
    ));
    assert!(!damaged(
        &|residual| residual["layers"] = Vec::<f64>::new().into()
    ));
    assert!(!damaged(
        &|residual| residual["layers"][0]["biases"] = Vec::<f64>::new().into()
    ));
    assert!(!damaged(
        &|residual| residual["layers"][1]["weights"] = [1.0].into()
    ));
}
