//! From a corpus to samples: one per tick at which at least one view saw the aircraft.
//!
//! Input: `splits.json`, and per scenario its record, calibration, labelled ticks, one model's detections and their registrations. Boxes
//! cut off by the
//! picture's edge are ignored (see [`crate::trusted_boxes`]); of the others of a view at a tick the one with the highest score
//! counts. Ticks past the touchdown target are ignored, because the distance to touchdown grows again there. A committed scenario
//! that is missing from the split is an error.

use std::collections::{BTreeMap, BTreeSet};

use dataset::camera::Camera;
use dataset::corpus::{Corpus, ScenarioFolder};
use dataset::detections::{Detection, models_of, named};
use dataset::geodesy::Geodetic;
use dataset::model_identity::NamedDetections;
use dataset::open_scenario::OpenScenario;
use dataset::pixel_box::PixelBox;
use dataset::plan::PlannedScenarios;
use dataset::registrations::Registration;
use dataset::runway::Runway;
use dataset::splits::{Side, Splits};
use dataset::units::METERS_PER_NAUTICAL_MILE;

use crate::error::{CorpusFault, Error, Result};
use crate::rig::Rig;
use crate::trusted_boxes::{holds_aircraft, is_whole};
use crate::view_shift::ViewShift;

/// Maximum distance from a runway on Earth: half of its circumference, nautical miles.
pub(crate) const FARTHEST_NM: f64 = 10_800.0;

/// The same in metres.
pub(crate) const FARTHEST_M: f64 = FARTHEST_NM * METERS_PER_NAUTICAL_MILE;

/// Which ticks become samples, by distance to touchdown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct DistanceRange {
    /// Smallest distance, nautical miles.
    pub min_nm: f64,
    /// Largest distance, nautical miles.
    pub max_nm: Option<f64>,
}

impl DistanceRange {
    fn contains(&self, dtd_m: f64) -> bool {
        let dtd_nm = dtd_m / METERS_PER_NAUTICAL_MILE;
        dtd_nm >= self.min_nm && self.max_nm.is_none_or(|max_nm| dtd_nm <= max_nm)
    }
}

/// One tick seen by at least one view.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Sample {
    /// Index into [`Samples::scenarios`].
    pub scenario: usize,
    /// Tick within the scenario.
    pub tick: u32,
    /// Time since the scenario's first tick, nanoseconds.
    pub time_ns: i64,
    /// True distance to touchdown, metres.
    pub dtd_m: f64,
    /// True distance along the course, metres.
    pub along_track_m: f64,
    /// True offset right of the course, metres.
    pub cross_track_m: f64,
    /// True position of the centre of gravity.
    pub position: Geodetic,
    /// What each view saw, in the order of [`Samples::views`].
    pub boxes: Vec<Option<PixelBox>>,
    /// Where the aircraft of each view is by registration, in the same order.
    pub shifts: Vec<Option<ViewShift>>,
}

impl Sample {
    /// The same tick with only some of its boxes; a shift goes with its box.
    pub(crate) fn with_boxes(&self, boxes: Vec<Option<PixelBox>>) -> Self {
        let kept = |shift: &ViewShift, seen: &Option<PixelBox>| {
            seen.is_some() && boxes[shift.reference].is_some()
        };
        let shifts = self.shifts.iter().zip(&boxes);
        Self {
            shifts: shifts
                .map(|(shift, seen)| shift.filter(|shift| kept(shift, seen)))
                .collect(),
            boxes,
            ..*self
        }
    }

    /// Number of views that saw the aircraft.
    pub(crate) fn detections(&self) -> usize {
        self.boxes.iter().flatten().count()
    }
}

/// What is known about a scenario besides its samples.
#[derive(Debug, Clone)]
pub(crate) struct ScenarioSummary {
    /// Identifier.
    pub id: String,
    /// Trajectory that it flies.
    pub trajectory: String,
    /// Side of the split.
    pub side: Side,
    /// Name of the weather.
    pub weather: String,
    /// Local time as the sweep names it.
    pub time_of_day: String,
    /// The runway.
    pub runway: Runway,
    /// The touchdown target.
    pub touchdown: Geodetic,
    /// Its cameras, in the order of the views, as placed in this scenario.
    pub cameras: Vec<Camera>,
    /// Ticks within the distance range, seen or not.
    pub ticks: usize,
    /// Ticks within the distance range at which each view saw the aircraft, in the order of the views.
    pub detected_ticks: Vec<usize>,
}

