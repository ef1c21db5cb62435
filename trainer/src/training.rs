//! A training from corpus to run folder.

use std::collections::BTreeSet;
use std::path::Path;
use std::slice;
use std::time::Instant;

use burn::module::Module;
use burn::tensor::Device;
use dataset::corpus::Corpus;
use dataset::splits::Side;
use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;

use crate::background::Backgrounds;
use crate::calibration_training::train_calibration;
use crate::checkpoint::{Checkpoints, Origin};
use crate::choice::Choice;
use crate::config::TrainConfig;
use crate::encoded::Encoded;
use crate::error::{CorpusFault, Error, Result};
use crate::evaluation::split_again;
use crate::flight_filter::FlightFilter;
use crate::inverse_range::CrossFitted;
use crate::marked_scenarios;
use crate::memory::{self, SampleCounts};
use crate::mono_network::{MonoInputs, MonoNetworks};
use crate::normalisation::Normalisation;
use crate::paper_lstm::{EstimatorSamples, train_estimator};
use crate::pinhole::Pinhole;
use crate::run_folder::RunFolder;
use crate::run_place::RunPlace;
use crate::samples::{DistanceRange, Sample, Samples};
use crate::sealed_run::SealedRun;
use crate::self_calibration::SelfCalibrated;
use crate::start::Start;
use crate::trained_run::{Baselines, Convergence, Networks, RUN_FORMAT, RunSummary, TrainedRun};
use crate::training_loop::{Setup, Watch};
use crate::trajectory_mixing::{Corridor, mix};
use crate::triangulation::CentreOffset;
use dataset::progress::Progress;

/// The result of a training.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainOutcome {
    /// The run folder.
    pub run: RunFolder,
    /// Error of `paper_lstm` on the validation side, percent.
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
    Residual,
}

impl Stream {
    fn generator(self, seed: u64) -> ChaCha12Rng {
        let mut generator = ChaCha12Rng::seed_from_u64(seed);
        generator.set_stream(self as u64);
        generator
    }
}

/// Trains all estimators on the training side of `corpus`, with decisions on the validation side, and writes the run to `out`, as a
/// whole and only on success. `out` is locked meanwhile. The same corpus, configuration and machine give the same weights, also if the
/// training was killed and starts again from its checkpoint.
pub fn train(
    corpus: &Corpus,
    out: &Path,
    config: &TrainConfig,
    progress: &mut dyn Progress,
) -> Result<TrainOutcome> {
    train_on_all(slice::from_ref(corpus), out, config, progress)
}

/// The same on several corpora of one rig. A flight that their splits have on different sides does not train.
pub fn train_on_all(
    corpora: &[Corpus],
    out: &Path,
    config: &TrainConfig,
    progress: &mut dyn Progress,
) -> Result<TrainOutcome> {
    train_unless(Finished::IsReplaced, corpora, out, config, progress)
}

/// What becomes of a run in the place that this training would come to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Finished {
    /// It is made again.
    IsReplaced,
    /// It is the result.
    Stays,
}

