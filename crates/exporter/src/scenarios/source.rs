//! A scenario to export, with everything but its images.

use std::collections::{BTreeMap, BTreeSet};

use dataset::conditions::sight::{CloudBase, Sight};
use dataset::corpus::ScenarioFolder;
use dataset::corpus::calibration::{Calibration, CameraEntry};
use dataset::corpus::detections::{Detection, models_of};
use dataset::corpus::open_scenario::OpenScenario;
use dataset::corpus::scenario::ScenarioRecord;
use dataset::tables::frames::{Frames, TickRow};
use dataset::tables::pixel_box::TruthBox;

use super::labelled_box::{LabelledBox, TruthFigures};
use super::selection::Selected;
use crate::error::{Error, Result};
use crate::request::{BoxSource, BoxUse, ExportRequest};

/// Boxes by view and tick.
type ByPicture = BTreeMap<(String, u32), Vec<LabelledBox>>;

/// A scenario as it was sealed.
pub(crate) struct Source<'a> {
    pub(crate) selected: &'a Selected,
    pub(crate) scenario: OpenScenario,
    pub(crate) record: ScenarioRecord,
    pub(crate) frames: Frames,
    /// Name of the detections, if that model searched the scenario.
    pub(crate) model: Option<String>,
    pub(crate) calibration: Calibration,
    cloud_base: CloudBase,
    altitudes_msl_m: Altitudes,
    /// Every n-th tick is requested.
    every: u32,
    /// True if its ground truth is among the boxes.
    pub(crate) has_truth: bool,
    boxes: ByPicture,
    beside: ByPicture,
    left_out: BTreeSet<(String, u32)>,
}

/// True if this model searched the scenario; otherwise its ground truth is exported alone.
pub(crate) fn is_searched(folder: &ScenarioFolder, model: &str) -> Result<bool> {
    let models = models_of(folder)?;
    Ok(models.iter().any(|name| name == model))
}

