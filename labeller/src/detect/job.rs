//! The work on one scenario: its views are searched one by one, by whichever worker is free, and written together.

use std::fs;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use dataset::corpus::ScenarioFolder;
use dataset::json_file::write_json;
use dataset::pixel_box::{Detection, write_detections};
use dataset::video::VideoReader;

use super::record::DetectionRecord;
use super::{DetectOptions, Model};
use crate::detector::{Detector, Picture};
use crate::error::{Error, Result};
use crate::tiling::{TilingSettings, find_aircraft};

/// A scenario that is to be searched.
pub(super) struct ScenarioJob {
    folder: ScenarioFolder,
    model: Model,
    settings: TilingSettings,
    config_hash: String,
    views: Vec<ViewTicks>,
    /// One place per view; empty until it was searched.
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
    /// The work that a scenario asks for; `None` if it was done before.
    pub(super) fn plan(
        folder: ScenarioFolder,
        model: &Model,
        options: &DetectOptions,
    ) -> Result<Option<Self>> {
        let record = folder.record()?;
        if !options.again
            && DetectionRecord::is_there(&folder, model, &options.settings, &record.config_hash)?
        {
            return Ok(None);
        }
        let frames = folder.frames()?;
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
            folder,
            model: model.clone(),
            settings: options.settings,
            config_hash: record.config_hash,
            results: Mutex::new(views.iter().map(|_| None).collect()),
            views,
        }))
    }

    pub(super) fn id(&self) -> String {
        self.folder.id()
    }

    pub(super) fn views(&self) -> impl Iterator<Item = ViewJob<'_>> {
        (0..self.views.len()).map(|index| ViewJob {
            scenario: self,
            index,
        })
    }

    /// Writes table and record once all views are searched. Returns the time that the workers took, seconds.
    pub(super) fn finish(self) -> Result<f64> {
        let results = self
            .results
            .into_inner()
            .unwrap_or_else(PoisonError::into_inner);
        let id = self.folder.id();
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
        let record = DetectionRecord {
            model: self.model.file_name.clone(),
            model_blake3: self.model.blake3.clone(),
            detector,
            settings: self.settings,
            dtd: env!("CARGO_PKG_VERSION").into(),
            config_hash: self.config_hash,
            pictures: self.views.iter().map(|view| view.ticks.len() as u64).sum(),
            detections: detections.len() as u64,
            seconds,
        };
        write(&self.folder, self.model.short_hash(), &detections, &record)?;
        Ok(seconds)
    }
}

/// The record goes away first and comes last: as long as it is there it tells of the table that is there.
fn write(
    folder: &ScenarioFolder,
    model_hash: &str,
    detections: &[Detection],
    record: &DetectionRecord,
) -> Result<()> {
    let table_path = folder.detections_path(model_hash);
    let record_path = DetectionRecord::path(folder, model_hash);
    let parent = folder.detections_folder();
    fs::create_dir_all(&parent).map_err(dataset::Error::io("create", &parent))?;
    if record_path.exists() {
        fs::remove_file(&record_path).map_err(dataset::Error::io("remove", &record_path))?;
    }
    let beside = table_path.with_extension("parquet.tmp");
    write_detections(&beside, detections)?;
    fs::rename(&beside, &table_path)
        .map_err(dataset::Error::io("rename into place", &table_path))?;
    Ok(write_json(&record_path, record)?)
}

impl ViewJob<'_> {
    /// Number of pictures of the view.
    pub(super) fn pictures(&self) -> u64 {
        self.ticks().ticks.len() as u64
    }

    fn ticks(&self) -> &ViewTicks {
        &self.scenario.views[self.index]
    }

    /// Searches the view and leaves the result with its scenario. Calls `picture_done` after every picture.
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
        let mut reader = VideoReader::open(&self.scenario.folder.video_path(id))?;
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
            let picture = Picture {
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
