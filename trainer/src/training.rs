//! A training from corpus to run folder.

use std::path::Path;
use std::time::Instant;

use burn::module::Module;
use burn::tensor::Device;
use dataset::corpus::Corpus;
use dataset::splits::Side;
use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;

use crate::calibration_training::train_calibration;
use crate::choice::Choice;
use crate::config::TrainConfig;
use crate::encoded::Encoded;
use crate::error::{CorpusFault, Error, Result};
use crate::evaluation::split_again;
use crate::flight_filter::FlightFilter;
use crate::inverse_range::InverseRange;
use crate::memory::{self, SampleCounts};
use crate::mono_network::{MonoInputs, MonoNetworks};
use crate::normalisation::Normalisation;
use crate::paper_lstm::{EstimatorSamples, train_estimator};
use crate::pinhole::Pinhole;
use crate::run_folder::RunFolder;
use crate::run_place::RunPlace;
use crate::samples::{DistanceRange, Sample, Samples};
use crate::self_calibration::SelfCalibrated;
use crate::trained_run::{Baselines, Convergence, Networks, RunSummary, TrainedRun};
use crate::training_loop::Setup;
use crate::trajectory_mixing::{Corridor, mix};
use crate::triangulation::CentreOffset;
use dataset::progress::Progress;

/// The result of a training.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainOutcome {
    /// The run folder.
    pub run: RunFolder,
    /// Error of `paper_lstm` on the validation side at the end, percent.
    pub validation_mape_pct: f64,
    /// The recommended estimator.
    pub choice: Choice,
}

/// Independent random streams, so that changing one part of a training leaves the others' draws alone.
#[derive(Clone, Copy)]
enum Stream {
    Mixing,
    Calibration,
    Estimator,
    MonoSize,
    MonoBox,
}

impl Stream {
    fn generator(self, seed: u64) -> ChaCha12Rng {
        let mut generator = ChaCha12Rng::seed_from_u64(seed);
        generator.set_stream(self as u64);
        generator
    }
}

/// Trains all estimators on the training side of `corpus`, with decisions on the validation side, and writes the run to `out`, as a
/// whole and only on success. `out` is locked meanwhile. The same corpus, configuration and machine give the same weights.
pub fn train(
    corpus: &Corpus,
    out: &Path,
    config: &TrainConfig,
    progress: &mut dyn Progress,
) -> Result<TrainOutcome> {
    let started = Instant::now();
    config.check()?;
    let place = RunPlace::take(&RunFolder::at(out))?;
    let range = DistanceRange {
        min_nm: config.min_dtd_nm,
        max_nm: config.max_dtd_nm,
    };
    let mut samples = Samples::read(corpus, config.model_hash.as_deref(), range)?;
    split_again(corpus, &mut samples, config.leave_out.as_deref())?;
    let recorded = side_with_samples(corpus, &samples, Side::Train)?;
    let true_boxes = samples.with_true_boxes(Side::Train);
    let true_boxes: Vec<&Sample> = true_boxes.iter().collect();
    if true_boxes.is_empty() {
        let samples = recorded.len();
        let fault = CorpusFault::NoTrueBoxes { samples };
        return Err(Error::corpus(corpus.root(), fault));
    }
    let boxes = |samples: &[&Sample]| samples.iter().map(|s| s.detections()).sum::<usize>();
    let false_training_boxes = boxes(&recorded) - boxes(&true_boxes);
    // What the networks learn from; formulas are fitted to true boxes, because one of another object outweighs thousands there.
    let training = match config.only_true_boxes {
        true => true_boxes.clone(),
        false => recorded,
    };
    let normalisation = Normalisation::fit(&samples.views, &training, &true_boxes);
    let recorded = side_with_samples(corpus, &samples, Side::Validation)?;
    let validation = usual_samples(&normalisation, &recorded);
    if validation.is_empty() {
        let samples = recorded.len();
        let fault = CorpusFault::NoUsualBoxes { samples };
        return Err(Error::corpus(corpus.root(), fault));
    }
    let counts = SampleCounts {
        training: training.len(),
        judged: validation.len(),
    };
    memory::check(config, samples.views.len(), counts)?;
    let [mixed, mixed_together] = mixed_samples(&samples, &training, config);
    let encoded = Encoded::new(training.iter().copied().chain(&mixed), &normalisation);
    let encoded_together = (!mixed_together.is_empty()).then(|| {
        let together = training.iter().copied().chain(&mixed_together);
        Encoded::new(together, &normalisation)
    });
    let encoded_validation = Encoded::new(&validation, &normalisation);

    let setup = |stream: Stream| Setup {
        loss: config.loss,
        device: Device::flex().autodiff(),
        random: stream.generator(config.seed),
    };
    let (calibration, calibration_log) = train_calibration(
        &encoded,
        &encoded_validation,
        &config.calibration,
        setup(Stream::Calibration),
        progress,
    )?;
    let calibration = calibration.valid();
    let (estimator, estimator_log) = train_estimator(
        &calibration,
        &EstimatorSamples {
            alone: &encoded,
            together: encoded_together.as_ref().unwrap_or(&encoded),
            validation: &encoded_validation,
        },
        &config.estimator,
        config.calibration.features,
        setup(Stream::Estimator),
        progress,
    )?;
    let mut mono = |inputs, stream| {
        MonoNetworks::train(inputs, &encoded, &config.mono, setup(stream), progress)
    };
    let mono_size = mono(MonoInputs::Size, Stream::MonoSize)?;
    let mono_box = mono(MonoInputs::Box, Stream::MonoBox)?;

    let validation_mape_pct = estimator_log
        .last()
        .map_or(f64::NAN, |entry| entry.validation_mape_pct);
    let baselines = baselines(&samples, &true_boxes, &normalisation, config);
    let choice = Choice::of(&baselines, &true_boxes);
    let run = TrainedRun {
        config: config.clone(),
        summary: RunSummary {
            dtd: env!("CARGO_PKG_VERSION").into(),
            model: samples.detections.model.clone(),
            model_hash: samples.detections.hash.clone(),
            rig: Some(samples.rig.name.clone()),
            cameras: samples.rig.cameras.clone(),
            cameras_vary: samples.rig.cameras_vary,
            training_trajectories: samples.trajectories(Side::Train),
            validation_trajectories: samples.trajectories(Side::Validation),
            training_flights: samples.flights(Side::Train),
            validation_flights: samples.flights(Side::Validation),
            training_scenarios: samples.scenario_count(Side::Train),
            validation_scenarios: samples.scenario_count(Side::Validation),
            training_samples: training.len(),
            false_training_boxes,
            mixed_samples: mixed.len() + mixed_together.len(),
            validation_samples: validation.len(),
            training_s: started.elapsed().as_secs_f64(),
            choice: Some(choice.clone()),
            refits: Vec::new(),
        },
        baselines,
        convergence: Convergence {
            views: samples.views.clone(),
            calibration: calibration_log,
            estimator: estimator_log,
        },
        normalisation,
        networks: Networks {
            calibration,
            estimator: estimator.valid(),
            mono_size: mono_size.valid(),
            mono_box: mono_box.valid(),
        },
    };
    let folder = place.run();
    run.commit(place)?;
    Ok(TrainOutcome {
        run: folder,
        validation_mape_pct,
        choice,
    })
}

