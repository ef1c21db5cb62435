//! Verifies a corpus and names every fault by scenario, file, row and view.
//!
//! Input: a corpus folder. Output: a [`VerifyReport`]. No earlier check and no correct hash is trusted: hashes are recomputed, every image
//! is decoded again, echoed poses and cameras are compared with the poses and the calibration, labels are recomputed from the poses, and
//! the ground-truth boxes are compared with the pixels ([`pixels`]): is the aircraft in them, at the time that the table states, and does
//! it move when it should?
//!
//! Pixels cannot decide everything; the seal covers the rest: whether an image whose aircraft is hidden by fog is the right one, and
//! whether an image was doubled while the aircraft moved by less than a pixel.

mod against;
mod aircraft;
mod corpus_files;
mod detections;
mod faults;
mod frames;
mod labels;
pub mod pixels;
mod planned_cameras;
mod record;
mod recorded;
mod videos;

use std::collections::BTreeMap;
use std::fmt;

use serde::Serialize;

pub use against::against;
use dataset::corpus::calibration::Calibration;
use dataset::corpus::effective_weather::ReportedWeather;
use dataset::corpus::scenario::{Graphics, ScenarioRecord};
use dataset::corpus::seal;
use dataset::corpus::{Corpus, ScenarioFolder};
use dataset::work::watch::{Silent, Stopped, Watch};
use faults::Faults;
pub use faults::Finding;
use pixels::{PairProof, ViewProof};

/// Thoroughness of the verification.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VerifyOptions {
    /// Decode the videos. Without it everything else is checked, in a fraction of the time.
    pub decode: bool,
    /// A planned scenario that is missing is a fault. Otherwise it is only counted: a corpus may be verified while it is recorded.
    pub complete: bool,
}

impl Default for VerifyOptions {
    fn default() -> Self {
        Self {
            decode: true,
            complete: false,
        }
    }
}

/// Counts of checked items, and the findings.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct VerifyReport {
    /// Number of scenarios checked.
    pub scenarios: usize,
    /// Planned scenarios that do not exist (yet).
    pub missing: Vec<String>,
    /// Checks for which the corpus has no file, with that file.
    pub not_checked: Vec<String>,
    /// Ticks of all scenarios.
    pub ticks: u64,
    /// Images decoded.
    pub pictures: u64,
    /// Scenarios that have labels.
    pub labelled: usize,
    /// The evidence from the images, per scenario and view.
    pub views: Vec<ViewProof>,
    /// Lags between the views, per scenario and pair of views.
    pub pairs: Vec<PairProof>,
    /// Weather reported at the aircraft, by the planned weather's name. A marked scenario is no fault: its record states the drawn weather.
    pub weather: BTreeMap<String, ReportedWeather>,
    /// Graphics settings that changed between scenarios: no faults, but their images may differ.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub graphics: Vec<String>,
    /// All faults; empty if the corpus is valid.
    pub findings: Vec<Finding>,
}

impl VerifyReport {
    /// True if there are no faults.
    pub fn is_sound(&self) -> bool {
        self.findings.is_empty()
    }

    /// The scenarios that were drawn under a different weather than planned, with the differences.
    pub fn marked(&self) -> impl Iterator<Item = (&str, &[String])> {
        let marked = self.weather.values().flat_map(|weather| &weather.marked);
        marked.map(|(id, differences)| (id.as_str(), differences.as_slice()))
    }
}

/// Verifies a corpus.
pub fn verify(corpus: &Corpus) -> VerifyReport {
    verify_with(corpus, VerifyOptions::default(), &Silent).expect("`Silent` stops nothing")
}

/// Verifies a corpus; the watch counts its scenarios.
///
/// # Errors
/// The watch stopped it.
pub fn verify_with(
    corpus: &Corpus,
    options: VerifyOptions,
    watch: &dyn Watch,
) -> std::result::Result<VerifyReport, Stopped> {
    let mut verification = Verification::new(options, watch);
    // One folder that cannot be read must not hide the others.
    let folders = verification.faults.keep("scenarios", corpus.folders());
    let mut scenarios = folders.unwrap_or_default();
    scenarios.retain(|folder| !matches!(folder.seal(), Ok(None)));
    watch.begin("", scenarios.len() as u64);
    for (done, folder) in scenarios.iter().enumerate() {
        watch.advance(done as u64, &folder.id());
        verification.add(folder.clone())?;
    }
    watch.advance(scenarios.len() as u64, "");
    Ok(verification.finish(corpus))
}

/// A verification scenario by scenario, for a corpus whose scenarios are never all there at once.
pub struct Verification<'w> {
    options: VerifyOptions,
    watch: &'w dyn Watch,
    report: VerifyReport,
    /// Faults of the corpus's own files.
    faults: Faults,
    scenarios: Vec<ScenarioFolder>,
    records: BTreeMap<String, ScenarioRecord>,
    calibrations: BTreeMap<String, Calibration>,
}

impl<'w> Verification<'w> {
    /// A verification that has not checked any scenario yet. Only the cancellation of `watch` is used.
    pub fn new(options: VerifyOptions, watch: &'w dyn Watch) -> Self {
        Self {
            options,
            watch,
            report: VerifyReport::default(),
            faults: Faults::default(),
            scenarios: Vec::new(),
            records: BTreeMap::new(),
            calibrations: BTreeMap::new(),
        }
    }

