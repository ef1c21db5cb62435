//! Makes an export: views are decoded in parallel, scenarios noted as they are done, and the whole sealed at the end.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::thread;

use dataset::calibration::Calibration;
use dataset::corpus::Corpus;
use dataset::detections::{Detection, NoChoice, choose, models_of};
use dataset::frames::Frames;
use dataset::open_scenario::OpenScenario;
use dataset::pixel_box::TruthBox;
use dataset::scenario::ScenarioRecord;
use dataset::sight::{CloudBase, Sight};
use dataset::workers;
use serde::Serialize;

use crate::error::{Error, Result};
use crate::part::{LabelledBox, Part, Picture, TruthFigures, ViewPart};
use crate::place::{Found, Place};
use crate::request::{BoxSource, ExportRequest, Format};
use crate::selection::{Selected, select};
use crate::{coco, yolo};

/// Who watches an export.
#[derive(Clone, Copy)]
pub struct Watch<'a> {
    /// Told after every picture: pictures done, and pictures in all.
    pub progress: &'a (dyn Fn(u64, u64) + Sync),
    /// Asked before every picture.
    pub is_stopped: &'a (dyn Fn() -> bool + Sync),
}

/// What an export contains.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct ExportOutcome {
    /// Number of scenarios.
    pub scenarios: u64,
    /// Number of pictures.
    pub pictures: u64,
    /// Number of boxes.
    pub boxes: u64,
    /// Pictures of the selection that are not in it: in a format that cannot say that an aircraft may be hidden by a cloud, or that most of
    /// it is outside the picture.
    pub left_out: u64,
    /// Bytes of all files; missing if the export was there already.
    pub bytes: Option<u64>,
    /// Whether this very export was there already.
    pub unchanged: bool,
}

/// A scenario to export, with everything but its pictures.
struct Source<'a> {
    selected: &'a Selected,
    scenario: OpenScenario,
    record: ScenarioRecord,
    frames: Frames,
    calibration: Calibration,
    boxes: BTreeMap<(String, u32), Vec<LabelledBox>>,
    found: BTreeMap<(String, u32), Vec<LabelledBox>>,
    left_out: BTreeSet<(String, u32)>,
}

/// Exports a corpus to `out`. A run that was stopped or killed is continued by the same request.
///
/// # Errors
/// The request does not fit the corpus, `out` contains something else, or a file of the corpus does not match its seal. Nothing appears
/// under `out` then.
pub fn export(
    corpus: &Corpus,
    request: &ExportRequest,
    out: &Path,
    watch: Watch<'_>,
) -> Result<ExportOutcome> {
    let mut planned = Vec::new();
    let mut counts = ExportOutcome::default();
    let mut hasher = blake3::Hasher::new();
    hasher.update(env!("CARGO_PKG_VERSION").as_bytes());
    hasher.update(&serde_json::to_vec(request).unwrap_or_default());
    let selection = select(corpus, request)?;
    let model = model_of(&selection, request)?;
    for selected in selection {
        // Opened again when it is written: tables of all scenarios at once would not fit into memory.
        let source = Source::open(&selected, request, model.as_deref())?;
        source.count(request, &mut counts);
        source.hash(&mut hasher);
        planned.push(selected);
    }
    let place = match Place::take(out, hasher.finalize().to_hex().as_str())? {
        Found::Complete => {
            return Ok(ExportOutcome {
                unchanged: true,
                ..counts
            });
        }
        Found::Place(place) => place,
    };
    write_pictures(
        &planned,
        request,
        model.as_deref(),
        &place,
        counts.pictures,
        watch,
    )?;
    let parts = || planned.iter().map(|selected| place.part(&selected.id()));
    match request.format {
        Format::Coco => coco::finish(&place.files(), parts)?,
        Format::Yolo => yolo::finish(&place.files(), parts())?,
    }
    Ok(ExportOutcome {
        bytes: Some(place.finish()?),
        ..counts
    })
}

