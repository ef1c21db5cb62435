//! Training, from corpus to run folder.

pub(crate) mod choice;
mod flights;
mod network_training;
pub(crate) mod refit;
pub(crate) mod search;
pub(crate) mod start;
mod stream;

use std::path::Path;
use std::slice;
use std::time::Instant;

use dataset::corpus::Corpus;
use dataset::corpus::splits::Side;
use dataset::work::watch::Watch;

use crate::config::{FeatureScale, TrainConfig};
use crate::error::Result;
use crate::estimators::geometry::self_calibration::SelfCalibrated;
use crate::estimators::geometry::triangulation::CentreOffset;
use crate::estimators::inverse_range::CrossFitted;
use crate::estimators::inverse_range::flight_filter::FlightFilter;
use crate::estimators::mono_pinhole::Pinhole;
use crate::estimators::no_vision::MeanByTime;
use crate::networks::checkpoint::{Checkpoints, Origin};
use crate::networks::encoded::{Encoded, EncodedSides};
use crate::networks::normalisation::Normalisation;
use crate::networks::training_loop::Companions;
use crate::run::choice::Choice;
use crate::run::folder::RunFolder;
use crate::run::place::RunPlace;
use crate::run::sealed::SealedRun;
use crate::run::trained::{Baselines, RUN_FORMAT, RunSummary, TrainedRun};
use crate::training::flights::Flights;
use crate::training::network_training::train_networks;
use crate::training::start::Start;

/// Result of a training.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainOutcome {
    /// The run folder.
    pub run: RunFolder,
    /// Validation error of `paper_lstm`, percent.
    pub validation_mape_pct: f64,
    /// The recommended estimator.
    pub choice: Choice,
}

/// Trains all estimators on the training side of `corpus`, with decisions on the validation side, and writes the run to `out`, as a
/// whole and only on success. `out` is locked meanwhile. The same corpus, configuration and machine give the same weights, even if the
/// training was interrupted and resumed from the checkpoint.
pub fn train(
    corpus: &Corpus,
    out: &Path,
    config: &TrainConfig,
    watch: &dyn Watch,
) -> Result<TrainOutcome> {
    train_on_all(slice::from_ref(corpus), out, config, false, watch)
}