fn side_with_samples<'a>(
    corpus: &Corpus,
    samples: &'a Samples,
    side: Side,
) -> Result<Vec<&'a Sample>> {
    let found = samples.of_side(side);
    if found.is_empty() {
        let scenarios = samples.scenario_count(side);
        let fault = CorpusFault::NoSamples { side, scenarios };
        return Err(Error::corpus(corpus.root(), fault));
    }
    Ok(found)
}

/// Samples as an estimator sees them; those without a trusted box are left out.
fn usual_samples(normalisation: &Normalisation, samples: &[&Sample]) -> Vec<Sample> {
    samples
        .iter()
        .map(|sample| sample.with(normalisation.without_outliers(sample, false)))
        .filter(|sample| sample.detections() > 0)
        .collect()
}

/// Mixtures for single views, and for all views together.
fn mixed_samples(
    samples: &Samples,
    training: &[&Sample],
    config: &TrainConfig,
) -> [Vec<Sample>; 2] {
    let augmentation = &config.augmentation;
    let count = augmentation
        .fill_up_to_samples
        .saturating_sub(training.len());
    let random = &mut Stream::Mixing.generator(config.seed);
    [
        Corridor {
            extrapolation: augmentation.extrapolation,
            deviation_m: 0.0,
        },
        Corridor {
            extrapolation: augmentation.extrapolation_together,
            deviation_m: augmentation.deviation_together_m,
        },
    ]
    .map(|corridor| mix(training, &samples.scenarios, corridor, count, random))
}

fn baselines(
    samples: &Samples,
    training: &[&Sample],
    normalisation: &Normalisation,
    config: &TrainConfig,
) -> Baselines {
    let inverse_range = InverseRange::fit(samples.views.len(), training);
    let scenarios = &samples.scenarios;
    Baselines {
        views: samples.views.clone(),
        pinholes: (0..samples.views.len())
            .map(|view| Pinhole::fit(view, training))
            .collect(),
        centre_offsets: (0..samples.views.len())
            .map(|view| CentreOffset::fit(view, scenarios, training))
            .collect(),
        self_calibrated: SelfCalibrated::fit(
            &samples.rig.nominal,
            &samples.scenarios,
            // As recorded: which boxes hold the aircraft is what the calibration would say.
            &samples.of_side(Side::Train),
            &config.self_calibration,
        ),
        flight_filter: Some(FlightFilter::fit(
            &inverse_range,
            samples,
            training,
            normalisation,
        )),
        inverse_range,
    }
}
