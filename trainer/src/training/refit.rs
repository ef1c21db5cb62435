//! Refit for a new, moved or turned camera: everything that depends on it is fitted again to a few labelled approaches, and the rest stays
//! untouched.
//!
//! Fitted again for the view: the camera (`self_calibrated`), the fits of all view sets that contain the view (`inverse_range`) with their
//! expected errors in the filter, the relations to the other views, pinhole and centre offset, the calibration network (as in the paper),
//! and offset and scale of the features. Offset and scale follow from the old and the new fitted camera: they map a box in the new image to
//! the features that the old camera would have given, so that the networks remain valid. The fingerprint of everything else ([`frozen`]) is
//! compared and recorded.
//!
//! Networks, formulas and features are stored by view, so that everything else can be fingerprinted.

mod frozen;
mod network_refit;

use std::path::Path;
use std::time::Instant;

use burn::tensor::Device;
use dataset::corpus::Corpus;
use dataset::corpus::splits::Side;
use dataset::work::watch::Watch;
use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;

use crate::background::Backgrounds;
use crate::error::{Error, Result};
use crate::estimators::geometry::self_calibration::{MIN_TICKS, SelfCalibrated};
use crate::estimators::geometry::triangulation::CentreOffset;
use crate::estimators::mono_pinhole::Pinhole;
use crate::evaluation::split_again;
use crate::networks::encoded::Encoded;
use crate::networks::normalisation::Normalisation;
use crate::networks::training_loop::Setup;
use crate::run::folder::RunFolder;
use crate::run::place::RunPlace;
use crate::run::refitted_view::Refit;
use crate::run::sealed::SealedRun;
use crate::run::trained::TrainedRun;
use crate::samples::rig::{Cameras, are_same, form};
use crate::samples::sides::flight_parts::FlightParts;
use crate::samples::training_cameras::TrainingCameras;
use crate::samples::{Sample, Samples};
use crate::training::flights::put_in_time_and_range;

use network_refit::{RefitSamples, refit_network};

/// Maximum number of approaches for a refit.
pub const MAX_APPROACHES: usize = 10;
/// Minimum number of different flights for reliable error estimates: with three, 90 % intervals contain less than two thirds of the true
/// values.
const FEW_FLIGHTS: usize = 5;
/// Divisor: a fifth of the approaches is for judging.
const JUDGED_ONE_OF: usize = 5;

/// Refit settings.
#[derive(Debug, Clone, PartialEq)]
pub struct RefitConfig {
    /// View to refit.
    pub view: String,
    /// Number of approaches, the first of the training side; at most [`MAX_APPROACHES`].
    pub approaches: usize,
}

/// Fits a view of `run` again to approaches in `corpus`, and writes the result to `out`, as a whole and only on success.
pub fn refit(
    run: &RunFolder,
    corpus: &Corpus,
    out: &Path,
    config: &RefitConfig,
    watch: &dyn Watch,
) -> Result<Refit> {
    let started = Instant::now();
    if !(1..=MAX_APPROACHES).contains(&config.approaches) {
        let expected = format!("a number from 1 to {MAX_APPROACHES}");
        return Err(Error::setting("scenarios", config.approaches, expected));
    }
    let same = |a: &Path, b: &Path| {
        a.canonicalize()
            .is_ok_and(|a| b.canonicalize().is_ok_and(|b| a == b))
    };
    if same(out, run.root()) {
        let fault = "is the run to fit again, which stays as it is; name another folder with --out";
        return Err(Error::run(out, fault));
    }
    let place = RunPlace::take(&RunFolder::at(out))?;
    let before = TrainedRun::of(&SealedRun::read(run)?)?;
    let views = &before.normalisation.views;
    let view = views.iter().position(|view| *view == config.view);
    let view = view.ok_or_else(|| {
        let (view, views) = (&config.view, views.join(", "));
        Error::run(
            run.root(),
            format!("has no view {view:?}; its views are {views}"),
        )
    })?;
    let mut samples = Samples::read(corpus, Some(&before.summary.model_hash))?;
    split_again(corpus, &mut samples, before.config.leave_out.as_deref())?;
    check_others(run, corpus, &before, &samples, &config.view)?;
    put_in_time_and_range(&mut samples, &[Side::Train], &before.config);
    let mut after = before.clone();
    let stability_arcsec = before.config.camera_stability_arcsec;
    let seen = Backgrounds::learn(&samples, view..view + 1, stability_arcsec, watch)?;
    after.backgrounds = before.backgrounds.with_view_of(view, seen);
    after.baselines.backgrounds = after.backgrounds.stored();
    let alignment = (after.backgrounds).align(&mut samples, (&[Side::Train], false), watch)?;
    alignment.report(watch);
    samples.move_common_to_shifts();
    let approaches = approaches(corpus, &samples, view, config)?;
    fit_formulas(corpus, &mut after, view, &samples, &approaches, watch)?;
    fit_network(&mut after, view, &samples, &approaches, watch)?;
    adopt(&mut after, &samples, &approaches, &config.view);

    let new = place.begin()?;
    let record = Refit {
        view: config.view.clone(),
        scenarios: ids(&samples, &approaches),
        frozen_before_blake3: frozen::fingerprint(&before, view),
        frozen_after_blake3: frozen::fingerprint(&after, view),
        refit_s: started.elapsed().as_secs_f64(),
    };
    if record.frozen_before_blake3 != record.frozen_after_blake3 {
        let fault = format!(
            "fitting view {} again would change numbers that do not belong to it; nothing was written. Please report this",
            record.view
        );
        return Err(Error::run(out, fault));
    }
    after.summary.refits.push(record.clone());
    after.commit(&place, &new)?;
    Ok(record)
}