/// Writes the pictures of all scenarios that have none yet, and notes each that is done.
fn write_pictures(
    planned: &[Selected],
    request: &ExportRequest,
    model: Option<&str>,
    place: &Place,
    total: u64,
    watch: Watch<'_>,
) -> Result<()> {
    let done = AtomicU64::new(0);
    let picture_done = |pictures: u64| {
        let done = done.fetch_add(pictures, Ordering::Relaxed) + pictures;
        (watch.progress)(done, total);
    };
    let mut pending = Vec::new();
    for selected in planned {
        match place.has_part(&selected.id()) {
            true => picture_done(place.part(&selected.id())?.pictures()),
            false => pending.push(selected),
        }
    }
    let next = AtomicUsize::new(0);
    let has_failed = AtomicBool::new(false);
    let export_one = |selected: &Selected| -> Result<()> {
        let source = Source::open(selected, request, model)?;
        let part = source.write(request, &place.files(), watch, &|| picture_done(1))?;
        place.note(&part)
    };
    let work = || -> Result<()> {
        while !has_failed.load(Ordering::Relaxed)
            && let Some(selected) = pending.get(next.fetch_add(1, Ordering::Relaxed))
        {
            export_one(selected).inspect_err(|_| has_failed.store(true, Ordering::Relaxed))?;
        }
        Ok(())
    };
    let cores = thread::available_parallelism().map_or(1, usize::from);
    workers::share(cores.min(pending.len()), work)
}

/// Whether this model searched the scenario; true boxes of others stand alone.
fn is_searched(scenario: &OpenScenario, model: &str) -> Result<bool> {
    let models = models_of(scenario.folder())?;
    Ok(models.iter().any(|name| name == model))
}

/// The name of the detections that are wanted or stand beside the true boxes.
fn model_of(selection: &[Selected], request: &ExportRequest) -> Result<Option<String>> {
    if request.format == Format::Yolo && request.boxes == BoxSource::Truth {
        return Ok(None);
    }
    let folders: Vec<_> = selection.iter().map(|one| one.folder.clone()).collect();
    let asked = request.detections.as_deref();
    match choose(&folders, asked)? {
        Ok(chosen) => Ok(Some(chosen.hash)),
        Err(_) if request.boxes == BoxSource::Truth && asked.is_none() => Ok(None),
        Err(NoChoice::None) => Err(Error::NoDetections),
        Err(NoChoice::Others(known)) => Err(Error::Unknown {
            what: "model",
            found: asked.unwrap_or_default().to_owned(),
            known,
        }),
        Err(NoChoice::Several(known)) => Err(Error::SeveralModels { known }),
    }
}

impl<'a> Source<'a> {
    fn open(selected: &'a Selected, request: &ExportRequest, model: Option<&str>) -> Result<Self> {
        let scenario = selected.folder.open()?;
        let record = scenario.record()?;
        let frames = scenario.frames()?;
        let detections = match model {
            Some(model) if is_searched(&scenario, model)? => scenario.detections(model)?.boxes,
            _ => Vec::new(),
        };
        let mut left_out = BTreeSet::new();
        let (boxes, found) = match request.boxes {
            BoxSource::Truth => {
                let cloud_base = CloudBase::of(&record.conditions.weather);
                let mut boxes = Vec::new();
                for real in scenario.truth_boxes()? {
                    let altitude_m = frames.rows[real.tick as usize].pose.altitude_msl_m;
                    let sight = cloud_base.sight(altitude_m, real.transmission);
                    // A label file has no word for a box that is neither right nor wrong.
                    match (request.format, sight) {
                        (Format::Yolo, Sight::Haze) => {}
                        (Format::Yolo, Sight::Cloud) => {
                            left_out.insert((real.view, real.tick));
                        }
                        (Format::Yolo, Sight::Open) if !real.is_expected() => {
                            left_out.insert((real.view, real.tick));
                        }
                        _ => boxes.push(of_truth(real, sight)),
                    }
                }
                let found = detections.into_iter().map(of_detection);
                (by_picture(boxes.into_iter()), by_picture(found))
            }
            BoxSource::Detections => {
                let confirmed = detections.into_iter().filter(|found| found.confirmed);
                (by_picture(confirmed.map(of_detection)), BTreeMap::new())
            }
        };
        Ok(Self {
            frames,
            calibration: scenario.calibration()?,
            record,
            boxes,
            found,
            left_out,
            selected,
            scenario,
        })
    }

    fn count(&self, request: &ExportRequest, counts: &mut ExportOutcome) {
        counts.scenarios += 1;
        for view in &self.selected.views {
            for row in &self.frames.rows {
                if !row.tick.is_multiple_of(request.every.get()) {
                    continue;
                }
                if self.is_left_out(view, row.tick) {
                    counts.left_out += 1;
                } else {
                    counts.pictures += 1;
                    counts.boxes += self.boxes_of(view, row.tick).len() as u64;
                }
            }
        }
    }

    /// Adds everything that decides what its files contain.
    fn hash(&self, hasher: &mut blake3::Hasher) {
        let selected = (self.scenario.id(), self.selected.side, &self.selected.views);
        hasher.update(&serde_json::to_vec(&selected).unwrap_or_default());
        hasher.update(self.scenario.seal().manifest_blake3.as_bytes());
        for picture in self.boxes.iter().chain(&self.found) {
            hasher.update(&serde_json::to_vec(&picture).unwrap_or_default());
        }
    }