/// All samples of a corpus.
#[derive(Debug, Clone)]
pub(crate) struct Samples {
    /// Identifiers of the views, sorted.
    pub views: Vec<String>,
    /// The cameras that they belong to.
    pub rig: Rig,
    /// The detections that the boxes are from.
    pub detections: NamedDetections,
    /// The scenarios, sorted by identifier.
    pub scenarios: Vec<ScenarioSummary>,
    /// Scenarios of the split that are not in the corpus (yet).
    pub absent_scenarios: Vec<String>,
    /// The samples, by scenario and tick.
    pub samples: Vec<Sample>,
}

impl Samples {
    /// Reads the samples of a corpus.
    pub(crate) fn read(corpus: &Corpus, asked: Option<&str>, range: DistanceRange) -> Result<Self> {
        let splits = corpus.splits()?;
        let planned = PlannedScenarios::read(corpus)?;
        let folders = corpus.scenarios()?;
        let detections = choose_detections(corpus, &folders, asked)?;
        let rig = Rig::of(corpus, &folders)?;
        let mut found = Self {
            views: rig.cameras.keys().cloned().collect(),
            rig,
            detections,
            scenarios: Vec::new(),
            absent_scenarios: absent(&splits, &folders),
            samples: Vec::new(),
        };
        for folder in &folders {
            let scenario = folder.open()?;
            planned.check(&scenario.id(), &scenario.seal().config_hash)?;
            found.add_scenario(&scenario, &splits, range)?;
        }
        Ok(found)
    }

    fn add_scenario(
        &mut self,
        scenario: &OpenScenario,
        splits: &Splits,
        range: DistanceRange,
    ) -> Result<()> {
        let folder = scenario.folder();
        let record = scenario.record()?;
        let refused = |fault| Error::corpus(folder.root(), fault);
        let assignment =
            (splits.scenarios.get(&folder.id())).ok_or_else(|| refused(CorpusFault::NotInSplit))?;
        if assignment.trajectory != record.trajectory {
            return Err(refused(CorpusFault::OtherTrajectory {
                recorded: record.trajectory,
                split: assignment.trajectory.clone(),
            }));
        }
        let cameras: BTreeMap<String, Camera> = scenario
            .calibration()?
            .cameras
            .iter()
            .map(|(view, entry)| (view.clone(), entry.camera()))
            .collect();
        let detections = scenario.detections(&self.detections.hash)?;
        let detections: Vec<_> = detections.into_confirmed().collect();
        if let Some(Detection { view, .. }) = detections
            .iter()
            .find(|detection| !self.views.contains(&detection.view))
        {
            return Err(refused(CorpusFault::UnknownView(view.clone())));
        }
        let mut detections = best_detections(detections, &cameras);
        let registrations = scenario
            .registrations(&self.detections.hash)?
            .unwrap_or_default();
        let mut registrations: BTreeMap<(u32, String), Registration> = registrations
            .into_iter()
            .map(|registration| ((registration.tick, registration.view.clone()), registration))
            .collect();
        let mut summary = ScenarioSummary {
            id: folder.id(),
            trajectory: record.trajectory,
            side: assignment.side,
            weather: record.conditions.weather_name,
            time_of_day: record.conditions.time_of_day,
            runway: record.runway,
            touchdown: record.touchdown,
            cameras: cameras.into_values().collect(),
            ticks: 0,
            detected_ticks: vec![0; self.views.len()],
        };
        for row in scenario.frames()?.rows {
            let labels = (row.labels).ok_or_else(|| refused(CorpusFault::NoLabels))?;
            for (column, value) in [
                ("dtd_m", labels.dtd_m),
                ("along_track_m", labels.along_track_m),
                ("cross_track_m", labels.cross_track_m),
            ] {
                // NaN is never in range.
                if !(-FARTHEST_M..=FARTHEST_M).contains(&value) {
                    let tick = row.tick;
                    return Err(refused(CorpusFault::NotOnEarth {
                        tick,
                        column,
                        value,
                        most_m: FARTHEST_M,
                    }));
                }
            }
            if labels.along_track_m <= 0.0 || !range.contains(labels.dtd_m) {
                continue;
            }
            summary.ticks += 1;
            let boxes: Vec<_> = self
                .views
                .iter()
                .map(|view| detections.remove(&(row.tick, view.clone())))
                .collect();
            for (count, seen) in summary.detected_ticks.iter_mut().zip(&boxes) {
                *count += usize::from(seen.is_some());
            }
            if boxes.iter().any(Option::is_some) {
                let shift = |(view, seen): (&String, &Option<PixelBox>)| {
                    let registration = registrations.remove(&(row.tick, view.clone()))?;
                    let shift = registration.result.ok()?;
                    let reference = self.views.binary_search(&registration.reference).ok()?;
                    let in_reference = boxes[reference].as_ref()?;
                    ViewShift::between((reference, in_reference), seen.as_ref()?, &shift)
                };
                self.samples.push(Sample {
                    shifts: self.views.iter().zip(&boxes).map(shift).collect(),
                    scenario: self.scenarios.len(),
                    tick: row.tick,
                    time_ns: row.time_ns,
                    dtd_m: labels.dtd_m,
                    along_track_m: labels.along_track_m,
                    cross_track_m: labels.cross_track_m,
                    position: row.pose.position(),
                    boxes,
                });
            }
        }
        self.scenarios.push(summary);
        Ok(())
    }

