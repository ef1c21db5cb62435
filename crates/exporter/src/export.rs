//! Makes an export: views are decoded in parallel, scenarios noted as they are done, and the whole sealed at the end.

use std::collections::BTreeSet;
use std::mem;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::thread;

use dataset::corpus::Corpus;
use dataset::corpus::detections::{NoChoice, choose};
use dataset::corpus::splits::Side;
use dataset::work::watch::Watch;
use dataset::work::workers;
use serde::Serialize;

use crate::about::About;
use crate::destination::{Destination, UnfinishedExport, refuse_corpus};
use crate::error::{Error, Result};
use crate::file_format::{Export, FileFormat, PlannedScenario, Writing, Written};
use crate::formats;
use crate::request::{BoxSource, BoxUse, ExportRequest};
use crate::scenarios::{LostScenario, Selected, Source, is_searched, select};

/// Export counts and remarks.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct ExportOutcome {
    /// Number of scenarios.
    pub scenarios: u64,
    /// Number of images.
    pub pictures: u64,
    /// Number of boxes.
    pub boxes: u64,
    /// Selected images that were left out ([`Format::left_out`](crate::Format::left_out) says why): in a format that cannot say that an
    /// aircraft may be hidden by a cloud or is mostly outside the image, and of ticks at which a view has no crop.
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

/// Exports a corpus to `out`. The same request resumes a run that was stopped or killed.
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
    let mut format = formats::implementation(request.format);
    let abilities = format.abilities();
    request.check(&abilities)?;
    refuse_corpus(corpus, out)?;
    let (mut selection, mut lost) = select(corpus, request)?;
    let model = model_of(&selection, request, abilities.boxes)?;
    if let (BoxSource::Detections, Some(model)) = (request.boxes, &model) {
        lost.extend(without_unsearched(&mut selection, model)?);
    }
    for LostScenario { id, reason } in &lost {
        watch.warn(&format!("scenario {id} is left out: {reason}"));
    }
    let mut export = Export {
        request,
        abilities,
        model,
        scenarios: Vec::new(),
        sides: BTreeSet::new(),
        about: About::new(corpus, request.license.clone())?,
    };
    format.prepare(&export)?;
    let mut outcome = ExportOutcome {
        lost,
        ..ExportOutcome::default()
    };
    let mut hasher = blake3::Hasher::new();
    hasher.update(env!("CARGO_PKG_VERSION").as_bytes());
    hasher.update(&serde_json::to_vec(request).unwrap_or_default());
    hasher.update(export.about.name.as_bytes());
    format.hash(&mut hasher);
    export.check(selection, &mut *format, &mut hasher, &mut outcome, watch)?;
    let unfinished = match UnfinishedExport::take(out, hasher.finalize().to_hex().as_str())? {
        Destination::Complete { bytes } => {
            return Ok(ExportOutcome {
                bytes,
                unchanged: true,
                ..outcome
            });
        }
        Destination::Unfinished(unfinished) => unfinished,
    };
    let written = export
        .write_scenarios(&*format, &unfinished, outcome.pictures, watch)
        .and_then(|()| {
            format.finish(&Written {
                export: &export,
                unfinished: &unfinished,
                watch,
            })
        });
    match written {
        Ok(()) => Ok(ExportOutcome {
            bytes: unfinished.finish()?,
            ..outcome
        }),
        Err(error) => {
            if error.is_fault_of_corpus() {
                // If that fails as well, the fault of the corpus is still the one to report.
                let _ = unfinished.abandon();
            }
            Err(error)
        }
    }
}

