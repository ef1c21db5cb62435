//! Makes an export: views are decoded in parallel, scenarios noted as they are done, and the whole sealed at the end.

use std::collections::BTreeSet;
use std::mem;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::thread;

use dataset::corpus::Corpus;
use dataset::corpus::detections::{NoChoice, choose};
use dataset::corpus::splits::Side;
use dataset::plan::Plan;
use dataset::video::VideoSettings;
use dataset::work::watch::Watch;
use dataset::work::workers;
use serde::Serialize;

use crate::description::about::About;
use crate::description::croissant;
use crate::error::{Error, Result};
use crate::formats::{BoxUse, FileFormat, Writing, Written};
use crate::place::{Found, Place, refuse_corpus};
use crate::request::{BoxSource, ExportRequest};
use crate::scenarios::{LostScenario, Selected, Source, is_searched, select};

/// Counts and remarks of an export.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct ExportOutcome {
    /// Number of scenarios.
    pub scenarios: u64,
    /// Number of images.
    pub pictures: u64,
    /// Number of boxes.
    pub boxes: u64,
    /// Images of the selection that are not in it ([`Format::left_out`] says why): in a format that cannot say that an aircraft may be
    /// hidden by a cloud, or that most of it is outside the image, and of ticks at which there is a view without a crop.
    pub left_out: u64,
    /// Bytes of all files.
    pub bytes: u64,
    /// True if this very export already existed.
    pub unchanged: bool,
    /// Requested scenarios that are not in it.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub lost: Vec<LostScenario>,
    /// Parts that the dataset lacks for training in its format, as a sentence.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub remark: Option<&'static str>,
}

/// The data to export, checked against the corpus.
pub(crate) struct Export<'a> {
    pub(crate) request: &'a ExportRequest,
    /// Name of the detections that are wanted, or stand beside the ground-truth boxes.
    model: Option<String>,
    pub(crate) scenarios: Vec<Planned>,
    /// Sides of the split that they are on; what has no side is for training.
    pub(crate) sides: BTreeSet<Side>,
    pub(crate) about: About,
    /// Settings of the encoder, if videos are encoded.
    pub(crate) video: VideoSettings,
    /// Requested scenarios, not yet checked.
    selection: Vec<Selected>,
}

/// A scenario of it.
pub(crate) struct Planned {
    pub(crate) selected: Selected,
    pictures: u64,
    /// Its place in the export, from 0.
    number: usize,
}

/// Exports a corpus to `out`. A run that was stopped or killed is continued by the same request.
///
/// # Errors
/// The request does not fit the corpus, `out` contains something else, or a file of the corpus does not match its seal. No output appears
/// under `out` in that case. Scenarios with a missing or truncated video, or not searched by the model whose boxes are wanted, are left
/// out.
pub fn export(
    corpus: &Corpus,
    request: &ExportRequest,
    out: &Path,
    watch: &dyn Watch,
) -> Result<ExportOutcome> {
    request.check()?;
    refuse_corpus(corpus, out)?;
    let (mut selection, mut lost) = select(corpus, request)?;
    let model = model_of(&selection, request)?;
    if let (BoxSource::Detections, Some(model)) = (request.boxes, &model) {
        lost.extend(without_unsearched(&mut selection, model)?);
    }
    for LostScenario { id, reason } in &lost {
        watch.warn(&format!("scenario {id} is left out: {reason}"));
    }
    let plan = Plan::of_corpus(corpus)?;
    let export = Export {
        request,
        model,
        scenarios: Vec::new(),
        sides: BTreeSet::new(),
        about: About::new(corpus, request.license.clone())?,
        video: plan.map_or_else(VideoSettings::default, |plan| plan.common.video),
        selection,
    };
    let outcome = request.format.export(export, out, watch)?;
    Ok(ExportOutcome { lost, ..outcome })
}

/// Takes the scenarios out that the model has not searched: without boxes, their images would say that there is no aircraft.
fn without_unsearched(selection: &mut Vec<Selected>, model: &str) -> Result<Vec<LostScenario>> {
    let (mut searched, mut lost) = (Vec::new(), Vec::new());
    for selected in mem::take(selection) {
        if is_searched(&selected.folder, model)? {
            searched.push(selected);
        } else {
            lost.push(LostScenario {
                id: selected.id(),
                reason: format!(
                    "model {model} has not searched it; run `dtd detect` on the corpus"
                ),
            });
        }
    }
    *selection = searched;
    Ok(lost)
}

