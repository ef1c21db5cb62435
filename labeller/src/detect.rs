//! Runs a detector over the videos of a corpus.
//!
//! Input: the videos and timestamps of committed scenarios, and a model. Output: `detections/<model>.parquet` and next to it `<model>.json`
//! ([`DetectionRecord`]), where `<model>` is the start of the hash of model and settings; with several views also
//! `registrations/<model>.parquet`, and always `health/<model>.parquet` and `backgrounds/<model>.parquet`, measured from the same decoded
//! images. Several views are decoded and searched in parallel, and a scenario is written as soon as its last view is done. Scenarios that
//! are searched by a different process are left to it. Each worker holds one image and one session, and each scenario in work the
//! surroundings of boxes whose other view is not decoded yet, so memory does not grow with the corpus.

mod job;
mod live_view;
mod mode;
mod pairs;
mod pictures;
mod scenario_search;
mod sequence;
mod view_search;

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::mem;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use dataset::conditions::sight::CloudBase;
use dataset::corpus::claim::Claimed;
use dataset::corpus::model_identity::ModelIdentity;
use dataset::corpus::open_scenario::OpenScenario;
use dataset::corpus::{Corpus, ScenarioFolder};
use dataset::tables::health::{HealthState, ViewHealth};
use dataset::tables::pixel_box::TruthBox;
use dataset::tables::registrations::Registration;
use dataset::work::watch::Watch;
use dataset::work::workers;
use serde::Serialize;

use crate::detector::{Detector, Device, ModelFile, ModelProfile, OrtDetector, OrtOptions};
use crate::error::{Error, Failure, Result};
use crate::matching::false_boxes::FalseBoxes;
use crate::matching::statistics::{DetectionCounts, TruthInSight};
use crate::tiling::TilingSettings;
use job::{End, ScenarioJob, ViewJob};
pub use live_view::{ImageFindings, SeenBox, ViewSearch};
pub use mode::Mode;
pub use pairs::fitted_cameras::FittedCameras;
pub use pairs::register_views;
pub use pictures::VideoImages;
pub use pictures::image::Image;
pub use scenario_search::{Findings, Searcher};
pub use view_search::cpu_time::CpuTime;

/// Polling interval for scenarios that a different process searches.
const POLL_INTERVAL: Duration = Duration::from_millis(200);

/// Options for detection in a corpus.
#[derive(Debug, Clone, PartialEq)]
pub struct DetectOptions {
    /// ONNX Runtime's library; `None` means `ORT_DYLIB_PATH`, else the installation's own.
    pub onnx_runtime: Option<PathBuf>,
    /// Device that runs the model. Detections made on a different device count as the same.
    pub device: Device,
    /// Thresholds and windows of the search. Detections made with other settings are repeated.
    pub settings: TilingSettings,
    /// Parts of the images that are searched; detections made with other settings are also repeated.
    pub mode: Mode,
    /// Number of views processed in parallel.
    pub workers: usize,
    /// Threads that a worker's model uses.
    pub threads_per_worker: usize,
    /// Search only these scenarios; `None`: all.
    pub only: Option<BTreeSet<String>>,
    /// Detect again even if this model's detections with these settings exist.
    pub force: bool,
    /// Register the views of existing detections again with these cameras, and search nothing.
    pub registration_of: Option<FittedCameras>,
}

impl Default for DetectOptions {
    /// One single-threaded worker per core: decoding and preprocessing then overlap with the model.
    fn default() -> Self {
        let cores = thread::available_parallelism().map_or(1, usize::from);
        Self {
            onnx_runtime: None,
            device: Device::CPU,
            settings: TilingSettings::default(),
            mode: Mode::default(),
            workers: cores,
            threads_per_worker: 1,
            only: None,
            force: false,
            registration_of: None,
        }
    }
}

impl DetectOptions {
    fn check(&self) -> Result<()> {
        self.settings.check()?;
        if self.workers == 0 {
            return Err(Error::Option {
                name: "workers",
                found: "0".into(),
                expected: "at least 1".into(),
            });
        }
        Ok(())
    }