/// Removes the scenarios that the model has not searched: without boxes, their images would say that there is no aircraft.
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
    /// Checks and counts the selected scenarios, and adds them to the identity of the export.
    fn check(
        &mut self,
        selection: Vec<Selected>,
        format: &mut dyn FileFormat,
        hasher: &mut blake3::Hasher,
        outcome: &mut ExportOutcome,
        watch: &dyn Watch,
    ) -> Result<()> {
        for selected in selection {
            watch.check()?;
            let source = self.open(&selected)?;
            format.check(&source, self)?;
            let before = outcome.pictures;
            count(&source, outcome);
            source.hash(hasher);
            self.about.add(&source.record, source.model.as_deref());
            // A side without images would have a name in data.yaml, and no folder.
            if outcome.pictures > before {
                self.sides.insert(selected.side.unwrap_or(Side::Train));
            }
            self.scenarios.push(PlannedScenario {
                selected,
                pictures: outcome.pictures - before,
            });
        }
        if self.abilities.boxes == BoxUse::Crops && outcome.pictures == 0 {
            return Err(Error::Request(
                "nothing to export: at no tick of the selected scenarios has each view a box; choose views with --views, or other boxes \
                 with --boxes"
                    .to_owned(),
            ));
        }
        outcome.remark = format.check_all(self)?;
        Ok(())
    }

    /// Writes all scenarios that are not noted as done, and notes them.
    fn write_scenarios(
        &self,
        format: &dyn FileFormat,
        unfinished: &UnfinishedExport,
        total: u64,
        watch: &dyn Watch,
    ) -> Result<()> {
        watch.begin("", total);
        let done = AtomicU64::new(0);
        let count = |pictures: u64| {
            let done = done.fetch_add(pictures, Ordering::Relaxed) + pictures;
            watch.advance(done, "");
        };
        let (noted, pending): (Vec<_>, Vec<_>) = self
            .scenarios
            .iter()
            .partition(|scenario| unfinished.has_part(&scenario.selected.id()));
        count(
            noted
                .iter()
                .map(|scenario: &&PlannedScenario| scenario.pictures)
                .sum(),
        );
        let next = AtomicUsize::new(0);
        let has_failed = AtomicBool::new(false);
        let write = |scenario: &PlannedScenario| {
            let part = format.write(&Writing {
                export: self,
                source: self.open(&scenario.selected)?,
                folder: unfinished.files(),
                watch,
                count: &count,
            })?;
            unfinished.note(&scenario.selected.id(), &part)
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
fn model_of(
    selection: &[Selected],
    request: &ExportRequest,
    boxes: BoxUse,
) -> Result<Option<String>> {
    match boxes {
        // It has no place for detections beside the ground-truth boxes.
        BoxUse::Certain if request.boxes == BoxSource::Truth => return Ok(None),
        _ => {}
    }
    let folders: Vec<_> = selection.iter().map(|one| one.folder.clone()).collect();
    let asked = request.detections.as_deref();
    match choose(&folders, asked)? {
        Ok(chosen) => Ok(Some(chosen.hash)),
        Err(_) if request.boxes == BoxSource::Truth && asked.is_none() => Ok(None),
        Err(NoChoice::None) => Err(Error::Request(
            "the selected scenarios have no detections; run `dtd detect` on the corpus first"
                .to_owned(),
        )),
        Err(NoChoice::Others(known)) => {
            Err(Error::unknown("model", asked.unwrap_or_default(), &known))
        }
        Err(NoChoice::Several(known)) => Err(Error::Request(format!(
            "the corpus has the detections of several models: {known}; choose one with --detections"
        ))),
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
    use crate::request::Format;

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
            every: NonZeroU32::new(every).unwrap(),
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
    fn ticks_far_apart_have_the_pixels_of_their_images() {
        let temporary = tempfile::tempdir().unwrap();
        let rate = FrameRate {
            numerator: 1,
            denominator: 1,
        };
        let paint = |_: &str, tick: u32, rgb: &mut [u8]| rgb.fill(tick as u8 + 50);
        let root = temporary.path().join("corpus");
        let corpus = short_corpus::write_flight(&root, "0001-a", SIZE_PX, rate, 100, &paint);
        labeller::label_corpus(&corpus, &Silent).unwrap();
        let out = temporary.path().join("out");
        let outcome = export(&corpus, &request(Format::Coco, 45), &out, &Silent).unwrap();
        assert_eq!(outcome.pictures, 3, "ticks 0, 45 and 90");
        let mut reader = corpus
            .scenario("0001-a")
            .open()
            .unwrap()
            .open_video("right")
            .unwrap();
        let mut rgb = Vec::new();
        for tick in 0..100 {
            reader.next_frame(&mut rgb).unwrap().unwrap();
            let path = out.join(format!("images/0001-a_right_{tick:06}.png"));
            if tick % 45 == 0 {
                assert!(
                    image::open(&path).unwrap().into_rgb8().into_raw() == rgb,
                    "tick {tick}"
                );
            }
        }
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
        ] {
            let name = formats::implementation(format).abilities().word;
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