    /// The samples of one side of the split.
    pub(crate) fn of_side(&self, side: Side) -> Vec<&Sample> {
        self.samples
            .iter()
            .filter(|sample| self.scenarios[sample.scenario].side == side)
            .collect()
    }

    /// The samples of one side with only those boxes that contain the aircraft. This uses the truth, so it is for training;
    /// evaluation uses the boxes as they are.
    pub(crate) fn with_true_boxes(&self, side: Side) -> Vec<Sample> {
        self.of_side(side)
            .into_iter()
            .filter_map(|sample| {
                let cameras = &self.scenarios[sample.scenario].cameras;
                let boxes: Vec<_> = sample
                    .boxes
                    .iter()
                    .zip(cameras)
                    .map(|(seen, camera)| {
                        seen.filter(|seen| holds_aircraft(seen, camera, sample.position))
                    })
                    .collect();
                let any = boxes.iter().any(Option::is_some);
                any.then(|| sample.with_boxes(boxes))
            })
            .collect()
    }

    /// The trajectories of one side of the split.
    pub(crate) fn trajectories(&self, side: Side) -> BTreeSet<String> {
        self.scenarios
            .iter()
            .filter(|s| s.side == side)
            .map(|s| s.trajectory.clone())
            .collect()
    }
}

fn absent(splits: &Splits, folders: &[ScenarioFolder]) -> Vec<String> {
    let present: BTreeSet<String> = folders.iter().map(ScenarioFolder::id).collect();
    splits
        .scenarios
        .keys()
        .filter(|id| !present.contains(*id))
        .cloned()
        .collect()
}

/// The whole box with the highest score per tick and view.
fn best_detections(
    detections: Vec<Detection>,
    cameras: &BTreeMap<String, Camera>,
) -> BTreeMap<(u32, String), PixelBox> {
    let mut best: BTreeMap<(u32, String), (f64, PixelBox)> = BTreeMap::new();
    for Detection {
        tick,
        view,
        pixel_box,
        score,
        ..
    } in detections
    {
        if !is_whole(&pixel_box, &cameras[&view]) {
            continue;
        }
        let entry = best.entry((tick, view)).or_insert((score, pixel_box));
        if score > entry.0 {
            *entry = (score, pixel_box);
        }
    }
    best.into_iter()
        .map(|(key, (_, pixel_box))| (key, pixel_box))
        .collect()
}

/// The requested detections, by the model's file name or by hash, or the only ones that there are.
fn choose_detections(
    corpus: &Corpus,
    folders: &[ScenarioFolder],
    asked: Option<&str>,
) -> Result<NamedDetections> {
    let mut found = BTreeMap::new();
    for folder in folders {
        for hash in models_of(folder)? {
            let detections = found
                .entry(hash)
                .or_insert_with_key(|hash| named(folder, hash));
            if detections.model.is_none() {
                // The record in another scenario may be undamaged.
                *detections = named(folder, &detections.hash);
            }
        }
    }
    let is_meant =
        |detections: &&NamedDetections| asked.is_none_or(|asked| detections.is_meant_by(asked));
    let meant: Vec<_> = found.values().filter(is_meant).collect();
    let fault = match (meant.as_slice(), asked.map(str::to_owned)) {
        ([one], _) => return Ok((*one).clone()),
        ([], Some(asked)) if found.is_empty() => CorpusFault::NoDetectionsOf(asked),
        ([], Some(asked)) => CorpusFault::OtherDetections {
            asked,
            listed: listed(found.values()),
        },
        ([], None) => CorpusFault::NoDetections,
        (several, _) => CorpusFault::SeveralModels(listed(several.iter().copied())),
    };
    Err(Error::corpus(corpus.root(), fault))
}

