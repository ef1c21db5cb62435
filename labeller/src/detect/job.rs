//! The work on one scenario: its views are processed one by one, by whichever worker is free, and written together by the worker that
//! finishes the last one.

pub(crate) mod record;

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use dataset::corpus::ScenarioFolder;
use dataset::corpus::claim::{Claim, Claimed};
use dataset::corpus::detections::{self, Detections, NewTables};
use dataset::corpus::open_scenario::OpenScenario;
use dataset::corpus::scenario::ScenarioRecord;
use dataset::geometry::camera::Camera;
use dataset::work::watch::Watch;

use super::mode::Mode;
use super::pairs::fitted_cameras::FittedCameras;
use super::pairs::{Pairs, lock};
use super::pictures::ViewTicks;
use super::view_search::{Finder, ViewFindings, search_view};
use super::{DetectOptions, Model};
use crate::detector::{Detector, Device};
use crate::error::{Error, Result};
use crate::label::cameras;
use crate::registration::METHOD;
use crate::tiling::TilingSettings;
use crate::view_health;
use record::{DetectionRecord, HealthRecord, RegistrationRecord, Searching, Standing};

/// A scenario that is to be searched, or whose detections lack the measurements that belong to them.
pub(super) struct ScenarioJob {
    scenario: OpenScenario,
    model: Model,
    tiling: TilingSettings,
    mode: Mode,
    device: Device,
    views: Vec<ViewTicks>,
    /// The record of detections that are there already and only lack their registrations or the cameras' health.
    stored: Option<Box<DetectionRecord>>,
    /// These detections, while the scenario is being processed.
    loaded: Mutex<Option<Arc<Detections>>>,
    /// `None` with a single view.
    pairs: Option<Pairs>,
    cameras: Vec<Camera>,
    /// Used for the registration instead of `cameras`.
    fitted: Option<FittedCameras>,
    left: AtomicUsize,
    /// Empty until the view is done.
    results: Mutex<Vec<Option<Result<ViewResult>>>>,
    finished: Mutex<Option<Result<f64>>>,
    /// Repeats a search that a different process has finished meanwhile.
    force: bool,
    turn: Mutex<Turn>,
}

/// State of the claim on a scenario's search.
enum Turn {
    NotBegun,
    /// Held until it is written.
    Mine(Option<Claim>),
    /// A different process searches the scenario, or has just done so.
    Theirs,
}

pub(super) enum End {
    /// Everything is written.
    Done {
        seconds: f64,
    },
    /// A different process searches the scenario, or has just done so.
    Elsewhere,
    /// No worker had time for the whole scenario.
    NotBegun,
    Failed(Error),
}

struct ViewResult {
    findings: ViewFindings,
    detector: Option<String>,
    seconds: f64,
}

pub(super) struct ViewJob<'a> {
    scenario: &'a ScenarioJob,
    index: usize,
}

impl ScenarioJob {
    /// A scenario's remaining work; `None` if it was done before.
    pub(super) fn plan(
        folder: ScenarioFolder,
        model: &Model,
        options: &DetectOptions,
    ) -> Result<Option<Self>> {
        let scenario = folder.open()?;
        let fitted = options.registration_of.as_ref();
        let standing = if options.force {
            Standing::Missing
        } else {
            let searching = Searching::with(options.settings, options.mode);
            DetectionRecord::standing(&scenario, model, &searching, fitted)?
        };
        let record = scenario.record()?;
        let stored = match standing {
            Standing::Missing if fitted.is_some() => {
                let message = "has no detections of this model with these settings to register again; run `dtd detect` with the same \
                               options first";
                return Err(Error::scenario(&record.id, message));
            }
            Standing::Missing => None,
            Standing::Unmeasured(record) => Some(record),
            Standing::Whole => {
                let name = model.name();
                if detections::is_unsettled(&folder, &name)
                    && let Claimed::Mine(claim) = folder.claim_search()?
                {
                    detections::settle(&claim, &folder, &name)?;
                }
                return Ok(None);
            }
        };
        if fitted.is_none()
            && let Some(cameras) = stored.as_ref().and_then(|made| made.cameras_of_run())
        {
            let message = format!(
                "its views were registered with {cameras}, and are to be measured again; name that run (--registration-of), or \
                 search anew with the cameras of calibration.json (--force)"
            );
            return Err(Error::scenario(&record.id, message));
        }
        let frames = scenario.frames()?;
        if frames.views != record.views {
            let (table, said) = (frames.views.join(", "), record.views.join(", "));
            let message = format!(
                "frames.parquet has the views {table}, scenario.json {said}; generate it again"
            );
            return Err(Error::scenario(&record.id, message));
        }
        let cameras = cameras(&scenario, &record)?;
        let pairs = match fitted {
            Some(fitted) => pairs_of(
                &record,
                &fitted.of_views(&record.id, &record.views, &cameras)?,
            ),
            None => pairs_of(&record, &cameras),
        };
        let views = ViewTicks::of(&frames);
        Ok(Some(Self {
            scenario,
            model: model.clone(),
            tiling: options.settings,
            mode: options.mode,
            device: options.device,
            stored,
            loaded: Mutex::new(None),
            pairs,
            cameras,
            fitted: fitted.cloned(),
            left: AtomicUsize::new(views.len()),
            results: Mutex::new(views.iter().map(|_| None).collect()),
            finished: Mutex::new(None),
            force: options.force,
            turn: Mutex::new(Turn::NotBegun),
            views,
        }))
    }

