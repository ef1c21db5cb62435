//! Searches scenarios without writing anything, for who evaluates a detector.
//!
//! The same views, pictures, tracks and registrations as in `dtd detect`: both call [`search_view`] and [`Pairs`].

use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use dataset::detections::Detections;
use dataset::model_identity::ModelIdentity;
use dataset::open_scenario::OpenScenario;
use dataset::registrations::Registration;

use super::cpu_time::CpuTime;
use super::job::{lock, pairs_of};
use super::pictures::ViewTicks;
use super::view_search::{Finder, ViewFindings, search_view};
use super::{DetectOptions, MakeDetector, Model};
use crate::detector::{Detector, ModelFile, OrtDetector};
use crate::error::{Error, Result};
use crate::registration::METHOD;

/// A model and the way in which it searches.
pub struct Searcher {
    file: ModelFile,
    model: Model,
    options: DetectOptions,
}

/// What a scenario shows.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Findings {
    /// Boxes, and pictures without.
    pub detections: Detections,
    /// Each view compared with the first; none with one view.
    pub registrations: Vec<Registration>,
    /// Processor time of all views, registration included.
    pub cpu_s: CpuTime,
}

impl Searcher {
    /// Reads a model, and loads it once to see whether it can be used.
    pub fn load(model: &Path, options: &DetectOptions) -> Result<Self> {
        options.check()?;
        let file = ModelFile::read(model)?;
        let searcher = Self {
            model: Model::of(&file),
            file,
            options: options.clone(),
        };
        searcher.detector()?;
        Ok(searcher)
    }

    /// The model and the settings beside it.
    pub fn model(&self) -> &ModelIdentity {
        &self.model.identity
    }

    /// A hash that two searchers share only if they find the same in the same videos, at the same cost.
    pub fn identity(&self) -> String {
        let DetectOptions {
            settings,
            modes,
            device,
            ..
        } = &self.options;
        let (version, model) = (env!("CARGO_PKG_VERSION"), self.model.identity.blake3());
        let all = format!("{version} {METHOD} {model} {settings:?} {modes:?} {device}");
        blake3::hash(all.as_bytes()).to_string()
    }

    /// Searches all views of a scenario, several at a time.
    ///
    /// # Errors
    /// A video does not have the pictures that it should have, the detector fails, or the caller stops it ([`Error::Stopped`]).
    pub fn search(
        &self,
        scenario: &OpenScenario,
        picture_done: &(dyn Fn() + Sync),
        is_stopped: &(dyn Fn() -> bool + Sync),
    ) -> Result<Findings> {
        let make = || {
            self.detector()
                .map(|detector| Box::new(detector) as Box<dyn Detector>)
        };
        search_scenario(scenario, &make, &self.options, picture_done, is_stopped)
    }

    fn detector(&self) -> Result<OrtDetector> {
        OrtDetector::of(&self.file, &self.options.ort())
    }
}

/// Searches all views of a scenario with the detectors that `make` makes.
pub(super) fn search_scenario(
    scenario: &OpenScenario,
    make: MakeDetector<'_>,
    options: &DetectOptions,
    picture_done: &(dyn Fn() + Sync),
    is_stopped: &(dyn Fn() -> bool + Sync),
) -> Result<Findings> {
    let views = ViewTicks::of(&scenario.frames()?);
    let pairs = pairs_of(scenario, &scenario.record()?)?;
    let next = AtomicUsize::new(0);
    let results: Vec<_> = views.iter().map(|_| Mutex::new(None)).collect();
    let work = || -> Result<()> {
        let mut detector = None;
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(view) = views.get(index) else {
                return Ok(());
            };
            let detector = match &mut detector {
                Some(detector) => detector,
                none => none.insert(make()?),
            };
            let finder = Finder::Model {
                detector: &mut **detector,
                tiling: &options.settings,
                modes: &options.modes,
            };
            let findings = search_view(scenario, view, finder, &mut |picture| {
                if let Some(pairs) = &pairs {
                    pairs.take(index, picture.tick, picture.patch);
                }
                picture_done();
                match is_stopped() {
                    true => Err(Error::Stopped),
                    false => Ok(()),
                }
            })?;
            *lock(&results[index]) = Some(findings);
        }
    };
    thread::scope(|scope| {
        let workers = 1..options.workers.min(views.len());
        let workers: Vec<_> = workers.map(|_| scope.spawn(work)).collect();
        let mine = work();
        workers
            .into_iter()
            .fold(mine, |result, worker| match worker.join() {
                Ok(theirs) => result.and(theirs),
                Err(panic) => std::panic::resume_unwind(panic),
            })
    })?;
    let found = results.iter().filter_map(|result| lock(result).take());
    let ViewFindings {
        detections, cpu_s, ..
    } = ViewFindings::together(found);
    Ok(Findings {
        detections,
        registrations: pairs
            .map(|pairs| pairs.finish().registrations)
            .unwrap_or_default(),
        cpu_s,
    })
}