    fn ort(&self) -> OrtOptions {
        OrtOptions {
            library: self.onnx_runtime.clone(),
            device: self.device,
            threads: self.threads_per_worker,
        }
    }
}

/// Results for a corpus.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct DetectOutcome {
    /// File name of the model.
    pub model: String,
    /// Name of the detections: the first 16 digits of the BLAKE3 hash of the model and the settings next to it.
    pub model_hash: String,
    /// Device that the model ran on.
    pub device: Device,
    /// Scenarios that were searched.
    pub detected: Vec<String>,
    /// Scenarios that had detections of this model with these settings; their views were registered now, and their cameras judged.
    pub registered: Vec<String>,
    /// Scenarios that already had everything.
    pub unchanged: Vec<String>,
    /// Scenarios that could not be searched.
    pub failed: Vec<Failure>,
    /// Scenarios that were left to the next run, because the caller stopped this one.
    pub left: Vec<String>,
    /// True if the caller stopped it, even if no work was left.
    pub stopped: bool,
    /// Counts over all scenarios that have detections now.
    pub counts: DetectionCounts,
    /// Confirmed boxes of all these scenarios that are not the aircraft, where there are labels: the views with the most boxes first.
    pub false_boxes: Vec<FalseBoxes>,
    /// Registrations of all scenarios that have detections now.
    pub registrations: RegistrationCounts,
    /// Views with unhealthy cameras.
    pub unhealthy: Vec<Unhealthy>,
    /// Views, as `scenario view`, in which most images show too little background to notice a turned camera.
    pub without_background: Vec<String>,
    /// Total time of the workers, seconds.
    pub worker_seconds: f64,
}

impl DetectOutcome {
    /// Compares a scenario's detections with its labels, if it has any.
    fn add_counts(&mut self, scenario: &OpenScenario) -> Result<()> {
        let record = scenario.record()?;
        let found = scenario.detections(&self.model_hash)?.boxes;
        let truth = truth_in_sight(scenario)?;
        let counts = DetectionCounts::of(record.pictures(), &found, truth.as_deref());
        self.counts.add(&counts);
        if let Some(truth) = &truth {
            let of_scenario = FalseBoxes::of(&record.id, &found, truth);
            self.false_boxes.extend(of_scenario);
        }
        Ok(())
    }
}

/// Counts of registered pairs of views.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct RegistrationCounts {
    /// Pairs of views at a tick; the reference view is in each.
    pub pairs: u64,
    /// Pairs with a shift.
    pub answered: u64,
    /// The others, by reason.
    pub unanswered: BTreeMap<&'static str, u64>,
}

impl RegistrationCounts {
    fn add(&mut self, registrations: &[Registration]) {
        self.pairs += registrations.len() as u64;
        for registration in registrations {
            match registration.result {
                Ok(_) => self.answered += 1,
                Err(reason) => *self.unanswered.entry(reason.word()).or_default() += 1,
            }
        }
    }
}

/// A view that has frozen, moved or shaking ticks.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Unhealthy {
    /// The scenario.
    pub scenario: String,
    /// The view.
    pub view: String,
    /// Ticks with an image that repeats an earlier one.
    pub frozen: u64,
    /// Ticks with an unusual camera direction.
    pub moved: u64,
    /// Ticks with a shaking camera.
    pub shaking: u64,
}

impl Unhealthy {
    /// Ticks with any fault.
    pub fn ill_ticks(&self) -> u64 {
        self.frozen + self.moved + self.shaking
    }

    /// Unhealthy views.
    fn of(scenario: &str, rows: &[ViewHealth]) -> Vec<Self> {
        let mut views: BTreeMap<&str, Self> = BTreeMap::new();
        for row in rows {
            let here = views.entry(&row.view).or_insert_with(|| Self {
                scenario: scenario.to_owned(),
                view: row.view.clone(),
                ..Self::default()
            });
            match row.state {
                HealthState::Frozen => here.frozen += 1,
                HealthState::Moved => here.moved += 1,
                HealthState::Shaking => here.shaking += 1,
                HealthState::Steady | HealthState::Unknown => {}
            }
        }
        let all = views.into_values();
        all.filter(|view| view.ill_ticks() > 0).collect()
    }
}