    fn searching(&self) -> Searching {
        Searching::with(self.tiling, self.mode)
    }

    pub(super) fn id(&self) -> String {
        self.scenario.id()
    }

    /// True if detections exist and only what belongs to them is missing.
    pub(super) fn only_registers(&self) -> bool {
        self.stored.is_some()
    }

    pub(super) fn views(&self) -> impl Iterator<Item = ViewJob<'_>> {
        (0..self.views.len()).map(|index| ViewJob {
            scenario: self,
            index,
        })
    }

    pub(super) fn end(self) -> End {
        if matches!(*lock(&self.turn), Turn::Theirs) {
            return End::Elsewhere;
        }
        let finished = self.finished.into_inner();
        match finished.unwrap_or_else(PoisonError::into_inner) {
            Some(Ok(seconds)) => End::Done { seconds },
            Some(Err(error)) => End::Failed(error),
            None => End::NotBegun,
        }
    }

    /// True if this process searches the scenario. The first view decides.
    fn is_my_turn(&self) -> Result<bool> {
        let mut turn = lock(&self.turn);
        if let Turn::NotBegun = *turn {
            *turn = match self.scenario.folder().claim_search()? {
                Claimed::Mine(claim) if self.is_missing()? => Turn::Mine(Some(claim)),
                Claimed::Mine(_) | Claimed::Theirs(_) => Turn::Theirs,
            };
        }
        Ok(matches!(*turn, Turn::Mine(_)))
    }

    /// True unless a different process has searched the scenario since it was planned.
    fn is_missing(&self) -> Result<bool> {
        if self.force {
            return Ok(true);
        }
        let now = self.scenario.folder().open()?;
        let standing = {
            let fitted = self.fitted.as_ref();
            DetectionRecord::standing(&now, &self.model, &self.searching(), fitted)?
        };
        Ok(match standing {
            Standing::Whole => false,
            Standing::Unmeasured(_) => self.only_registers(),
            // The detections to measure are gone: planned again as a search.
            Standing::Missing => !self.only_registers(),
        })
    }

    /// Takes a view's result. The last view writes tables and record.
    fn take(&self, view: usize, result: Result<ViewResult>) {
        lock(&self.results)[view] = Some(result);
        if self.left.fetch_sub(1, Ordering::AcqRel) == 1 {
            let finished = self.finish();
            *lock(&self.finished) = Some(finished);
            *lock(&self.loaded) = None;
            if let Turn::Mine(claim) = &mut *lock(&self.turn) {
                *claim = None;
            }
        }
    }

    /// Detections that are there already, read by the first view that needs them.
    fn loaded(&self) -> Result<Arc<Detections>> {
        let mut loaded = lock(&self.loaded);
        if let Some(detections) = &*loaded {
            return Ok(detections.clone());
        }
        let detections = Arc::new(self.scenario.detections(&self.model.name())?);
        *loaded = Some(detections.clone());
        Ok(detections)
    }

    fn finish(&self) -> Result<f64> {
        let id = self.scenario.id();
        // Done first: no patch may be left waiting, also after a failure.
        let registered = self.pairs.as_ref();
        let registered = registered.map(|pairs| (pairs.reference(), pairs.finish()));
        let mut views = Vec::new();
        let mut seconds = 0.0;
        let mut detector = None;
        let results = std::mem::take(&mut *lock(&self.results));
        for result in results.into_iter().flatten() {
            let searched = result?;
            views.push(searched.findings);
            seconds += searched.seconds;
            detector = searched.detector.or(detector);
        }
        let ViewFindings {
            detections,
            health,
            backgrounds,
            windows,
            cpu_s,
        } = ViewFindings::together(views);
        let registered =
            registered.map(|(reference, done)| (reference, done.without_boxes(&detections)));
        let registration = registered
            .as_ref()
            .map(|(reference, done)| RegistrationRecord {
                method: METHOD,
                reference: (*reference).to_owned(),
                cameras_of_run: self.fitted.as_ref().map(|fitted| fitted.run_blake3.clone()),
                pairs: done.registrations.len() as u64,
                answered: done
                    .registrations
                    .iter()
                    .filter(|found| found.result.is_ok())
                    .count() as u64,
                seconds: done.seconds,
            });
        let watched = Some(HealthRecord {
            method: view_health::METHOD,
        });
        let tables = NewTables {
            health: Some(&health),
            backgrounds: Some(&backgrounds),
            detections: &detections,
            registrations: registered
                .as_ref()
                .map(|(_, done)| done.registrations.as_slice()),
        };
        let record = |provenance| match &self.stored {
            Some(made) => DetectionRecord {
                provenance,
                registration,
                health: watched,
                ..DetectionRecord::clone(made)
            },
            None => DetectionRecord {
                provenance,
                profile: self.model.profile.clone(),
                detector: detector.unwrap_or_default(),
                device: self.device.to_string(),
                searching: self.searching(),
                dtd: env!("CARGO_PKG_VERSION").into(),
                pictures: self.views.iter().map(|view| view.ticks.len() as u64).sum(),
                detections: detections.boxes.len() as u64,
                misses: detections.misses.len() as u64,
                windows,
                cpu_s,
                seconds,
                registration,
                health: watched,
            },
        };
        let folder = self.scenario.folder();
        let claim = folder.claim()?;
        // The scenario may have been recorded again in the meantime.
        if folder.open()?.videos_blake3() != self.scenario.videos_blake3() {
            let message =
                "its videos were replaced while they were searched; run `dtd detect` again";
            return Err(Error::scenario(&id, message));
        }
        let (source, detector) = (&self.scenario, &self.model.identity);
        detections::replace(&claim, source, detector, &self.model.name(), tables, record)?;
        Ok(seconds)
    }
}