    fn is_left_out(&self, view: &str, tick: u32) -> bool {
        self.left_out.contains(&(view.to_owned(), tick))
    }

    fn boxes_of(&self, view: &str, tick: u32) -> &[LabelledBox] {
        let boxes = self.boxes.get(&(view.to_owned(), tick));
        boxes.map_or(&[], Vec::as_slice)
    }

    /// Writes the pictures of the scenario.
    fn write(
        &self,
        request: &ExportRequest,
        folder: &Path,
        watch: Watch<'_>,
        picture_done: &dyn Fn(),
    ) -> Result<Part> {
        let views = self.selected.views.iter();
        let views = views.map(|view| self.write_view(view, request, folder, watch, picture_done));
        Ok(Part {
            scenario: self.record.id.clone(),
            weather: self.record.conditions.weather_name.clone(),
            time_of_day: self.record.conditions.time_of_day.to_string(),
            side: self.selected.side,
            views: views.collect::<Result<_>>()?,
        })
    }

    fn write_view(
        &self,
        view: &str,
        request: &ExportRequest,
        folder: &Path,
        watch: Watch<'_>,
        picture_done: &dyn Fn(),
    ) -> Result<ViewPart> {
        let id = &self.record.id;
        let index = self.frames.views.iter().position(|name| name == view);
        let camera = self.calibration.cameras.get(view);
        let (Some(index), Some(camera)) = (index, camera) else {
            return Err(Error::Unknown {
                what: "view",
                found: view.to_owned(),
                known: self.frames.views.join(", "),
            });
        };
        let mut reader = self.scenario.open_video(view)?;
        let size_px = [reader.width(), reader.height()];
        let mut rgb = Vec::new();
        let mut pictures = Vec::new();
        for row in &self.frames.rows {
            if (watch.is_stopped)() {
                return Err(Error::Stopped);
            }
            let expected = row.views[index].pts;
            let found = reader.skip_frame()?;
            if found != Some(expected) {
                return Err(Error::Video {
                    scenario: id.clone(),
                    view: view.to_owned(),
                    tick: row.tick,
                    expected,
                    found: found.map_or("the end of the video".into(), |pts| pts.to_string()),
                });
            }
            if !row.tick.is_multiple_of(request.every.get()) || self.is_left_out(view, row.tick) {
                continue;
            }
            reader.convert(&mut rgb)?;
            let extension = request.stills.extension();
            let file = match request.format {
                Format::Coco => coco::picture_name(id, view, row.tick, extension),
                Format::Yolo => {
                    yolo::picture_name(self.selected.side, id, view, row.tick, extension)
                }
            };
            let path = folder.join(&file);
            let parent = path.parent().unwrap_or(folder);
            fs::create_dir_all(parent).map_err(dataset::Error::io("create", parent))?;
            request.stills.write(&path, &rgb, size_px)?;
            let found = self.found.get(&(view.to_owned(), row.tick));
            pictures.push(Picture {
                tick: row.tick,
                time_ns: row.time_ns,
                dtd_m: row.labels.map(|labels| labels.dtd_m),
                file,
                boxes: self.boxes_of(view, row.tick).to_vec(),
                found: found.cloned().unwrap_or_default(),
            });
            picture_done();
        }
        Ok(ViewPart {
            view: view.to_owned(),
            camera: camera.clone(),
            pictures,
        })
    }
}

type OfPicture = ((String, u32), LabelledBox);

fn of_truth(real: TruthBox, sight: Sight) -> OfPicture {
    let labelled = LabelledBox {
        pixel_box: real.pixel_box,
        score: None,
        truth: Some(TruthFigures {
            visible_fraction: real.visible_fraction,
            truncation: real.truncation,
            transmission: real.transmission,
            sight,
            is_expected: real.is_expected(),
        }),
    };
    ((real.view, real.tick), labelled)
}

fn of_detection(found: Detection) -> OfPicture {
    let labelled = LabelledBox {
        pixel_box: found.pixel_box,
        score: Some(found.score),
        truth: None,
    };
    ((found.view, found.tick), labelled)
}

fn by_picture(boxes: impl Iterator<Item = OfPicture>) -> BTreeMap<(String, u32), Vec<LabelledBox>> {
    let mut all: BTreeMap<_, Vec<_>> = BTreeMap::new();
    for (picture, labelled) in boxes {
        all.entry(picture).or_default().push(labelled);
    }
    all
}

