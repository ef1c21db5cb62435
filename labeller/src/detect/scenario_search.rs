//! Searches scenarios without writing anything, for who evaluates a detector.
//!
//! The same views, images, tracks and registrations as in `dtd detect`: both call [`search_view`] and [`Pairs`].

use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use dataset::corpus::detections::Detections;
use dataset::corpus::model_identity::ModelIdentity;
use dataset::corpus::open_scenario::OpenScenario;
use dataset::geometry::camera::Camera;
use dataset::tables::registrations::Registration;
use dataset::work::watch::Watch;
use dataset::work::workers;

use super::job::pairs_of;
use super::live_view::ViewSearch;
use super::pairs::lock;
use super::pictures::ViewTicks;
use super::view_search::cpu_time::CpuTime;
use super::view_search::{Finder, ViewFindings, search_view};
use super::{DetectOptions, MakeDetector, Model};
use crate::detector::{Detector, ModelFile, OrtDetector};
use crate::error::Result;
use crate::label::cameras;
use crate::registration::METHOD;
use crate::tracking;

/// A model with its search settings.
pub struct Searcher {
    file: ModelFile,
    model: Model,
    options: DetectOptions,
}

/// Results for one scenario.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Findings {
    /// Boxes, and images without.
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

    /// Number of views that may be searched in parallel.
    pub fn workers(&self) -> usize {
        self.options.workers
    }

    /// A hash that two searchers share only if they find the same in the same videos, at the same cost.
    pub fn identity(&self) -> String {
        let DetectOptions {
            settings,
            mode,
            device,
            ..
        } = &self.options;
        let tracking = tracking::METHOD;
        let (version, model) = (env!("CARGO_PKG_VERSION"), self.model.identity.blake3());
        let all = format!("{version} {METHOD} {tracking} {model} {settings:?} {mode:?} {device}");
        blake3::hash(all.as_bytes()).to_string()
    }

    /// Searches all views in parallel.
    ///
    /// # Errors
    /// A video lacks images or has extra ones, the detector fails, or the caller stops it ([`crate::Error::Stopped`]).
    pub fn search(
        &self,
        scenario: &OpenScenario,
        picture_done: &(dyn Fn() + Sync),
        watch: &dyn Watch,
    ) -> Result<Findings> {
        let make = || {
            self.detector()
                .map(|detector| Box::new(detector) as Box<dyn Detector>)
        };
        search_scenario(scenario, &make, &self.options, picture_done, watch)
    }

    /// An endless search with a separate model session. `camera`: the view's.
    pub fn view_search(&self, camera: &Camera) -> Result<ViewSearch> {
        let DetectOptions { settings, mode, .. } = self.options;
        let detector = Box::new(self.detector()?);
        Ok(ViewSearch::new(detector, settings, mode, camera))
    }

    fn detector(&self) -> Result<OrtDetector> {
        OrtDetector::of(&self.file, &self.options.ort())
    }
}

/// Searches all views with detectors made by `make`.
pub(super) fn search_scenario(
    scenario: &OpenScenario,
    make: MakeDetector<'_>,
    options: &DetectOptions,
    picture_done: &(dyn Fn() + Sync),
    watch: &dyn Watch,
) -> Result<Findings> {
    let views = ViewTicks::of(&scenario.frames()?);
    let record = scenario.record()?;
    let pairs = pairs_of(&record, &cameras(scenario, &record)?);
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
                mode: options.mode,
            };
            let findings = search_view(scenario, view, finder, None, &mut |picture| {
                if let Some(pairs) = &pairs {
                    pairs.take(index, picture.tick, picture.patch);
                }
                picture_done();
                Ok(watch.check()?)
            })?;
            *lock(&results[index]) = Some(findings);
        }
    };
    workers::share(options.workers.min(views.len()), work)?;
    let found = results.iter().filter_map(|result| lock(result).take());
    let ViewFindings {
        detections, cpu_s, ..
    } = ViewFindings::together(found);
    let registrations = pairs
        .map(|pairs| pairs.finish().without_boxes(&detections).registrations)
        .unwrap_or_default();
    Ok(Findings {
        detections,
        registrations,
        cpu_s,
    })
}

#[cfg(test)]
mod tests {
    use dataset::tables::pixel_box::PixelBox;
    use dataset::work::watch::Silent;
    use testkit::files::contents;
    use testkit::short_corpus;
    use testkit::watch::Calls;

    use super::super::{ModelIdentity, detect_with};
    use super::*;
    use crate::detect::Mode;
    use crate::error::Error;
    use crate::tiling::tests::blob_finder::{BlobFinder, paint_blob};

    const MODEL: &str = "0123456789abcdef";
    const WIDTH: u32 = 1280;

    fn make() -> Result<Box<dyn Detector>> {
        Ok(Box::new(BlobFinder::default()))
    }

    #[test]
    fn a_search_finds_in_every_mode_what_detect_writes_and_writes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let paint = |view: &str, tick: u32, rgb: &mut [u8]| {
            rgb.fill(20);
            let left = if view == "left" { 100.0 } else { 630.0 } + 8.0 * f64::from(tick);
            let blob = PixelBox::from_edges(left - 0.5, 199.5, left + 15.5, 207.5);
            paint_blob(rgb, WIDTH, &blob);
        };
        let corpus =
            short_corpus::write_with_videos(folder.path(), &["0001-a"], WIDTH, 768, Some(&paint));
        let model = Model {
            identity: ModelIdentity {
                model: Some("blobs.onnx".into()),
                model_blake3: MODEL.repeat(4),
                profile_blake3: None,
            },
            profile: None,
        };
        for mode in [Mode::Full, Mode::Tracked] {
            let options = DetectOptions {
                mode,
                workers: 2,
                ..DetectOptions::default()
            };
            let written = detect_with(&corpus, &model, &make, &options, &Silent).unwrap();
            assert_eq!(written.detected, ["0001-a"]);
            let before = contents(folder.path());
            let scenario = corpus.scenario("0001-a").open().unwrap();
            let found = search_scenario(&scenario, &make, &options, &|| {}, &Silent).unwrap();
            assert_eq!(found.detections, scenario.detections(MODEL).unwrap());
            assert_eq!(
                Some(found.registrations),
                scenario.registrations(MODEL).unwrap()
            );
            assert!(found.cpu_s.total() > 0.0);
            assert!(before == contents(folder.path()), "something was written");
            let at_once = Calls {
                advance: |_| {},
                is_stopped: || true,
            };
            let stopped = search_scenario(&scenario, &make, &options, &|| {}, &at_once);
            assert!(matches!(stopped, Err(Error::Stopped(_))));
        }
    }
}
