//! The work on one scenario: its views are processed one by one, by whichever worker is free, and written together.

use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use dataset::corpus::ScenarioFolder;
use dataset::detections;
use dataset::open_scenario::OpenScenario;
use dataset::pixel_box::Detection;

use super::record::DetectionRecord;
use super::{DetectOptions, Model};
use crate::detector::{Detector, PictureView};
use crate::error::{Error, Result};
use crate::tiling::{TilingSettings, find_aircraft};

/// A scenario that is to be searched.
pub(super) struct ScenarioJob {
    scenario: OpenScenario,
    model: Model,
    settings: TilingSettings,
    views: Vec<ViewTicks>,
    /// One slot per view; empty until it is done.
    results: Mutex<Vec<Option<Result<ViewResult>>>>,
}

/// A view and the timestamps that its pictures must have, tick by tick.
struct ViewTicks {
    id: String,
    ticks: Vec<(u32, i64)>,
}

struct ViewResult {
    detections: Vec<Detection>,
    detector: String,
    seconds: f64,
}

/// One view of a scenario.
pub(super) struct ViewJob<'a> {
    scenario: &'a ScenarioJob,
    index: usize,
}

impl ScenarioJob {
    /// The remaining work of a scenario; `None` if it was done before.
    pub(super) fn plan(
        folder: ScenarioFolder,
        model: &Model,
        options: &DetectOptions,
    ) -> Result<Option<Self>> {
        let scenario = folder.open()?;
        if !options.again && DetectionRecord::is_there(&scenario, model, &options.settings)? {
            return Ok(None);
        }
        let record = scenario.record()?;
        let frames = scenario.frames()?;
        if frames.views != record.views {
            let (table, said) = (frames.views.join(", "), record.views.join(", "));
            let message = format!(
                "frames.parquet has the views {table}, scenario.json {said}; generate it again"
            );
            return Err(Error::scenario(&record.id, message));
        }
        let ticks_of = |index: usize| {
            frames
                .rows
                .iter()
                .map(|row| (row.tick, row.views[index].pts))
                .collect()
        };
        let views: Vec<_> = (0..)
            .zip(record.views)
            .map(|(index, id)| ViewTicks {
                id,
                ticks: ticks_of(index),
            })
            .collect();
        Ok(Some(Self {
            scenario,
            model: model.clone(),
            settings: options.settings,
            results: Mutex::new(views.iter().map(|_| None).collect()),
            views,
        }))
    }

    pub(super) fn id(&self) -> String {
        self.scenario.id()
    }

    pub(super) fn views(&self) -> impl Iterator<Item = ViewJob<'_>> {
        (0..self.views.len()).map(|index| ViewJob {
            scenario: self,
            index,
        })
    }

    /// Writes table and record once all views are done. Returns the time of the workers, seconds.
    pub(super) fn finish(self) -> Result<f64> {
        let results = self
            .results
            .into_inner()
            .unwrap_or_else(PoisonError::into_inner);
        let id = self.scenario.id();
        let mut detections = Vec::new();
        let mut seconds = 0.0;
        let mut detector = String::new();
        for (view, result) in self.views.iter().zip(results) {
            let searched = result.unwrap_or_else(|| {
                Err(Error::scenario(
                    &id,
                    format!("view {} was not searched: no detector was there", view.id),
                ))
            })?;
            detections.extend(searched.detections);
            seconds += searched.seconds;
            detector = searched.detector;
        }
        // By tick; views keep their order within a tick, and boxes theirs (best first) within a view.
        detections.sort_by_key(|detection| detection.tick);
        let record = |provenance| DetectionRecord {
            model: self.model.file_name.clone(),
            provenance,
            profile_blake3: self.model.profile_blake3.clone(),
            detector,
            settings: self.settings,
            dtd: env!("CARGO_PKG_VERSION").into(),
            pictures: self.views.iter().map(|view| view.ticks.len() as u64).sum(),
            detections: detections.len() as u64,
            seconds,
        };
        let folder = self.scenario.folder();
        let claim = folder.claim()?;
        // The scenario may have been recorded again in the meantime.
        if folder.open()?.videos_blake3() != self.scenario.videos_blake3() {
            let message =
                "its videos were replaced while they were searched; run `dtd detect` again";
            return Err(Error::scenario(&id, message));
        }
        let (source, blake3) = (&self.scenario, &self.model.blake3);
        detections::replace(
            &claim,
            source,
            blake3,
            self.model.short_hash(),
            &detections,
            record,
        )?;
        Ok(seconds)
    }
}

impl ViewJob<'_> {
    /// Number of pictures of the view.
    pub(super) fn pictures(&self) -> u64 {
        self.ticks().ticks.len() as u64
    }

    fn ticks(&self) -> &ViewTicks {
        &self.scenario.views[self.index]
    }

    /// Processes the view and stores the result with its scenario. Calls `picture_done` after every picture.
    pub(super) fn search(
        &self,
        detector: &mut dyn Detector,
        settings: &TilingSettings,
        picture_done: &dyn Fn(),
    ) {
        let started = Instant::now();
        let result = self
            .detections(detector, settings, picture_done)
            .map(|detections| ViewResult {
                detections,
                detector: detector.description(),
                seconds: started.elapsed().as_secs_f64(),
            });
        let mut results = self
            .scenario
            .results
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        results[self.index] = Some(result);
    }

    fn detections(
        &self,
        detector: &mut dyn Detector,
        settings: &TilingSettings,
        picture_done: &dyn Fn(),
    ) -> Result<Vec<Detection>> {
        let ViewTicks { id, ticks } = self.ticks();
        let mut reader = self.scenario.scenario.open_video(id)?;
        let (width_px, height_px) = (reader.width(), reader.height());
        let mut rgb = Vec::new();
        let mut detections = Vec::new();
        for &(tick, pts) in ticks {
            let found = reader.next_frame(&mut rgb)?;
            if found != Some(pts) {
                let found = found.map_or("the end of the video".into(), |found| {
                    format!("a picture with timestamp {found}")
                });
                return Err(self.fault(format!(
                    "at tick {tick} expected a picture with timestamp {pts}, found {found}"
                )));
            }
            let picture = PictureView {
                rgb: &rgb,
                width_px,
                height_px,
            };
            let sightings = find_aircraft(detector, &picture, settings)?;
            detections.extend(sightings.into_iter().map(|sighting| Detection {
                tick,
                view: id.clone(),
                pixel_box: sighting.pixel_box,
                score: sighting.score,
                tile: sighting.tile,
            }));
            picture_done();
        }
        if let Some(pts) = reader.next_frame(&mut rgb)? {
            return Err(self.fault(format!(
                "after the last tick there is a picture with timestamp {pts}"
            )));
        }
        Ok(detections)
    }

    fn fault(&self, message: String) -> Error {
        Error::scenario(
            &self.scenario.id(),
            format!("view {}: {message}", self.ticks().id),
        )
    }
}
