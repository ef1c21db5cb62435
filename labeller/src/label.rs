//! Labels a corpus: distances in `frames.parquet` and `aircraft.parquet`, projected boxes in `boxes_truth.parquet`.
//!
//! Labels follow from the poses of the ticks, the touchdown target and the calibrated cameras. A scenario's tables change together or not
//! at all, and correct labels stay untouched.

mod boxes;
mod track;

use std::sync::atomic::{AtomicU64, Ordering};

use airframe::AircraftType;
use dataset::corpus::open_scenario::OpenScenario;
use dataset::corpus::scenario::ScenarioRecord;
use dataset::corpus::seal::{Seal, is_unsettled, replace_files, settle};
use dataset::corpus::{Corpus, ScenarioFolder};
use dataset::geometry::camera::Camera;
use dataset::tables::aircraft::AircraftRow;
use dataset::tables::frames::Frames;
use dataset::tables::image_rows::ImageRow;
use dataset::tables::pixel_box::TruthBox;
use dataset::work::watch::Watch;
use rayon::prelude::*;
use serde::Serialize;

use crate::error::{Error, Failure, Result};
use boxes::truth_boxes;
pub use track::labels_of;

/// Class of every ground-truth box.
pub(crate) const AIRCRAFT_CLASS: &str = "aircraft";

/// Labelling results for a corpus.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct LabelOutcome {
    /// Scenarios that got new labels.
    pub labelled: Vec<String>,
    /// Scenarios whose labels were already correct.
    pub unchanged: Vec<String>,
    /// Scenarios that could not be labelled.
    pub failed: Vec<Failure>,
    /// Views that never have the aircraft in sight, as `SCENARIO, view VIEW`: nothing can be detected in them, or learned from them.
    pub without_boxes: Vec<String>,
    /// Scenarios that were left to the next run, because the caller stopped this one.
    pub left: Vec<String>,
    /// True if the caller stopped it, even if no work was left.
    pub stopped: bool,
}

/// Labels all committed scenarios, several in parallel. A scenario that fails is reported and does not stop the others. Scenarios that are
/// done when `watch` stops the run stay.
///
/// # Errors
/// The corpus cannot be listed, or disk, permissions or another process kept scenarios from being labelled, as many as were tried.
pub fn label_corpus(corpus: &Corpus, watch: &dyn Watch) -> Result<LabelOutcome> {
    let scenarios = corpus.scenarios()?;
    watch.begin("", scenarios.len() as u64);
    let done = AtomicU64::new(0);
    let label = |folder| {
        watch.check()?;
        let result = label_scenario(folder);
        watch.advance(done.fetch_add(1, Ordering::Relaxed) + 1, "");
        result
    };
    let results: Vec<(String, Result<Labelled>)> = scenarios
        .par_iter()
        .map(|folder| (folder.id(), label(folder)))
        .collect();
    let mut outcome = LabelOutcome {
        stopped: watch.is_stopped(),
        ..LabelOutcome::default()
    };
    let mut hindrance = None;
    for (id, result) in results {
        match result {
            Ok(Labelled {
                is_new,
                without_boxes,
            }) => {
                let named = without_boxes
                    .iter()
                    .map(|view| format!("{id}, view {view}"));
                outcome.without_boxes.extend(named);
                if is_new {
                    outcome.labelled.push(id);
                } else {
                    outcome.unchanged.push(id);
                }
            }
            Err(Error::Stopped(_)) => outcome.left.push(id),
            Err(error) if error.is_of_environment() => hindrance = hindrance.or(Some(error)),
            Err(error) => outcome.failed.push(Failure {
                id,
                reason: error.to_string(),
            }),
        }
    }
    hindrance.map_or(Ok(outcome), Err)
}

struct Labelled {
    is_new: bool,
    without_boxes: Vec<String>,
}

fn label_scenario(folder: &ScenarioFolder) -> Result<Labelled> {
    let mut labels = Labels::of(folder)?;
    if labels.are_there && !is_unsettled(folder.root()) {
        return Ok(Labelled {
            is_new: false,
            without_boxes: labels.views_without_boxes(),
        });
    }
    let claim = folder.claim()?;
    settle(&claim, folder.root())?;
    // A concurrent writer may have been faster.
    if folder.seal()?.as_ref() != Some(&labels.seal) {
        labels = Labels::of(folder)?;
    }
    if !labels.are_there {
        let mut names = vec![ScenarioFolder::FRAMES];
        names.extend(labels.boxes.as_ref().map(|_| ScenarioFolder::TRUTH_BOXES));
        names.extend(labels.aircraft.as_ref().map(|_| ScenarioFolder::AIRCRAFT));
        replace_files(&claim, folder.root(), &names, |name, path| match name {
            ScenarioFolder::FRAMES => labels.frames.write(path),
            ScenarioFolder::AIRCRAFT => {
                AircraftRow::write(labels.aircraft.as_deref().unwrap_or_default(), path)
            }
            _ => TruthBox::write(labels.boxes.as_deref().unwrap_or_default(), path),
        })?;
    }
    Ok(Labelled {
        is_new: !labels.are_there,
        without_boxes: labels.views_without_boxes(),
    })
}