/// Rejects a corpus whose other cameras differ from the run's: they stay as they are.
fn check_others(
    run: &RunFolder,
    corpus: &Corpus,
    trained: &TrainedRun,
    samples: &Samples,
    view: &str,
) -> Result<()> {
    let others = |cameras: &Cameras| -> Cameras {
        let others = cameras.iter().filter(|(other, _)| *other != view);
        others
            .map(|(other, entry)| (other.clone(), entry.clone()))
            .collect()
    };
    let (known, found) = (&trained.summary.cameras, &samples.rig.cameras);
    let same = trained
        .summary
        .comparable(&samples.rig)
        .is_none_or(|[here, there]| are_same(&others(here), &others(there)));
    if same && form(known) == form(found) {
        return Ok(());
    }
    let fault = format!(
        "its cameras beside {view} are not those that run {} was trained with: identifiers, image sizes, places and optics must be the \
         same; fit one view at a time again",
        run.root().display()
    );
    Err(Error::corpus(corpus.root(), fault))
}

/// Indices of the chosen scenarios: the first on the training side.
fn approaches(
    corpus: &Corpus,
    samples: &Samples,
    view: usize,
    config: &RefitConfig,
) -> Result<Vec<usize>> {
    let scenarios = samples.scenarios.iter().enumerate();
    let training = scenarios.filter(|(_, scenario)| scenario.side == Side::Train);
    let chosen: Vec<usize> = training
        .map(|(index, _)| index)
        .take(config.approaches)
        .collect();
    let ticks = of_scenarios(samples, &chosen)
        .filter(|sample| sample.best(view).is_some())
        .count();
    if ticks >= MIN_TICKS {
        return Ok(chosen);
    }
    let fault = format!(
        "view {} saw the aircraft at {ticks} ticks of {} approaches on the training side, expected at least {MIN_TICKS}; record, label \
         and detect more, or use more of them (--scenarios)",
        config.view,
        chosen.len()
    );
    Err(Error::corpus(corpus.root(), fault))
}

fn of_scenarios<'a>(
    samples: &'a Samples,
    scenarios: &'a [usize],
) -> impl Iterator<Item = &'a Sample> {
    let is_chosen = |sample: &&Sample| scenarios.contains(&sample.scenario);
    let seen = samples
        .samples
        .iter()
        .filter(|sample| sample.detections() > 0);
    seen.filter(is_chosen)
}

fn ids(samples: &Samples, scenarios: &[usize]) -> Vec<String> {
    let id = |&index: &usize| samples.scenarios[index].id.clone();
    scenarios.iter().map(id).collect()
}