impl<'a> Source<'a> {
    pub(crate) fn open(
        selected: &'a Selected,
        request: &ExportRequest,
        boxes_used: BoxUse,
        model: Option<&str>,
    ) -> Result<Self> {
        let scenario = selected.folder.open()?;
        let record = scenario.record()?;
        let frames = scenario.frames()?;
        let model = match model {
            Some(model) if is_searched(&selected.folder, model)? => Some(model.to_owned()),
            _ => None,
        };
        let mut detections = match &model {
            Some(model) => scenario.detections(model)?.boxes,
            None => Vec::new(),
        };
        if boxes_used == BoxUse::Crops {
            detections.retain(|found| found.confirmed);
        }
        let cloud_base = CloudBase::of(record.weather());
        let altitudes_msl_m = altitudes(&scenario, &frames)?;
        let mut left_out = BTreeSet::new();
        let mut has_truth = request.boxes == BoxSource::Truth;
        let (boxes, beside) = match request.boxes {
            BoxSource::Truth => {
                let mut boxes = Vec::new();
                for real in scenario.truth_boxes()? {
                    // A crop belongs to the first aircraft's distance.
                    if boxes_used == BoxUse::Crops && !real.is_of_first() {
                        continue;
                    }
                    let sight = sight_of(&real, &altitudes_msl_m, cloud_base);
                    // A label file has no word for a box that is neither right nor wrong.
                    match (boxes_used, sight) {
                        (BoxUse::Certain, Sight::Haze) => {}
                        (BoxUse::Certain, _) if sight == Sight::Cloud || !real.is_expected() => {
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
                let truth = if boxes_used == BoxUse::Crops {
                    scenario.truth_boxes_if_labelled()?
                } else {
                    None
                };
                has_truth = truth.is_some();
                let truth = truth.into_iter().flatten();
                let truth = truth.filter(TruthBox::is_of_first).map(|real| {
                    let sight = sight_of(&real, &altitudes_msl_m, cloud_base);
                    of_truth(real, sight)
                });
                (by_picture(confirmed.map(of_detection)), by_picture(truth))
            }
        };
        let every = request.every.get();
        if boxes_used == BoxUse::Crops {
            left_out = without_crops(selected, frames.rows.len(), every, &boxes);
        }
        Ok(Self {
            every,
            frames,
            calibration: scenario.calibration()?,
            cloud_base,
            altitudes_msl_m,
            model,
            record,
            has_truth,
            boxes,
            beside,
            left_out,
            selected,
            scenario,
        })
    }

    /// Adds everything that decides what its files contain.
    pub(crate) fn hash(&self, hasher: &mut blake3::Hasher) {
        let selected = (self.scenario.id(), self.selected.side, &self.selected.views);
        hasher.update(&serde_json::to_vec(&selected).unwrap_or_default());
        hasher.update(self.scenario.seal().manifest_blake3.as_bytes());
        for picture in self.boxes.iter().chain(&self.beside) {
            hasher.update(&serde_json::to_vec(&picture).unwrap_or_default());
        }
    }

    /// The requested ticks.
    pub(crate) fn rows(&self) -> impl Iterator<Item = &TickRow> {
        let rows = self.frames.rows.iter();
        rows.filter(|row| self.is_asked_for(row.tick))
    }

    /// True if this tick is requested.
    pub(crate) fn is_asked_for(&self, tick: u32) -> bool {
        tick.is_multiple_of(self.every)
    }

    pub(crate) fn has_picture(&self, view: &str, tick: u32) -> bool {
        self.is_asked_for(tick) && self.selected.views.iter().any(|name| name == view)
    }

    /// Sight of a ground-truth box's aircraft.
    pub(crate) fn sight_of(&self, real: &TruthBox) -> Sight {
        sight_of(real, &self.altitudes_msl_m, self.cloud_base)
    }

    pub(crate) fn is_left_out(&self, view: &str, tick: u32) -> bool {
        self.left_out.contains(&(view.to_owned(), tick))
    }

    pub(crate) fn boxes_of(&self, view: &str, tick: u32) -> &[LabelledBox] {
        let boxes = self.boxes.get(&(view.to_owned(), tick));
        boxes.map_or(&[], Vec::as_slice)
    }

    /// True if a sample of this tick is requested and has the images of all views.
    pub(crate) fn has_sample(&self, tick: u32) -> bool {
        let mut views = self.selected.views.iter();
        self.is_asked_for(tick) && !views.any(|view| self.is_left_out(view, tick))
    }

    /// The model's detections, if the boxes are the ground truth; in crops around detections, the ground truth.
    pub(crate) fn beside(&self, view: &str, tick: u32) -> &[LabelledBox] {
        let beside = self.beside.get(&(view.to_owned(), tick));
        beside.map_or(&[], Vec::as_slice)
    }

    /// A view's index in the table's rows, and its camera.
    pub(crate) fn view(&self, view: &str) -> Result<(usize, &CameraEntry)> {
        let index = self.frames.views.iter().position(|name| name == view);
        let camera = self.calibration.cameras.get(view);
        index.zip(camera).ok_or_else(|| {
            let known = self.frames.views.join(", ");
            Error::unknown("view", view, &known)
        })
    }

    /// The error for a video that does not have the image of a tick where it is expected.
    pub(crate) fn lost_picture(
        &self,
        view: &str,
        tick: u32,
        expected: i64,
        found: Option<i64>,
    ) -> Error {
        let scenario = &self.record.id;
        let found = found.map_or("the end of the video".into(), |pts| pts.to_string());
        Error::Video(format!(
            "scenario {scenario}, view {view}: at tick {tick} expected an image with timestamp {expected}, found {found}; generate it again"
        ))
    }
}

/// Images of ticks at which some view has no box to crop around.
fn without_crops(
    selected: &Selected,
    ticks: usize,
    every: u32,
    boxes: &ByPicture,
) -> BTreeSet<(String, u32)> {
    let mut left_out = BTreeSet::new();
    for tick in (0..ticks as u32).step_by(every as usize) {
        let pictures = || selected.views.iter().map(|view| (view.clone(), tick));
        if !pictures().all(|picture| boxes.contains_key(&picture)) {
            left_out.extend(pictures());
        }
    }
    left_out
}

/// Altitudes by tick and number of the aircraft, metres.
type Altitudes = BTreeMap<(u32, u32), f64>;

fn altitudes(scenario: &OpenScenario, frames: &Frames) -> Result<Altitudes> {
    let first = frames.rows.iter();
    let first = first.map(|row| ((row.tick, 0), row.pose.altitude_msl_m));
    let others = scenario.aircraft()?.into_iter().flatten();
    let others = others.map(|row| ((row.tick, row.aircraft_number), row.pose.altitude_msl_m));
    Ok(first.chain(others).collect())
}

fn sight_of(real: &TruthBox, altitudes_msl_m: &Altitudes, cloud_base: CloudBase) -> Sight {
    let altitude_m = altitudes_msl_m.get(&(real.tick, real.number()));
    cloud_base.sight(altitude_m.copied().unwrap_or_default(), real.transmission)
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
            aircraft_number: real.aircraft_number,
            occluded_fraction: real.occluded_fraction,
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

fn by_picture(boxes: impl Iterator<Item = OfPicture>) -> ByPicture {
    let mut all: BTreeMap<_, Vec<_>> = BTreeMap::new();
    for (picture, labelled) in boxes {
        all.entry(picture).or_default().push(labelled);
    }
    all
}