/// The labels that a scenario should have.
struct Labels {
    /// Seal of the state that they were computed from.
    seal: Seal,
    frames: Frames,
    views: Vec<String>,
    /// `None` of a recorded scenario.
    boxes: Option<Vec<TruthBox>>,
    /// `None` of a scenario without traffic.
    aircraft: Option<Vec<AircraftRow>>,
    /// True if the scenario already has them.
    are_there: bool,
}

impl Labels {
    fn of(folder: &ScenarioFolder) -> Result<Self> {
        let scenario = folder.open()?;
        let record = scenario.record()?;
        let mut frames = scenario.frames()?;
        // The attitude of a recorded aircraft, and often its type, are not known well enough for ground-truth boxes.
        let rows = scenario.aircraft()?;
        let boxes = match record.weather() {
            Some(weather) if record.recorded.is_none() => {
                let types = check(&record, &frames)?;
                let cameras = cameras(&scenario, &record)?;
                let flown = (&frames, rows.as_deref());
                Some(truth_boxes(&record, weather, &types, flown, &cameras))
            }
            _ => None,
        };
        let aircraft = rows.clone().map(|rows| with_distances(&record, rows));
        let mut are_there = aircraft == rows;
        let labels = labels_of(
            &frames.rows,
            record.touchdown,
            record.runway.course_true_deg,
        );
        for (row, labels) in frames.rows.iter_mut().zip(labels) {
            are_there &= row.labels == Some(labels);
            row.labels = Some(labels);
        }
        are_there = are_there && scenario.truth_boxes_if_labelled()? == boxes;
        Ok(Self {
            seal: scenario.seal().clone(),
            frames,
            views: record.views,
            boxes,
            aircraft,
            are_there,
        })
    }

    fn views_without_boxes(&self) -> Vec<String> {
        let Some(boxes) = &self.boxes else {
            return Vec::new();
        };
        let is_empty = |view: &&String| boxes.iter().all(|seen| seen.view != **view);
        self.views.iter().filter(is_empty).cloned().collect()
    }
}

/// The types of the scenario's aircraft, the first one's first, if the scenario can be labelled.
fn check(record: &ScenarioRecord, frames: &Frames) -> Result<Vec<&'static AircraftType>> {
    let fault = |message: String| Err(Error::scenario(&record.id, message));
    let others = record.traffic.iter().map(|other| &other.aircraft);
    let types = std::iter::once(&record.aircraft).chain(others);
    let types = types.map(|name| AircraftType::named(name));
    let types = match types.collect::<std::result::Result<Vec<_>, _>>() {
        Ok(types) => types,
        Err(unknown) => return fault(format!("its shape is unknown: {unknown}")),
    };
    if let Some(geoid) = &record.geoid {
        return fault(format!(
            "its heights refer to the geoid {geoid}; expected none (heights above the ellipsoid)"
        ));
    }
    if frames.rows.len() != record.ticks as usize {
        return fault(format!(
            "frames.parquet has {} rows, but scenario.json says {} ticks; generate the scenario again",
            frames.rows.len(),
            record.ticks
        ));
    }
    Ok(types)
}

/// The cameras of the scenario's views, in their order.
pub(crate) fn cameras(scenario: &OpenScenario, record: &ScenarioRecord) -> Result<Vec<Camera>> {
    let calibration = scenario.calibration()?;
    let camera_of = |view: &String| {
        let entry = calibration.cameras.get(view).ok_or_else(|| {
            let known: Vec<&str> = calibration.cameras.keys().map(String::as_str).collect();
            let known = known.join(", ");
            Error::scenario(
                &record.id,
                format!("calibration.json has no camera {view}; it has {known}"),
            )
        })?;
        if let Some(fault) = entry.fault() {
            return Err(Error::scenario(
                &record.id,
                format!("camera {view} of calibration.json {fault}"),
            ));
        }
        Ok(entry.camera())
    };
    record.views.iter().map(camera_of).collect()
}