fn listed<'a>(detections: impl Iterator<Item = &'a NamedDetections>) -> String {
    let shown: Vec<_> = detections.map(ToString::to_string).collect();
    shown.join(", ")
}

#[cfg(test)]
mod edited_files;

#[cfg(test)]
mod tests {
    use std::path::Path;

    use dataset::detections::{self, NewTables};
    use dataset::model_identity::ModelIdentity;
    use dataset::seal::seal_folder;

    use super::*;
    use testkit::synthetic::{MODEL_FILE, MODEL_HASH, SyntheticCorpus};

    const ALL: DistanceRange = DistanceRange {
        min_nm: 0.0,
        max_nm: None,
    };

    fn read(folder: &Path, corpus: &SyntheticCorpus) -> Samples {
        Samples::read(&corpus.write(folder).unwrap(), None, ALL).unwrap()
    }

    fn detection(score: f64, cx_px: f64) -> Detection {
        let pixel_box = PixelBox {
            cx_px,
            cy_px: 600.0,
            width_px: 40.0,
            height_px: 12.0,
        };
        Detection::untracked(4, "left", pixel_box, score, 0)
    }

    #[test]
    fn a_box_that_the_picture_s_edge_cuts_off_does_not_count_however_high_its_score() {
        let folder = tempfile::tempdir().unwrap();
        let samples = read(folder.path(), &SyntheticCorpus::tiny());
        let cameras = BTreeMap::from([("left".to_owned(), samples.scenarios[0].cameras[0])]);
        let cut = detection(0.9, 19.0);
        let best = best_detections(vec![cut.clone(), detection(0.4, 200.0)], &cameras);
        assert_eq!(best[&(4, "left".to_owned())].cx_px, 200.0);
        assert!(best_detections(vec![cut], &cameras).is_empty());
    }

    #[test]
    fn false_boxes_on_the_training_side_change_nothing_that_is_learned_from() {
        let folder = tempfile::tempdir().unwrap();
        let mut samples = read(folder.path(), &SyntheticCorpus::tiny());
        let undisturbed = samples.with_true_boxes(Side::Train);
        let recorded: Vec<_> = samples.of_side(Side::Train).into_iter().cloned().collect();
        assert_eq!(undisturbed, recorded, "nothing to leave out yet");
        // A view that saw nothing now sees something else.
        let mut added = 0;
        for sample in &mut samples.samples {
            for seen in sample.boxes.iter_mut().filter(|seen| seen.is_none()) {
                *seen = Some(detection(0.9, 60.0).pixel_box);
                added += 1;
            }
        }
        assert!(added > 10, "{added}");
        assert_eq!(samples.with_true_boxes(Side::Train), undisturbed);
    }

    #[test]
    fn of_several_whole_boxes_the_one_with_the_best_score_counts() {
        let folder = tempfile::tempdir().unwrap();
        let samples = read(folder.path(), &SyntheticCorpus::tiny());
        let cameras = BTreeMap::from([("left".to_owned(), samples.scenarios[0].cameras[0])]);
        let best = best_detections(
            vec![
                detection(0.5, 100.0),
                detection(0.9, 200.0),
                detection(0.7, 300.0),
            ],
            &cameras,
        );
        assert_eq!(best[&(4, "left".to_owned())].cx_px, 200.0);
    }

    #[test]
    fn a_tick_becomes_a_sample_if_any_view_saw_it() {
        let folder = tempfile::tempdir().unwrap();
        let corpus = SyntheticCorpus {
            miss_ratio: 0.5,
            ..SyntheticCorpus::tiny()
        }
        .write(folder.path())
        .unwrap();
        let samples = Samples::read(&corpus, None, ALL).unwrap();
        let ticks: usize = samples.scenarios.iter().map(|s| s.ticks).sum();
        let seen = samples.samples.len() as f64 / ticks as f64;
        assert!(
            (seen - 0.75).abs() < 0.08,
            "half of each view missed at random leaves 3/4, found {seen}"
        );
        assert!(samples.samples.iter().all(|s| s.detections() >= 1));
    }