/// Makes an export in one format.
pub(crate) fn export_as<F: FileFormat>(
    mut export: Export<'_>,
    out: &Path,
    watch: &dyn Watch,
) -> Result<ExportOutcome> {
    let mut format = F::default();
    format.prepare(&export)?;
    let mut outcome = ExportOutcome::default();
    let mut hasher = blake3::Hasher::new();
    hasher.update(env!("CARGO_PKG_VERSION").as_bytes());
    hasher.update(&serde_json::to_vec(export.request).unwrap_or_default());
    hasher.update(export.about.name.as_bytes());
    format.hash(&mut hasher);
    export.check(&mut format, &mut hasher, &mut outcome, watch)?;
    let place = match Place::take(out, hasher.finalize().to_hex().as_str())? {
        Found::Complete { bytes } => {
            return Ok(ExportOutcome {
                bytes,
                unchanged: true,
                ..outcome
            });
        }
        Found::Place(place) => place,
    };
    let written = export
        .write_scenarios(&format, &place, outcome.pictures, watch)
        .and_then(|()| {
            let (export, place) = (&export, &place);
            let contents = format.finish(&Written {
                export,
                place,
                watch,
            })?;
            croissant::write(&place.files(), &export.about, &contents)
        });
    match written {
        Ok(()) => Ok(ExportOutcome {
            bytes: place.finish()?,
            ..outcome
        }),
        Err(error) => {
            if error.is_fault_of_corpus() {
                // If that fails as well, the fault of the corpus is still the one to report.
                let _ = place.abandon();
            }
            Err(error)
        }
    }
}

fn count(source: &Source<'_>, outcome: &mut ExportOutcome) {
    outcome.scenarios += 1;
    for view in &source.selected.views {
        for row in source.rows() {
            if source.is_left_out(view, row.tick) {
                outcome.left_out += 1;
            } else {
                outcome.pictures += 1;
                outcome.boxes += source.boxes_of(view, row.tick).len() as u64;
            }
        }
    }
}

impl Export<'_> {
    /// Opens a scenario. Tables of all scenarios at once would not fit into memory.
    pub(crate) fn open<'s>(&self, scenario: &'s Planned) -> Result<Source<'s>> {
        Source::open(&scenario.selected, self.request, self.model.as_deref())
    }

    /// Checks and counts the selected scenarios, and adds them to the identity of the export.
    fn check<F: FileFormat>(
        &mut self,
        format: &mut F,
        hasher: &mut blake3::Hasher,
        outcome: &mut ExportOutcome,
        watch: &dyn Watch,
    ) -> Result<()> {
        let mut selection = mem::take(&mut self.selection);
        if F::BY_SIDE {
            selection.sort_by_key(|selected| selected.side);
        }
        for selected in selection {
            watch.check()?;
            let source = Source::open(&selected, self.request, self.model.as_deref())?;
            format.check(&source, self)?;
            let before = outcome.pictures;
            count(&source, outcome);
            source.hash(hasher);
            self.about.add(&source.record, source.selected.side);
            self.about.models.extend(source.model.clone());
            // A side without images would have a name in data.yaml, and no folder.
            if outcome.pictures > before {
                self.sides.insert(selected.side.unwrap_or(Side::Train));
            }
            self.scenarios.push(Planned {
                selected,
                pictures: outcome.pictures - before,
                number: self.scenarios.len(),
            });
        }
        format.check_all(self, outcome)
    }

    /// Writes all scenarios that are not noted as done, and notes them.
    fn write_scenarios<F: FileFormat>(
        &self,
        format: &F,
        place: &Place,
        total: u64,
        watch: &dyn Watch,
    ) -> Result<()> {
        watch.begin("", total);
        let done = AtomicU64::new(0);
        let count = |pictures: u64| {
            let done = done.fetch_add(pictures, Ordering::Relaxed) + pictures;
            watch.advance(done, "");
        };
        let (noted, pending): (Vec<&Planned>, Vec<&Planned>) = self
            .scenarios
            .iter()
            .partition(|scenario| place.has_part(&scenario.selected.id()));
        count(noted.iter().map(|scenario| scenario.pictures).sum());
        let next = AtomicUsize::new(0);
        let has_failed = AtomicBool::new(false);
        let write = |scenario: &Planned| {
            let part = format.write(&Writing {
                export: self,
                source: self.open(scenario)?,
                number: scenario.number,
                folder: place.files(),
                watch,
                count: &count,
            })?;
            place.note(&scenario.selected.id(), &part)
        };
        let work = || -> Result<()> {
            while !has_failed.load(Ordering::Relaxed)
                && let Some(scenario) = pending.get(next.fetch_add(1, Ordering::Relaxed))
            {
                write(scenario).inspect_err(|_| has_failed.store(true, Ordering::Relaxed))?;
            }
            Ok(())
        };
        let cores = thread::available_parallelism().map_or(1, usize::from);
        workers::share(cores.min(pending.len()), work)
    }
}