/// The rows with the distances of those that land.
fn with_distances(record: &ScenarioRecord, mut rows: Vec<AircraftRow>) -> Vec<AircraftRow> {
    for row in &mut rows {
        let from = row.pose.position().lat_lon();
        let lands = record.lands(row.aircraft_number);
        row.dtd_m = lands.then(|| record.touchdown.lat_lon().distance_m(from));
    }
    rows
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use dataset::conditions::transmission;
    use dataset::corpus::seal::seal_folder;
    use dataset::work::watch::Silent;
    use testkit::short_corpus;

    use super::*;

    fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
        let mut files: Vec<_> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .filter(|path| path.is_file())
            .map(|path| {
                (
                    path.file_name().unwrap().to_string_lossy().into_owned(),
                    fs::read(path).unwrap(),
                )
            })
            .collect();
        files.sort();
        files
    }

    /// Replaces the table of images.
    fn edit(folder: &ScenarioFolder, change: impl Fn(&mut Frames)) {
        let mut frames = folder.open().unwrap().frames().unwrap();
        change(&mut frames);
        let (claim, names) = (folder.claim().unwrap(), [ScenarioFolder::FRAMES]);
        replace_files(&claim, folder.root(), &names, |_, path| frames.write(path)).unwrap();
    }

    #[test]
    fn labelling_writes_both_tables_and_keeps_the_seal_valid() {
        let temporary = tempfile::tempdir().unwrap();
        let corpus = short_corpus::write(temporary.path(), &["0001-a", "0002-b"]);
        let outcome = label_corpus(&corpus, &Silent).unwrap();
        assert_eq!(outcome.labelled, ["0001-a", "0002-b"]);
        assert_eq!(outcome.failed, []);
        let folder = corpus.scenario("0001-a");
        let scenario = folder.open().unwrap();
        let frames = scenario.frames().unwrap();
        let first = frames.rows[0].labels.unwrap();
        assert!((first.dtd_m - short_corpus::START_M).abs() < 1e-6);
        assert_eq!(scenario.truth_boxes().unwrap().len(), 2 * frames.rows.len());
        assert_eq!(
            dataset::corpus::seal::faults(folder.root()).unwrap(),
            Vec::<String>::new()
        );
    }

    #[test]
    fn a_wrong_label_is_made_right() {
        let temporary = tempfile::tempdir().unwrap();
        let corpus = short_corpus::write(temporary.path(), &["0001-a"]);
        label_corpus(&corpus, &Silent).unwrap();
        let folder = corpus.scenario("0001-a");
        let right = files(folder.root());
        edit(&folder, |frames| {
            frames.rows[1].labels.as_mut().unwrap().dtd_m += 1.0;
        });
        assert_eq!(label_corpus(&corpus, &Silent).unwrap().labelled, ["0001-a"]);
        assert_eq!(files(folder.root()), right);
    }

    #[test]
    fn views_that_never_have_the_aircraft_in_sight_are_named() {
        let temporary = tempfile::tempdir().unwrap();
        let corpus = short_corpus::write(temporary.path(), &["0001-a"]);
        assert!(
            label_corpus(&corpus, &Silent)
                .unwrap()
                .without_boxes
                .is_empty()
        );
        let folder = corpus.scenario("0001-a");
        edit(&folder, |frames| {
            for row in &mut frames.rows {
                // Behind the cameras.
                row.pose.latitude_deg += 1.0;
            }
        });
        let outcome = label_corpus(&corpus, &Silent).unwrap();
        assert_eq!(
            outcome.without_boxes,
            ["0001-a, view left", "0001-a, view right"]
        );
    }

    #[test]
    fn a_scenario_that_cannot_be_labelled_is_named_stays_as_it_is_and_does_not_stop_the_others() {
        let other_view = |folder: &ScenarioFolder| {
            let mut record = folder.open().unwrap().record().unwrap();
            record.views.push("tower".into());
            record.write(&folder.record_path()).unwrap();
            seal_folder(folder.root(), "config").unwrap();
        };
        let other_table = |folder: &ScenarioFolder| {
            let mut frames = folder.open().unwrap().frames().unwrap();
            frames.rows[0].pose.altitude_msl_m += 1.0;
            frames.write(&folder.frames_path()).unwrap();
        };
        let no_seal =
            |folder: &ScenarioFolder| fs::write(folder.root().join("DONE.json"), "").unwrap();
        type Change<'a> = &'a dyn Fn(&ScenarioFolder);
        let cases: [(Change<'_>, &str); 3] = [
            (&other_view, "no camera tower; it has left, right"),
            (&other_table, "frames.parquet: does not match its seal"),
            (&no_seal, "0001-a/DONE.json: is empty, expected a seal"),
        ];
        for (spoil, words) in cases {
            let temporary = tempfile::tempdir().unwrap();
            let corpus = short_corpus::write(temporary.path(), &["0001-a", "0002-b"]);
            let folder = corpus.scenario("0001-a");
            spoil(&folder);
            let before = files(folder.root());
            let outcome = label_corpus(&corpus, &Silent).unwrap();
            assert_eq!(outcome.labelled, ["0002-b"], "{words}");
            let failed = &outcome.failed[0];
            assert!(
                failed.id == "0001-a" && failed.reason.contains(words),
                "{failed:?}"
            );
            assert_eq!(files(folder.root()), before, "{words}");
        }
    }

    #[test]
    fn fog_takes_the_contrast_that_koschmieder_says() {
        assert!((transmission(9_260.0, 9_260.0) - 0.02).abs() < 1e-4);
        assert_eq!(transmission(0.0, 9_260.0), 1.0);
    }
}