    #[test]
    fn every_scenario_keeps_its_own_cameras_and_another_rig_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let corpus = SyntheticCorpus {
            turned_deg: 0.3,
            ..SyntheticCorpus::tiny()
        }
        .write(folder.path())
        .unwrap();
        let samples = Samples::read(&corpus, None, ALL).unwrap();
        assert!(samples.rig.cameras_vary);
        let [first, second] = [0, 1].map(|scenario| samples.scenarios[scenario].cameras[0]);
        assert_ne!(first.ecef_from_camera, second.ecef_from_camera);

        let other = corpus.scenarios().unwrap().remove(1);
        let mut record = other.open().unwrap().record().unwrap();
        record.rig = "another".into();
        record.write(&other.record_path()).unwrap();
        seal_folder(other.root(), "synthetic").unwrap();
        let message = Samples::read(&corpus, None, ALL).unwrap_err().to_string();
        assert!(
            message.contains("rig another") && message.contains("one rig"),
            "{message}"
        );
    }

    /// A corpus with the detections of the synthetic model, and of another one in its first scenario.
    fn of_two_models(folder: &Path, other: &ModelIdentity) -> Corpus {
        let corpus = SyntheticCorpus::tiny().write(folder).unwrap();
        let first = corpus.scenarios().unwrap().remove(0);
        let source = first.open().unwrap();
        let found = source.detections(MODEL_HASH).unwrap();
        let tables = NewTables::unregistered(&found);
        let claim = first.claim().unwrap();
        detections::replace(&claim, &source, other, &other.name(), tables, |made| made).unwrap();
        corpus
    }

    #[test]
    fn of_several_models_one_is_chosen_by_hash_or_by_file_name() {
        let folder = tempfile::tempdir().unwrap();
        let other = ModelIdentity {
            model: Some("other.onnx".into()),
            model_blake3: "0f".repeat(32),
            profile_blake3: None,
        };
        let corpus = of_two_models(folder.path(), &other);
        let asked = |asked: Option<&str>| {
            let read = Samples::read(&corpus, asked, ALL);
            read.map(|samples| samples.detections.hash)
                .map_err(|error| error.to_string())
        };
        let listed = format!("other.onnx ({}), {MODEL_FILE} ({MODEL_HASH})", other.name());
        let message = asked(None).unwrap_err();
        assert!(message.contains(&listed), "{message}");
        for name in [MODEL_HASH, MODEL_FILE] {
            assert_eq!(asked(Some(name)).as_deref(), Ok(MODEL_HASH));
        }
        let message = asked(Some("third.onnx")).unwrap_err();
        assert!(
            message.contains("third.onnx") && message.contains(&listed),
            "{message}"
        );
        let chosen = |name: &str| {
            let folders = corpus.scenarios().unwrap();
            let chosen = choose_detections(&corpus, &folders, Some(name));
            chosen.map(|detections| detections.hash).unwrap()
        };
        assert_eq!(chosen("other.onnx"), other.name());
        assert_eq!(chosen(&other.name()), other.name());
    }

    #[test]
    fn a_file_name_of_two_models_is_no_choice_and_both_are_listed_by_hash() {
        let folder = tempfile::tempdir().unwrap();
        let other = ModelIdentity {
            model: Some(MODEL_FILE.into()),
            model_blake3: MODEL_HASH.into(),
            profile_blake3: Some("a".repeat(64)),
        };
        let corpus = of_two_models(folder.path(), &other);
        let message = Samples::read(&corpus, Some(MODEL_FILE), ALL);
        let message = message.unwrap_err().to_string();
        for hash in [MODEL_HASH, &other.name()] {
            let listed = format!("{MODEL_FILE} ({hash})");
            assert!(message.contains(&listed), "{message}");
        }
        assert!(Samples::read(&corpus, Some(MODEL_HASH), ALL).is_ok());
    }

    #[test]
    fn a_trajectory_that_the_split_names_differently_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let corpus = SyntheticCorpus::tiny().write(folder.path()).unwrap();
        let mut splits = Splits::read(&corpus.splits_path()).unwrap();
        splits.scenarios.first_entry().unwrap().get_mut().trajectory = "renamed".into();
        splits.write(&corpus.splits_path()).unwrap();
        let message = Samples::read(&corpus, None, ALL).unwrap_err().to_string();
        assert!(message.contains("renamed"), "{message}");
    }
}