/// The name of the detections that are wanted or stand beside the ground-truth boxes.
fn model_of(selection: &[Selected], request: &ExportRequest) -> Result<Option<String>> {
    match request.format.abilities().boxes {
        BoxUse::None => return Ok(None),
        // It has no place for detections beside the ground-truth boxes.
        BoxUse::Certain if request.boxes == BoxSource::Truth => return Ok(None),
        _ => {}
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

#[cfg(test)]
mod tests {
    use std::fs;
    use std::num::NonZeroU32;
    use std::sync::atomic::AtomicU64;

    use dataset::numbers::frame_rate::FrameRate;
    use dataset::work::watch::Silent;
    use testkit::files::contents;
    use testkit::short_corpus;
    use testkit::watch::Calls;

    use super::*;
    use crate::request::{Format, Ticks};

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

    fn request(format: Format, every: u32) -> ExportRequest {
        ExportRequest {
            views: Some(vec!["right".into()]),
            ticks: Ticks::Every(NonZeroU32::new(every).unwrap()),
            crop_px: (format == Format::Crops).then_some([48, 32]),
            ..ExportRequest::whole(format)
        }
    }

    /// Exports; is stopped after `most` checks.
    fn export_until(
        corpus: &Corpus,
        format: Format,
        out: &Path,
        most: u64,
    ) -> Result<ExportOutcome> {
        let asked = AtomicU64::new(0);
        let watch = Calls {
            advance: |_| {},
            is_stopped: || asked.fetch_add(1, Ordering::Relaxed) >= most,
        };
        export(corpus, &request(format, 1), out, &watch)
    }

    #[test]
    fn pictures_hold_exactly_the_decoded_pixels() {
        let temporary = tempfile::tempdir().unwrap();
        let corpus = corpus(&temporary.path().join("corpus"));
        labeller::label_corpus(&corpus, &Silent).unwrap();
        let out = temporary.path().join("out");
        let outcome = export(&corpus, &request(Format::Coco, 2), &out, &Silent).unwrap();
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
        assert_eq!(
            dataset::corpus::seal::faults(&out).unwrap(),
            Vec::<String>::new()
        );
    }

    #[test]
    fn an_export_that_was_stopped_goes_on_and_becomes_what_it_would_have_been() {
        let temporary = tempfile::tempdir().unwrap();
        let corpus = corpus(&temporary.path().join("corpus"));
        labeller::label_corpus(&corpus, &Silent).unwrap();
        for format in [
            Format::Coco,
            Format::Yolo,
            Format::HuggingFace,
            Format::WebDataset,
            Format::Crops,
            Format::Mcap,
            Format::LeRobot,
        ] {
            let name = format.abilities().word;
            let straight = temporary.path().join(format!("{name}-straight"));
            let whole = export_until(&corpus, format, &straight, u64::MAX).unwrap();
            let out = temporary.path().join(name);
            for most in [0, 2, 0] {
                let stopped = export_until(&corpus, format, &out, most).unwrap_err();
                assert!(matches!(stopped, Error::Stopped(_)), "{name}: {stopped}");
                assert!(
                    !out.exists(),
                    "{name}: something is under the final name before it is whole"
                );
            }
            let resumed = export_until(&corpus, format, &out, u64::MAX).unwrap();
            assert_eq!(resumed, whole, "{name}");
            assert!(contents(&out) == contents(&straight), "{name}");
            assert!(!temporary.path().join(format!("{name}.partial")).exists());
        }
    }

    #[test]
    fn scenarios_of_two_rates_or_without_labels_do_not_become_a_lerobot_dataset() {
        let temporary = tempfile::tempdir().unwrap();
        let root = temporary.path().join("corpus");
        for (id, hz) in [("0001-a", 1), ("0002-b", 2)] {
            let rate = FrameRate::new(hz, 1).unwrap();
            short_corpus::write_flight(&root, id, SIZE_PX, rate, 3, &|_, _, _| {});
        }
        let corpus = Corpus::open(&root).unwrap();
        let out = temporary.path().join("out");
        let refused = || {
            let error = export_until(&corpus, Format::LeRobot, &out, u64::MAX).unwrap_err();
            assert!(!out.exists() && !temporary.path().join("out.partial").exists());
            error.to_string()
        };
        assert!(refused().contains("`dtd label`"), "{}", refused());
        labeller::label_corpus(&corpus, &Silent).unwrap();
        let words = "0002-b has 2 images per second, right of 160x96";
        assert!(refused().contains(words), "{}", refused());
        let one = ExportRequest {
            only: Some(vec!["0002-b".into()]),
            ..request(Format::LeRobot, 1)
        };
        assert_eq!(export(&corpus, &one, &out, &Silent).unwrap().pictures, 3);
    }

    #[test]
    fn notes_of_an_export_that_was_moved_before_a_kill_do_not_stand_for_pictures() {
        let temporary = tempfile::tempdir().unwrap();
        let corpus = corpus(&temporary.path().join("corpus"));
        labeller::label_corpus(&corpus, &Silent).unwrap();
        let out = temporary.path().join("out");
        export_until(&corpus, Format::Coco, &out, 4).unwrap_err();
        // As a kill between the move and the removal of the notes leaves it, and the user then removes the export.
        let partial = temporary.path().join("out.partial");
        fs::remove_dir_all(partial.join("new")).unwrap();
        let whole = export_until(&corpus, Format::Coco, &out, u64::MAX).unwrap();
        let pictures = fs::read_dir(out.join("images")).unwrap().count();
        assert_eq!(pictures as u64, whole.pictures);
    }
}