/// Views whose direction was not measured in most images.
fn without_background(rows: &[ViewHealth]) -> Vec<&str> {
    let mut views: BTreeMap<&str, [usize; 2]> = BTreeMap::new();
    for row in rows {
        let of_view = views.entry(&row.view).or_default();
        of_view[usize::from(row.hides_direction())] += 1;
    }
    let hidden = views
        .into_iter()
        .filter(|(_, [known, unknown])| unknown > known);
    hidden.map(|(view, _)| view).collect()
}

/// The model used for detection.
#[derive(Debug, Clone, PartialEq)]
struct Model {
    identity: ModelIdentity,
    /// The settings next to it, if there are any.
    profile: Option<ModelProfile>,
}

impl Model {
    fn of(file: &ModelFile) -> Self {
        Self {
            identity: file.identity(),
            profile: (file.profile.clone()).filter(|profile| profile.blake3().is_some()),
        }
    }

    fn name(&self) -> String {
        self.identity.name()
    }
}

/// Creates a detector; every worker has its own.
type MakeDetector<'a> = &'a (dyn Fn() -> Result<Box<dyn Detector>> + Sync);

/// Detects in all committed scenarios with an ONNX model. A scenario that fails is reported and does not stop the others. Scenarios that
/// are done when `watch` stops the run stay.
///
/// # Errors
/// The model, the options or the corpus cannot be used at all, or disk, permissions or another process kept scenarios from being searched,
/// as many as were tried.
pub fn detect_corpus(
    corpus: &Corpus,
    model_path: &Path,
    options: &DetectOptions,
    watch: &dyn Watch,
) -> Result<DetectOutcome> {
    let ort = options.ort();
    // Done first: a model that does not load is an error even if there are no scenarios to search.
    let file = ModelFile::read(model_path)?;
    drop(OrtDetector::of(&file, &ort)?);
    let make =
        || OrtDetector::of(&file, &ort).map(|detector| Box::new(detector) as Box<dyn Detector>);
    detect_with(corpus, &Model::of(&file), &make, options, watch)
}

fn detect_with(
    corpus: &Corpus,
    model: &Model,
    make: MakeDetector<'_>,
    options: &DetectOptions,
    watch: &dyn Watch,
) -> Result<DetectOutcome> {
    options.check()?;
    let mut outcome = DetectOutcome {
        model: model.identity.model.clone().unwrap_or_default(),
        model_hash: model.name(),
        device: options.device,
        ..Default::default()
    };
    let mut pending = corpus.scenarios()?;
    if let Some(only) = &options.only {
        pending.retain(|folder| only.contains(&folder.id()));
    }
    let mut hindrance = None;
    while !pending.is_empty() {
        let mut jobs = Vec::new();
        for folder in mem::take(&mut pending) {
            let id = folder.id();
            if watch.is_stopped() {
                outcome.left.push(id);
                continue;
            }
            match ScenarioJob::plan(folder, model, options) {
                Ok(Some(job)) => jobs.push(job),
                Ok(None) => outcome.unchanged.push(id),
                Err(error) if error.is_of_environment() => hindrance = hindrance.or(Some(error)),
                Err(error) => outcome.failed.push(Failure {
                    id,
                    reason: error.to_string(),
                }),
            }
        }
        work_through(&jobs, make, options, watch)?;
        for job in jobs {
            let id = job.id();
            let done = if job.only_registers() {
                &mut outcome.registered
            } else {
                &mut outcome.detected
            };
            match job.end() {
                End::Done { seconds } => {
                    outcome.worker_seconds += seconds;
                    done.push(id);
                }
                End::Elsewhere => pending.push(corpus.scenario(&id)),
                End::Failed(Error::Stopped(_)) | End::NotBegun => outcome.left.push(id),
                // For the caller to change, not a fault of the scenario.
                End::Failed(error @ Error::Option { .. }) => return Err(error),
                End::Failed(error) if error.is_of_environment() => {
                    hindrance = hindrance.or(Some(error));
                }
                End::Failed(error) => outcome.failed.push(Failure {
                    id,
                    reason: error.to_string(),
                }),
            }
        }
        if let Some(first) = pending.first() {
            wait_for_other(first, watch)?;
        }
        if watch.is_stopped() {
            outcome
                .left
                .extend(pending.drain(..).map(|folder| folder.id()));
        }
    }
    if let Some(error) = hindrance {
        return Err(error);
    }
    outcome.stopped = watch.is_stopped();
    let done = [&outcome.detected, &outcome.registered, &outcome.unchanged];
    let done: Vec<_> = done.into_iter().flatten().cloned().collect();
    for id in &done {
        let scenario = corpus.scenario(id).open()?;
        outcome.add_counts(&scenario)?;
        let registrations = scenario.registrations(&outcome.model_hash)?;
        outcome
            .registrations
            .add(registrations.as_deref().unwrap_or_default());
        let health = scenario.health(&outcome.model_hash)?.unwrap_or_default();
        outcome.unhealthy.extend(Unhealthy::of(id, &health));
        let hidden = without_background(&health).into_iter();
        let named = hidden.map(|view| format!("{id} {view}"));
        outcome.without_background.extend(named);
    }
    let by_boxes = |of: &FalseBoxes| Reverse(of.boxes);
    outcome.false_boxes.sort_by_key(by_boxes);
    Ok(outcome)
}

