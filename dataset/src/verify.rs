//! Proves a corpus, or names every fault of it by scenario, file and row.
//!
//! Goes in: a corpus folder. Comes out: a [`VerifyReport`]. Nothing is trusted because it was checked when it was made: hashes are
//! computed again, videos are decoded again, echoed poses and cameras are compared with the poses and the calibration, and
//! labels are computed again from the poses.

mod corpus_files;
mod frames;
mod labels;
mod record;
mod videos;

use std::collections::BTreeMap;
use std::fmt;

use serde::Serialize;

use crate::calibration::Calibration;
use crate::corpus::{Corpus, ScenarioFolder};
use crate::error::Result;
use crate::frames::Frames;
use crate::scenario::ScenarioRecord;
use crate::seal;

/// So many rows of one kind of fault are listed; the others are counted.
const ROWS_LISTED: usize = 3;

/// One fault.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// Identifier of the scenario; missing if the fault is of the whole corpus.
    pub scenario: Option<String>,
    /// File, relative to the scenario's folder or to the corpus.
    pub file: String,
    /// Row of the table or picture of the video, from 0.
    pub row: Option<u64>,
    /// What was found and what was expected.
    pub message: String,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(scenario) = &self.scenario {
            write!(f, "{scenario}/")?;
        }
        write!(f, "{}", self.file)?;
        if let Some(row) = self.row {
            write!(f, " row {row}")?;
        }
        write!(f, ": {}", self.message)
    }
}

/// What was checked and what was found.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct VerifyReport {
    /// Scenarios looked at.
    pub scenarios: usize,
    /// Ticks of all of them.
    pub ticks: u64,
    /// Pictures decoded.
    pub pictures: u64,
    /// Scenarios that have labels.
    pub labelled: usize,
    /// All faults; empty if the corpus is sound.
    pub findings: Vec<Finding>,
}

impl VerifyReport {
    /// Whether nothing is wrong.
    pub fn is_sound(&self) -> bool {
        self.findings.is_empty()
    }
}

/// Verifies a corpus.
pub fn verify(corpus: &Corpus) -> VerifyReport {
    verify_with_progress(corpus, &mut |_, _| {})
}

/// Verifies a corpus and says which scenario is next, and how many there are.
pub fn verify_with_progress(corpus: &Corpus, next: &mut dyn FnMut(&str, usize)) -> VerifyReport {
    let mut report = VerifyReport::default();
    let scenarios = match corpus.scenarios() {
        Ok(scenarios) => scenarios,
        Err(error) => {
            let file = "scenarios".into();
            report.findings.push(Finding {
                scenario: None,
                file,
                row: None,
                message: error.to_string(),
            });
            return report;
        }
    };
    let mut records = BTreeMap::new();
    for folder in &scenarios {
        next(&folder.id(), scenarios.len());
        let mut faults = Faults::of_scenario(folder.id());
        if let Some(record) = verify_scenario(folder, &mut faults, &mut report) {
            records.insert(folder.id(), record);
        }
        report.scenarios += 1;
        report.findings.extend(faults.into_findings());
    }
    let mut faults = Faults::of_corpus();
    corpus_files::check(corpus, &scenarios, &records, &mut faults);
    report.findings.extend(faults.into_findings());
    report
}

fn verify_scenario(
    folder: &ScenarioFolder,
    faults: &mut Faults,
    report: &mut VerifyReport,
) -> Option<ScenarioRecord> {
    match seal::faults(folder.root()) {
        Ok(found) => found
            .into_iter()
            .for_each(|message| faults.file(seal::MANIFEST, message)),
        Err(error) => faults.file(seal::MANIFEST, error),
    }
    let record: ScenarioRecord = faults.keep("scenario.json", folder.record())?;
    record::check(&folder.id(), &record, faults);
    let calibration: Option<Calibration> = faults.keep("calibration.json", folder.calibration());
    if let Some(calibration) = &calibration {
        record::check_calibration(&record, calibration, faults);
    }
    let frames: Option<Frames> = faults.keep(ScenarioFolder::FRAMES, folder.frames());
    if let Some(frames) = &frames {
        report.ticks += frames.rows.len() as u64;
        frames::check(&record, frames, faults);
        if let Some(calibration) = &calibration {
            frames::check_cameras(frames, calibration, faults);
        }
        if labels::check(folder, &record, frames, calibration.as_ref(), faults) {
            report.labelled += 1;
        }
    }
    report.pictures += videos::check(folder, &record, calibration.as_ref(), faults);
    Some(record)
}

/// Whether two numbers are the same but for rounding; never, if one of them is not a number.
fn close(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() <= tolerance
}

/// Collects the faults of one scenario or of the corpus's own files.
struct Faults {
    scenario: Option<String>,
    findings: Vec<Finding>,
    /// Rows found per file and kind of fault.
    rows: BTreeMap<(String, &'static str), usize>,
}

impl Faults {
    fn of_scenario(id: String) -> Self {
        Self {
            scenario: Some(id),
            findings: Vec::new(),
            rows: BTreeMap::new(),
        }
    }

    fn of_corpus() -> Self {
        Self {
            scenario: None,
            findings: Vec::new(),
            rows: BTreeMap::new(),
        }
    }

    /// A fault of a whole file.
    fn file(&mut self, file: &str, message: impl ToString) {
        self.push(file, None, message.to_string());
    }

    /// A fault of a row. `kind` groups faults that are likely to come in crowds.
    fn row(&mut self, file: &str, row: usize, kind: &'static str, message: impl fmt::Display) {
        let count = self.rows.entry((file.to_owned(), kind)).or_default();
        *count += 1;
        if *count <= ROWS_LISTED {
            self.push(file, Some(row as u64), format!("{kind}: {message}"));
        }
    }

    /// The value, or a fault of the file that should hold it.
    fn keep<T>(&mut self, file: &str, read: Result<T>) -> Option<T> {
        read.map_err(|error| self.file(file, error)).ok()
    }

    fn push(&mut self, file: &str, row: Option<u64>, message: String) {
        self.findings.push(Finding {
            scenario: self.scenario.clone(),
            file: file.to_owned(),
            row,
            message,
        });
    }

    fn into_findings(mut self) -> Vec<Finding> {
        for ((file, kind), count) in std::mem::take(&mut self.rows) {
            if count > ROWS_LISTED {
                self.push(
                    &file,
                    None,
                    format!("{kind}: {} more rows", count - ROWS_LISTED),
                );
            }
        }
        self.findings
    }
}

#[cfg(test)]
mod tests;