fn fit_formulas(
    corpus: &Corpus,
    run: &mut TrainedRun,
    view: usize,
    samples: &Samples,
    approaches: &[usize],
    watch: &dyn Watch,
) -> Result<()> {
    let refused = |fault: String| Error::corpus(corpus.root(), fault);
    let recorded: Vec<&Sample> = of_scenarios(samples, approaches).collect();
    let cameras = TrainingCameras::of(samples, &recorded);
    cameras.report(samples, &recorded, watch);
    let trusted = cameras.true_boxes(&recorded);
    let trusted: Vec<&Sample> = trusted.iter().collect();
    let baselines = &mut run.baselines;
    let settings = &run.config.self_calibration;
    let name = &run.normalisation.views[view];
    let planned = samples.rig.is_planned.then(|| &samples.rig.nominal[name]);
    let old = baselines.self_calibrated.take();
    let new = old
        .as_ref()
        .and_then(|old| old.refitted(view, planned, &samples.scenarios, &trusted, settings));
    if old.is_some() && new.is_none() {
        return Err(refused(format!(
            "the camera of view {name} cannot be fitted to these approaches; use more of them (--scenarios), of a corpus with plan.json"
        )));
    }
    let camera = |fitted: &SelfCalibrated| fitted.cameras()[view];
    let camera_pair = (old.as_ref().and_then(camera)).zip(new.as_ref().and_then(camera));
    baselines.self_calibrated = new;
    baselines.pinholes[view] = Pinhole::fit(view, &trusted);
    baselines.centre_offsets[view] = CentreOffset::fit(view, &samples.scenarios, &trusted);
    let views = samples.views.len();
    baselines.paired_views = (baselines.paired_views).with_view_refitted(view, views, &trusted);
    let ticks: Vec<&Sample> = samples
        .ticks_of_side(Side::Train)
        .filter(|tick| approaches.contains(&tick.scenario))
        .collect();
    let parts = FlightParts::of(samples, ticks.iter().copied());
    let flights = parts.flights();
    if flights < FEW_FLIGHTS {
        watch.say(&format!(
            "fewer than {FEW_FLIGHTS} different flights ({flights} here) tell little about errors: stated intervals will be too narrow; \
             use up to ten"
        ));
    }
    let refitted = baselines
        .inverse_range
        .for_new_camera(view, parts, &trusted);
    let Some(refitted) = refitted else {
        return Err(refused(format!(
            "view {name} and others together saw the aircraft too rarely in {} approaches to fit inverse_range to; record, label and \
             detect more, or use more of them (--scenarios)",
            approaches.len()
        )));
    };
    let moved = camera_pair.and_then(|(old, new)| run.normalisation.moved(view, &old, &new));
    run.normalisation = moved.unwrap_or_else(|| {
        let views = &run.normalisation.views;
        run.normalisation
            .with_view_of(view, &Normalisation::fit(views, &trusted, &trusted))
    });
    baselines.flight_filter =
        baselines
            .flight_filter
            .with_camera_refitted(view, &refitted, &ticks, &run.normalisation);
    baselines.inverse_range = refitted.all;
    Ok(())
}

fn fit_network(
    run: &mut TrainedRun,
    view: usize,
    samples: &Samples,
    approaches: &[usize],
    watch: &dyn Watch,
) -> Result<()> {
    let judged = approaches.len() / JUDGED_ONE_OF;
    let (training, judged) = match judged {
        0 => (approaches, approaches),
        judged => approaches.split_at(approaches.len() - judged),
    };
    let encoded = |scenarios: &[usize]| {
        let usual: Vec<Sample> = of_scenarios(samples, scenarios)
            .map(|sample| sample.with(run.normalisation.without_outliers(sample, false)))
            .filter(|sample| sample.detections() > 0)
            .collect();
        Encoded::new(&usual, &run.normalisation)
    };
    let (training, judged) = (encoded(training), encoded(judged));
    let setup = Setup {
        loss: run.config.target(),
        device: Device::flex().autodiff(),
        random: ChaCha12Rng::seed_from_u64(run.config.seed),
        plateau: None,
    };
    run.networks.calibration = refit_network(
        view,
        &run.networks.calibration,
        &run.networks.estimator,
        &RefitSamples {
            training: &training,
            judged: &judged,
        },
        &run.config,
        setup,
        watch,
    )?;
    Ok(())
}

/// Updates the summary: the new camera, and the approaches as training flights.
fn adopt(run: &mut TrainedRun, samples: &Samples, approaches: &[usize], view: &str) {
    let summary = &mut run.summary;
    summary.rig.clone_from(&samples.rig.name);
    if let Some(entry) = samples.rig.cameras.get(view) {
        summary.cameras.insert(view.to_owned(), entry.clone());
    }
    let planned = samples.rig.planned().and_then(|planned| planned.get(view));
    match (&mut summary.planned_cameras, planned) {
        (Some(all), Some(entry)) => {
            all.insert(view.to_owned(), entry.clone());
        }
        (all, _) => *all = None,
    }
    let scenarios = || approaches.iter().map(|&index| &samples.scenarios[index]);
    let trajectories = scenarios().map(|scenario| scenario.trajectory.clone());
    summary.training_trajectories.extend(trajectories);
    let flights = scenarios().map(|scenario| scenario.flight.clone());
    summary.training_flights.extend(flights);
}