/// [`train`] on several corpora with the same rig. Flights on different sides in different corpora do not train. `reuses_finished`: a
/// finished run with the same settings, samples and version stays.
pub fn train_on_all(
    corpora: &[Corpus],
    out: &Path,
    config: &TrainConfig,
    reuses_finished: bool,
    watch: &dyn Watch,
) -> Result<TrainOutcome> {
    let started = Instant::now();
    config.check()?;
    let device = config.backend.open()?;
    let place = RunPlace::take(&RunFolder::at(out))?;
    let flights = Flights::read(corpora, config, watch)?;
    let samples = &flights.samples;
    // Errors about all corpora name the first.
    let corpus = &corpora[0];
    let training = flights.training(config);
    let start = Start::of(config, corpus, samples)?;
    let self_calibrated = SelfCalibrated::fit(
        &samples.rig.nominal,
        &samples.scenarios,
        &flights.with_true_boxes(),
        &config.self_calibration,
    );
    let normalisation = Normalisation::fit(&samples.views, &training, &flights.with_true_boxes());
    let normalisation = match config.feature_scale {
        FeatureScale::Deviation => normalisation,
        FeatureScale::Picture => {
            let cameras = samples.rig.cameras.values();
            let sizes_px = cameras.map(|camera| [camera.width_px, camera.height_px].map(f64::from));
            normalisation.in_parts_of_pictures(&sizes_px.collect::<Vec<_>>())
        }
    };
    let normalisation = match &start {
        None => normalisation,
        Some(start) => start.normalisation(normalisation, samples, self_calibrated.as_ref()),
    };
    let validation = flights.validation(corpus, &normalisation)?;

    let origin = Origin {
        dtd: env!("CARGO_PKG_VERSION").into(),
        config: config.clone(),
        start_blake3: start.as_ref().map(|start| start.weights_blake3.clone()),
        samples_blake3: samples.hash(&[Side::Train, Side::Validation]),
    };
    if reuses_finished && let Some(outcome) = outcome_of(&place.run(), &origin) {
        return Ok(outcome);
    }
    let samples_blake3 = origin.samples_blake3.clone();
    let encoded = EncodedSides {
        training: Encoded::new(training.iter().copied(), &normalisation),
        validation: Encoded::new(&validation, &normalisation),
    };
    let mut checkpoints = Checkpoints::open(&place.checkpoint(), origin, started, watch);
    let companions = &mut Companions {
        checkpoints: &mut checkpoints,
        watch,
    };
    let known = start.as_ref().map(|start| &start.run.networks);
    let learned = train_networks(known, &encoded, &samples.views, config, &device, companions)?;
    let baselines = fit_formulas(&flights, &normalisation, self_calibrated);
    let unwatched = (baselines.flight_filter.kept).unwatched(&baselines.inverse_range);
    unwatched.iter().for_each(|line| watch.say(line));

    let choice = Choice::of(&baselines, &flights.with_true_boxes());
    let run = TrainedRun {
        config: config.clone(),
        summary: RunSummary {
            format: RUN_FORMAT,
            dtd: env!("CARGO_PKG_VERSION").into(),
            model: samples.detections.model.clone(),
            model_hash: samples.detections.hash.clone(),
            rig: samples.rig.name.clone(),
            runway: samples.scenarios[0].runway.clone(),
            cameras: samples.rig.cameras.clone(),
            cameras_vary: samples.rig.cameras_vary,
            registered_with: samples.registered_with().cloned(),
            planned_cameras: samples.rig.planned().cloned(),
            training_trajectories: samples.trajectories(Side::Train),
            validation_trajectories: samples.trajectories(Side::Validation),
            training_flights: samples.flights(Side::Train),
            validation_flights: samples.flights(Side::Validation),
            training_scenarios: samples.scenario_count(Side::Train),
            validation_scenarios: samples.scenario_count(Side::Validation),
            samples_blake3,
            training_samples: training.len(),
            dropped_training_boxes: flights.dropped_boxes.clone(),
            validation_samples: validation.len(),
            validation_mape_pct: learned.validation_mape_pct,
            stages: learned.stages,
            training_s: checkpoints.spent_s(),
            choice: choice.clone(),
            scenario_split: flights.scenario_split.clone(),
            started_from_blake3: start.as_ref().map(|start| start.weights_blake3.clone()),
            refits: Vec::new(),
        }
        .with_flights_of(start.as_ref().map(|start| &start.run.summary)),
        baselines,
        backgrounds: flights.backgrounds,
        convergence: learned.convergence,
        normalisation,
        networks: learned.networks,
        is_elsewhere: false,
    };
    run.commit(&place, &place.begin()?)?;
    place.remove_checkpoint()?;
    Ok(TrainOutcome {
        run: place.run(),
        validation_mape_pct: learned.validation_mape_pct,
        choice,
    })
}

fn fit_formulas(
    flights: &Flights,
    normalisation: &Normalisation,
    self_calibrated: Option<SelfCalibrated>,
) -> Baselines {
    let samples = &flights.samples;
    let true_boxes = &flights.with_true_boxes();
    let cross_fitted = CrossFitted::fit(samples, true_boxes);
    let views = 0..samples.views.len();
    Baselines {
        views: samples.views.clone(),
        pinholes: (views.clone())
            .map(|view| Pinhole::fit(view, true_boxes))
            .collect(),
        centre_offsets: views
            .map(|view| CentreOffset::fit(view, &samples.scenarios, true_boxes))
            .collect(),
        flight_filter: FlightFilter::fit(&cross_fitted, samples, normalisation),
        inverse_range: cross_fitted.all,
        paired_views: flights.paired_views.clone(),
        mean_by_time: MeanByTime::fit(&samples.scenarios, samples.ticks_of_side(Side::Train)),
        self_calibrated,
        backgrounds: flights.backgrounds.stored(),
    }
}

/// Result of the existing run, if it has this origin.
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