/// Waits until no other process searches a scenario.
fn wait_for_other(folder: &ScenarioFolder, watch: &dyn Watch) -> Result<()> {
    let mut said = false;
    while !watch.is_stopped()
        && let Claimed::Theirs(holder) = folder.claim_search()?
    {
        if !said {
            tracing::warn!("{}: {holder} searches it; waiting", folder.id());
            said = true;
        }
        thread::sleep(POLL_INTERVAL);
    }
    Ok(())
}

/// Distributes the views over the workers.
fn work_through(
    jobs: &[ScenarioJob],
    make: MakeDetector<'_>,
    options: &DetectOptions,
    watch: &dyn Watch,
) -> Result<()> {
    let views: Vec<ViewJob<'_>> = jobs.iter().flat_map(ScenarioJob::views).collect();
    watch.begin("", views.iter().map(ViewJob::pictures).sum());
    let next = AtomicUsize::new(0);
    let done = Mutex::new(0);
    let picture_done = || {
        let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
        *done += 1;
        watch.advance(*done, "");
    };
    let work = || -> Result<()> {
        let mut detector = None;
        while !watch.is_stopped()
            && let Some(view) = views.get(next.fetch_add(1, Ordering::Relaxed))
        {
            let detector = match &mut detector {
                _ if !view.needs_detector() => None,
                Some(detector) => Some(detector),
                none => Some(none.insert(make()?)),
            };
            let detector = detector.map(|detector| &mut **detector as &mut dyn Detector);
            view.search(detector, &picture_done, watch);
        }
        Ok(())
    };
    workers::share(options.workers.min(views.len()), work)
}

/// A scenario's ground-truth boxes, if it is labelled.
fn truth_in_sight(scenario: &OpenScenario) -> Result<Option<Vec<TruthInSight>>> {
    let Some(truth) = scenario.truth_boxes_if_labelled()? else {
        return Ok(None);
    };
    let clouds = CloudBase::of(scenario.record()?.weather());
    let rows = scenario.frames()?.rows;
    let first = rows
        .iter()
        .map(|row| ((row.tick, 0), row.pose.altitude_msl_m));
    let mut altitudes_msl_m: HashMap<_, _> = first.collect();
    for row in scenario.aircraft()?.into_iter().flatten() {
        let key = (row.tick, row.aircraft_number);
        altitudes_msl_m.insert(key, row.pose.altitude_msl_m);
    }
    let in_sight = |truth: TruthBox| {
        let altitude_msl_m = *altitudes_msl_m.get(&(truth.tick, truth.number()))?;
        let sight = clouds.sight(altitude_msl_m, truth.transmission);
        Some(TruthInSight { truth, sight })
    };
    Ok(Some(truth.into_iter().filter_map(in_sight).collect()))
}

#[cfg(test)]
mod tests;