    /// Verifies a scenario. Its videos are not needed any more afterwards.
    ///
    /// # Errors
    /// The watch stopped it: this scenario, and so the report, is incomplete.
    pub fn add(&mut self, folder: ScenarioFolder) -> std::result::Result<(), Stopped> {
        let id = folder.id();
        let (read, faults) =
            verify_undisturbed(&folder, self.options, &mut self.report, self.watch);
        self.watch.check()?;
        if let Some((record, calibration)) = read {
            let calibration = calibration.map(|calibration| (id.clone(), calibration));
            self.calibrations.extend(calibration);
            self.records.insert(id, record);
        }
        self.report.scenarios += 1;
        self.report.findings.extend(faults.into_findings());
        self.scenarios.push(folder);
        Ok(())
    }

    /// Records a scenario that could not even be read, with its files' faults.
    pub fn add_unreadable<'a>(
        &mut self,
        id: &str,
        faults: impl IntoIterator<Item = (&'a str, String)>,
    ) {
        self.report.scenarios += 1;
        for (file, reason) in faults {
            self.add_fault(id, file, reason);
        }
    }

    /// Records a file's fault that was found elsewhere, such as on the way here.
    pub fn add_fault(&mut self, id: &str, file: &str, reason: impl fmt::Display) {
        let mut faults = Faults::of_scenario(id);
        faults.file(file, reason);
        self.report.findings.extend(faults.into_findings());
    }

    /// Verifies the files of the whole corpus.
    pub fn finish(mut self, corpus: &Corpus) -> VerifyReport {
        self.report.weather = ReportedWeather::by_name(self.records.values());
        let records = self.records.iter();
        self.report.graphics = Graphics::changes(
            records.filter_map(|(id, record)| Some((&**id, record.graphics.as_ref()?))),
        );
        let found = corpus_files::ReadScenarios {
            scenarios: &self.scenarios,
            records: &self.records,
            calibrations: &self.calibrations,
        };
        let (options, report) = (self.options, &mut self.report);
        corpus_files::check(corpus, &found, options, report, &mut self.faults);
        self.report.findings.extend(self.faults.into_findings());
        self.report
    }
}

/// Verifies a scenario, again if it changed in the meantime and seems to have faults.
fn verify_undisturbed(
    folder: &ScenarioFolder,
    options: VerifyOptions,
    report: &mut VerifyReport,
    watch: &dyn Watch,
) -> (Option<(ScenarioRecord, Option<Calibration>)>, Faults) {
    let before = report.clone();
    loop {
        let seal = folder.seal().ok();
        let mut faults = Faults::of_scenario(&folder.id());
        let read = verify_scenario(folder, options, &mut faults, report, watch);
        if faults.findings.is_empty() || folder.seal().ok() == seal || watch.is_stopped() {
            return (read, faults);
        }
        report.clone_from(&before);
    }
}

fn verify_scenario(
    folder: &ScenarioFolder,
    options: VerifyOptions,
    faults: &mut Faults,
    report: &mut VerifyReport,
    watch: &dyn Watch,
) -> Option<(ScenarioRecord, Option<Calibration>)> {
    match seal::faults(folder.root()) {
        Ok(found) => found
            .into_iter()
            .for_each(|message| faults.file(seal::MANIFEST, message)),
        Err(error) => faults.error(seal::MANIFEST, &error),
    }
    // Each file is read, whatever is wrong with the others, and then compared with those that could be read.
    let record = record::read(folder, faults);
    let calibration = record::read_calibration(folder, faults);
    let frames = frames::read(folder, faults);
    let most_boxes = record.as_ref().map(ScenarioRecord::max_truth_boxes);
    let boxes = labels::read_boxes(folder, frames.as_ref(), most_boxes, faults);
    report.ticks += frames.as_ref().map_or(0, |frames| frames.rows.len() as u64);
    if let (Some(frames), Some(calibration)) = (&frames, &calibration) {
        frames::check_cameras(frames, calibration, faults);
    }
    detections::check(folder, record.as_ref(), faults);
    let record = record?;
    record::check(folder, &record, faults);
    if let Some(calibration) = &calibration {
        record::check_calibration(&record, calibration, faults);
    }
    let rows = aircraft::read(folder, &record, faults);
    if let Some(frames) = &frames {
        frames::check(&record, frames, faults);
        if let Some(rows) = &rows {
            aircraft::check(&record, frames, rows, faults);
        }
        if labels::check(&record, frames, faults) {
            report.labelled += 1;
        }
        if let (Some(boxes), Some(calibration)) = (&boxes, &calibration) {
            let flown = (frames, rows.as_deref());
            labels::check_boxes(&record, flown, boxes, calibration, faults);
        }
    }
    if record.recorded.is_some() {
        let read = (frames.as_ref(), calibration.as_ref());
        recorded::check(folder, &record, read, faults);
        recorded::name_unchecked(&mut report.not_checked);
    }
    if options.decode && record.recorded.is_none() {
        let scenario = pixels::Scenario {
            record: &record,
            frames: frames.as_ref(),
            boxes: boxes.as_deref().unwrap_or_default(),
            calibration: calibration.as_ref(),
        };
        let proofs = videos::check(folder, &scenario, faults, watch);
        report.pictures += proofs.pictures;
        report.views.extend(proofs.views);
        report.pairs.extend(proofs.pairs);
    }
    Some((record, calibration))
}

#[cfg(test)]
mod tests;