#[cfg(test)]
mod tests {
    use std::num::NonZeroU32;
    use std::sync::atomic::AtomicU64;

    use testkit::files::contents;
    use testkit::short_corpus;

    use super::*;
    use crate::still::StillFormat;

    const SIZE_PX: [u32; 2] = [160, 96];

    fn corpus(root: &Path) -> Corpus {
        let paint = |view: &str, tick: u32, rgb: &mut [u8]| {
            for (place, value) in rgb.iter_mut().enumerate() {
                *value = (place / 3 % 160 + 20 * tick as usize + view.len()) as u8;
            }
        };
        let ids = ["0001-a", "0002-b", "0003-c"];
        short_corpus::write_with_videos(root, &ids, SIZE_PX[0], SIZE_PX[1], Some(&paint))
    }

    fn request(every: u32) -> ExportRequest {
        ExportRequest {
            format: Format::Coco,
            stills: StillFormat::Png,
            only: None,
            views: Some(vec!["right".into()]),
            side: None,
            every: NonZeroU32::new(every).unwrap(),
            boxes: BoxSource::Truth,
            detections: None,
        }
    }

    /// Exports; stops before the picture of this number.
    fn export_until(corpus: &Corpus, out: &Path, most: u64) -> Result<ExportOutcome> {
        let asked = AtomicU64::new(0);
        let watch = Watch {
            progress: &|_, _| {},
            is_stopped: &|| asked.fetch_add(1, Ordering::Relaxed) >= most,
        };
        export(corpus, &request(1), out, watch)
    }

    #[test]
    fn pictures_hold_exactly_the_decoded_pixels() {
        let temporary = tempfile::tempdir().unwrap();
        let corpus = corpus(&temporary.path().join("corpus"));
        labeller::label_corpus(&corpus, &|_| {}).unwrap();
        let out = temporary.path().join("out");
        let watch = Watch {
            progress: &|_, _| {},
            is_stopped: &|| false,
        };
        let outcome = export(&corpus, &request(2), &out, watch).unwrap();
        assert_eq!(
            (outcome.scenarios, outcome.pictures),
            (3, 6),
            "ticks 0 and 2 of one view"
        );
        let scenario = corpus.scenario("0002-b").open().unwrap();
        let mut reader = scenario.open_video("right").unwrap();
        let mut rgb = Vec::new();
        for tick in 0..3 {
            reader.next_frame(&mut rgb).unwrap().unwrap();
            let path = out.join(format!("images/0002-b_right_{tick:06}.png"));
            if tick == 1 {
                assert!(!path.exists());
                continue;
            }
            let picture = image::open(&path).unwrap().into_rgb8();
            assert_eq!([picture.width(), picture.height()], SIZE_PX);
            assert!(picture.into_raw() == rgb, "tick {tick}");
        }
        assert_eq!(dataset::seal::faults(&out).unwrap(), Vec::<String>::new());
    }

    #[test]
    fn an_export_that_was_stopped_goes_on_and_becomes_what_it_would_have_been() {
        let temporary = tempfile::tempdir().unwrap();
        let corpus = corpus(&temporary.path().join("corpus"));
        labeller::label_corpus(&corpus, &|_| {}).unwrap();
        let straight = temporary.path().join("straight");
        let whole = export_until(&corpus, &straight, u64::MAX).unwrap();
        let out = temporary.path().join("out");
        for most in [0, 4, 2] {
            let stopped = export_until(&corpus, &out, most).unwrap_err();
            assert!(matches!(stopped, Error::Stopped), "{stopped}");
            assert!(
                !out.exists(),
                "nothing under the final name before it is whole"
            );
        }
        assert_eq!(export_until(&corpus, &out, u64::MAX).unwrap(), whole);
        assert!(contents(&out) == contents(&straight));
        assert!(!temporary.path().join("out.partial").exists());
    }

    #[test]
    fn notes_of_an_export_that_was_moved_before_a_kill_do_not_stand_for_pictures() {
        let temporary = tempfile::tempdir().unwrap();
        let corpus = corpus(&temporary.path().join("corpus"));
        labeller::label_corpus(&corpus, &|_| {}).unwrap();
        let out = temporary.path().join("out");
        export_until(&corpus, &out, 4).unwrap_err();
        // As a kill between the move and the removal of the notes leaves it, and the user then removes the export.
        let partial = temporary.path().join("out.partial");
        fs::remove_dir_all(partial.join("new")).unwrap();
        let whole = export_until(&corpus, &out, u64::MAX).unwrap();
        let pictures = fs::read_dir(out.join("images")).unwrap().count();
        assert_eq!(pictures as u64, whole.pictures);
    }
}