/// The registrations to make; `None` with one view.
pub(super) fn pairs_of(record: &ScenarioRecord, cameras: &[Camera]) -> Option<Pairs> {
    let views = record.views.iter().cloned().zip(cameras.iter().copied());
    (record.views.len() > 1).then(|| Pairs::new(views.collect()))
}

impl ViewJob<'_> {
    pub(super) fn pictures(&self) -> u64 {
        self.ticks().ticks.len() as u64
    }

    /// True if the view is to be searched, not only measured.
    pub(super) fn needs_detector(&self) -> bool {
        !self.scenario.only_registers()
    }

    fn ticks(&self) -> &ViewTicks {
        &self.scenario.views[self.index]
    }

    /// Processes the view and stores the result with its scenario. Calls `picture_done` after every image. Without a detector, the
    /// stored detections are used.
    pub(super) fn search(
        &self,
        mut detector: Option<&mut (dyn Detector + '_)>,
        picture_done: &dyn Fn(),
        watch: &dyn Watch,
    ) {
        match self.scenario.is_my_turn() {
            Ok(true) => {}
            Ok(false) => return,
            Err(error) => return self.scenario.take(self.index, Err(error)),
        }
        let started = Instant::now();
        let description = detector.as_ref().map(|detector| detector.description());
        let stored = match &detector {
            Some(_) => Ok(Arc::default()),
            None => self.scenario.loaded(),
        };
        let result = stored.and_then(|stored| {
            let finder = match &mut detector {
                Some(detector) => Finder::Model {
                    detector: &mut **detector,
                    tiling: &self.scenario.tiling,
                    mode: self.scenario.mode,
                },
                None => Finder::Known(&stored),
            };
            search_view(
                &self.scenario.scenario,
                self.ticks(),
                finder,
                Some(&self.scenario.cameras[self.index]),
                &mut |picture| {
                    if let Some(pairs) = &self.scenario.pairs {
                        pairs.take(self.index, picture.tick, picture.patch);
                    }
                    picture_done();
                    Ok(watch.check()?)
                },
            )
        });
        let result = result.map(|findings| ViewResult {
            findings,
            detector: description,
            seconds: started.elapsed().as_secs_f64(),
        });
        self.scenario.take(self.index, result);
    }
}
