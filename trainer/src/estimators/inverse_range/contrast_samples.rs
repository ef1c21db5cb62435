//! Samples whose shifts follow another part of the aircraft where one view shows it with more contrast, as lamps do at night.

use dataset::corpus::splits::Side;
use dataset::work::watch::Silent;
use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;
use testkit::synthetic::SyntheticCorpus;

use super::{CrossFitted, InverseRange, ResidualRecord};
use crate::config::{Optimisation, ResidualConfig};
use crate::networks::checkpoint::Checkpoints;
use crate::networks::training_loop::Companions;
use crate::samples::{DistanceRange, Sample, Samples};

/// Four flights train, one validates, six test; on some sides the contrast may work the other way round.
pub(super) fn samples(reversed: &[Side]) -> Samples {
    let corpus = |by_contrast| SyntheticCorpus {
        test: 6,
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
        if reversed.contains(&sides[sample.scenario]) {
            *sample = other;
        }
    }
    samples
}

pub(super) fn settings() -> ResidualConfig {
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
pub(super) fn learned(samples: &Samples) -> (CrossFitted, ResidualRecord) {
    let training = samples.of_side(Side::Train);
    let validation = samples.of_side(Side::Validation);
    let validation: Vec<Sample> = validation.into_iter().cloned().collect();
    let mut fits = CrossFitted::fit(samples, &training);
    let companions = &mut Companions {
        checkpoints: &mut Checkpoints::none(),
        watch: &Silent,
    };
    let random = ChaCha12Rng::seed_from_u64(0);
    let record = fits.learn_residuals(&training, &validation, &settings(), random, companions);
    (fits, record.unwrap().unwrap())
}

pub(super) fn without_network(fits: &InverseRange) -> InverseRange {
    InverseRange {
        residual: None,
        ..fits.clone()
    }
}

/// Mean relative error of the distance, over the ticks that have a shift.
pub(super) fn error(fits: &InverseRange, ticks: &[&Sample]) -> f64 {
    let answered = ticks.iter().filter_map(|sample| {
        let measured = fits.measurement(0, sample)?;
        Some((measured.distance_m / sample.dtd_m - 1.0).abs())
    });
    let errors: Vec<f64> = answered.collect();
    assert!(errors.len() > 20);
    errors.iter().sum::<f64>() / errors.len() as f64
}