/// The same, unless it is done already.
pub(crate) fn train_unless(
    finished: Finished,
    corpora: &[Corpus],
    out: &Path,
    config: &TrainConfig,
    progress: &mut dyn Progress,
) -> Result<TrainOutcome> {
    let started = Instant::now();
    config.check()?;
    let device = config.backend.open()?;
    let place = RunPlace::take(&RunFolder::at(out))?;
    let range = DistanceRange {
        min_nm: config.min_dtd_nm,
        max_nm: config.max_dtd_nm,
    };
    let mut samples = Samples::read_all(corpora, config.model_hash.as_deref(), range)?;
    // Errors about all of them name the first.
    let corpus = &corpora[0];
    if !config.accept_weather {
        let left_out = marked_scenarios::leave_out(&mut samples);
        if !left_out.is_empty() {
            progress.say(&marked_scenarios::left_out_line(&left_out));
        }
    }
    split_again(corpus, &mut samples, config.leave_out.as_deref())?;
    let backgrounds = match config.align_backgrounds {
        true => {
            let backgrounds = Backgrounds::learn(&samples, progress)?;
            let alignment =
                backgrounds.align(&mut samples, &[Side::Train, Side::Validation], progress)?;
            progress.say(&alignment.to_string());
            Some(backgrounds)
        }
        false => None,
    };
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
    let start = Start::of(config, corpus, &samples)?;
    let self_calibrated = SelfCalibrated::fit(
        &samples.rig.nominal,
        &samples.scenarios,
        // As recorded: which boxes hold the aircraft is what the calibration would say.
        &samples.of_side(Side::Train),
        &config.self_calibration,
    );
    let normalisation = Normalisation::fit(&samples.views, &training, &true_boxes);
    let normalisation = match &start {
        None => normalisation,
        Some(start) => start.normalisation(normalisation, &samples, self_calibrated.as_ref()),
    };
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

    let together = encoded_together.as_ref().unwrap_or(&encoded);
    let origin = Origin {
        dtd: env!("CARGO_PKG_VERSION").into(),
        config: config.clone(),
        start_blake3: start.as_ref().map(|start| start.weights_blake3.clone()),
        samples_blake3: samples.hash(&[Side::Train, Side::Validation]),
    };
    if finished == Finished::Stays
        && let Some(outcome) = outcome_of(&place.run(), &origin)
    {
        return Ok(outcome);
    }
    let samples_blake3 = origin.samples_blake3.clone();
    let mut checkpoints = Checkpoints::open(&place.checkpoint(), origin, started, progress);
    let watch = &mut Watch {
        checkpoints: &mut checkpoints,
        progress,
    };
    let setup = |stream: Stream| Setup {
        loss: config.loss,
        device: device.clone().autodiff(),
        random: stream.generator(config.seed),
    };
    let networks = start
        .as_ref()
        .map(|start| start.run.networks.clone().to_device(&device));
    let networks = networks.as_ref();
    let (calibration, calibration_log) = train_calibration(
        networks.map(|networks| &networks.calibration),
        &encoded,
        &encoded_validation,
        &config.calibration,
        setup(Stream::Calibration),
        watch,
    )?;
    let calibration_kept_step = calibration.step;
    let calibration = calibration.network.valid();
    let (estimator, estimator_log) = train_estimator(
        networks.map(|networks| &networks.estimator),
        &calibration,
        &EstimatorSamples {
            alone: &encoded,
            together,
            validation: &encoded_validation,
        },
        &config.estimator,
        config.calibration.features,
        setup(Stream::Estimator),
        watch,
    )?;
    let mut mono = |start, inputs, stream| {
        MonoNetworks::train_from(start, inputs, &encoded, &config.mono, setup(stream), watch)
    };
    let mono_size = mono(
        networks.map(|networks| &networks.mono_size),
        MonoInputs::Size,
        Stream::MonoSize,
    )?;
    let mono_box = mono(
        networks.map(|networks| &networks.mono_box),
        MonoInputs::Box,
        Stream::MonoBox,
    )?;

    let mut cross_fitted = CrossFitted::fit(&samples, &true_boxes);
    let residual = cross_fitted.learn_residuals(
        &true_boxes,
        &validation,
        &config.residual,
        Stream::Residual.generator(config.seed),
        watch,
    )?;
    let flight_filter = FlightFilter::fit(&cross_fitted, &samples, &normalisation);
    let baselines = Baselines {
        views: samples.views.clone(),
        pinholes: (0..samples.views.len())
            .map(|view| Pinhole::fit(view, &true_boxes))
            .collect(),
        centre_offsets: (0..samples.views.len())
            .map(|view| CentreOffset::fit(view, &samples.scenarios, &true_boxes))
            .collect(),
        inverse_range: cross_fitted.all,
        self_calibrated,
        flight_filter,
        backgrounds: backgrounds.as_ref().map(Backgrounds::stored),
    };
    let choice = Choice::of(&baselines, &true_boxes);
    // With those that the start knows.
    let known = |of: fn(&RunSummary) -> &BTreeSet<String>, mut seen: BTreeSet<String>| {
        let before = start.iter().flat_map(|start| of(&start.run.summary));
        seen.extend(before.cloned());
        seen
    };
    let run = TrainedRun {
        config: config.clone(),
        summary: RunSummary {
            format: RUN_FORMAT,
            dtd: env!("CARGO_PKG_VERSION").into(),
            model: samples.detections.model.clone(),
            model_hash: samples.detections.hash.clone(),
            rig: samples.rig.name.clone(),
            cameras: samples.rig.cameras.clone(),
            cameras_vary: samples.rig.cameras_vary,
            planned_cameras: samples.rig.planned().cloned(),
            training_trajectories: known(
                |s| &s.training_trajectories,
                samples.trajectories(Side::Train),
            ),
            validation_trajectories: known(
                |s| &s.validation_trajectories,
                samples.trajectories(Side::Validation),
            ),
            training_flights: known(|s| &s.training_flights, samples.flights(Side::Train)),
            validation_flights: known(|s| &s.validation_flights, samples.flights(Side::Validation)),
            training_scenarios: samples.scenario_count(Side::Train),
            validation_scenarios: samples.scenario_count(Side::Validation),
            samples_blake3,
            training_samples: training.len(),
            false_training_boxes,
            mixed_samples: mixed.len() + mixed_together.len(),
            validation_samples: validation.len(),
            validation_mape_pct: estimator.error_pct,
            residual,
            training_s: checkpoints.spent_s(),
            choice: choice.clone(),
            started_from_blake3: start.as_ref().map(|start| start.weights_blake3.clone()),
            refits: Vec::new(),
        },
        baselines,
        backgrounds,
        convergence: Convergence {
            views: samples.views.clone(),
            calibration: calibration_log,
            calibration_kept_step,
            estimator: estimator_log,
            estimator_kept_step: estimator.step,
        },
        normalisation,
        networks: Networks {
            calibration,
            estimator: estimator.network.valid(),
            mono_size: mono_size.valid(),
            mono_box: mono_box.valid(),
        }
        .to_device(&Device::flex()),
    };
    run.commit(&place)?;
    place.remove_checkpoint()?;
    Ok(TrainOutcome {
        run: place.run(),
        validation_mape_pct: estimator.error_pct,
        choice,
    })
}

/// The result of the run that is there, if a training of this origin made it.
fn outcome_of(run: &RunFolder, origin: &Origin) -> Option<TrainOutcome> {
    let sealed = SealedRun::read(run).ok()?;
    let summary = RunSummary::of(&sealed).ok()?;
    let its_origin = Origin {
        dtd: summary.dtd,
        config: sealed
            .json(RunFolder::CONFIG, "training configuration")
            .ok()?,
        start_blake3: summary.started_from_blake3,
        samples_blake3: summary.samples_blake3,
    };
    (its_origin == *origin).then(|| TrainOutcome {
        run: run.clone(),
        validation_mape_pct: summary.validation_mape_pct,
        choice: summary.choice,
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
