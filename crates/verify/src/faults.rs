//! Faults, as they are collected and reported.

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

use dataset::corpus::Corpus;
use dataset::error::{Error, Result};
use dataset::numbers::limits::FieldOutOfLimits;
use dataset::plain::one_line;
use dataset::tables::columns::ColumnOutOfLimits;
use serde::Serialize;

/// Tolerance of a recomputed length or place, metres. Trigonometry differs in its last digits between machines: nanometres.
pub(crate) const LENGTH_TOLERANCE_M: f64 = 1e-4;
/// Tolerance of a recomputed rotation, radians, and of a recomputed intrinsic, as a part of it.
pub(crate) const RELATIVE_TOLERANCE: f64 = 1e-10;
/// Maximum number of listed rows per kind of fault; the others are counted.
pub(crate) const ROWS_LISTED: usize = 3;

/// A fault that verification found.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// Identifier of the scenario; missing if the fault concerns the whole corpus.
    pub scenario: Option<String>,
    /// File, relative to the scenario's folder or to the corpus.
    pub file: String,
    /// Row of the table or image of the video, from 0.
    pub row: Option<u64>,
    /// Identifier of the view, if the fault concerns one.
    pub view: Option<String>,
    /// Found and expected values.
    pub message: String,
}

impl fmt::Display for Finding {
    /// Names of files and folders are on one line, whatever a foreign corpus calls them.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let file = one_line(&self.file);
        match self.scenario.as_deref().map(one_line) {
            // A file of the whole corpus: no such file is in the scenario's folder.
            Some(scenario) if Corpus::FILES.contains(&self.file.as_str()) => {
                write!(f, "{file} scenario {scenario}")?;
            }
            Some(scenario) => write!(f, "{scenario}/{file}")?,
            None => write!(f, "{file}")?,
        }
        if let Some(row) = self.row {
            write!(f, " row {row}")?;
        }
        if let Some(view) = &self.view {
            write!(f, " view {}", one_line(view))?;
        }
        write!(f, ": {}", self.message)
    }
}

/// Collects the faults of one scenario or of the corpus's own files.
#[derive(Default)]
pub(crate) struct Faults {
    scenario: Option<String>,
    pub(crate) findings: Vec<Finding>,
    /// Number of rows per file and kind of fault.
    rows: BTreeMap<(String, &'static str), usize>,
}

impl Faults {
    pub(crate) fn of_scenario(id: &str) -> Self {
        Self {
            scenario: Some(id.to_owned()),
            ..Self::default()
        }
    }

    /// A fault of a whole file.
    pub(crate) fn file(&mut self, file: &str, message: impl ToString) {
        self.push(file, None, None, message.to_string());
    }

    /// A file that cannot be read.
    pub(crate) fn error(&mut self, file: &str, error: &Error) {
        let path = Path::new(self.scenario.as_deref().unwrap_or_default()).join(file);
        self.file(file, error.beside(&path));
    }

    /// A fault of a file that concerns one scenario, where many are checked together.
    pub(crate) fn of(&mut self, scenario: &str, file: &str, message: impl ToString) {
        self.add(Some(scenario), file, None, None, message.to_string());
    }

    /// A fault of one view of a scenario.
    pub(crate) fn of_view(
        &mut self,
        scenario: &str,
        file: &str,
        view: &str,
        message: impl ToString,
    ) {
        self.add(Some(scenario), file, None, Some(view), message.to_string());
    }

    /// A fault of one whole view.
    pub(crate) fn view(&mut self, file: &str, view: &str, message: impl ToString) {
        self.push(file, None, Some(view), message.to_string());
    }

    /// A fault of a row. `kind` groups faults that tend to occur in large numbers.
    pub(crate) fn row(
        &mut self,
        file: &str,
        row: usize,
        kind: &'static str,
        message: impl fmt::Display,
    ) {
        self.row_of(None, file, row, kind, message);
    }

    /// A fault of a row whose length, metres, is not the expected one, or is there where none is expected.
    pub(crate) fn compare_m(
        &mut self,
        file: &str,
        row: usize,
        kind: &'static str,
        [found, expected]: [Option<f64>; 2],
        tolerance_m: f64,
    ) {
        let is_same = match (found, expected) {
            (Some(found), Some(expected)) => close(found, expected, tolerance_m),
            (found, expected) => found == expected,
        };
        if !is_same {
            let [found, expected] = [found, expected].map(|length_m| {
                length_m.map_or("null".into(), |length_m| format!("{length_m:.6}"))
            });
            let message = format!("is {found}, expected {expected}");
            self.row(file, row, kind, message);
        }
    }

    /// A fault of a row that concerns one view.
    pub(crate) fn view_row(
        &mut self,
        view: &str,
        file: &str,
        row: usize,
        kind: &'static str,
        message: impl fmt::Display,
    ) {
        self.row_of(Some(view), file, row, kind, message);
    }

    fn row_of(
        &mut self,
        view: Option<&str>,
        file: &str,
        row: usize,
        kind: &'static str,
        message: impl fmt::Display,
    ) {
        let count = self.rows.entry((file.to_owned(), kind)).or_default();
        *count += 1;
        if *count <= ROWS_LISTED {
            self.push(file, Some(row as u64), view, format!("{kind}: {message}"));
        }
    }

    /// The value, or a fault of the file that should contain it.
    pub(crate) fn keep<T>(&mut self, file: &str, read: Result<T>) -> Option<T> {
        read.map_err(|error| self.error(file, &error)).ok()
    }

    /// A record that was read, with the fields outside their limits as faults.
    pub(crate) fn keep_with<T>(
        &mut self,
        file: &str,
        read: Result<(T, Vec<FieldOutOfLimits>)>,
    ) -> Option<T> {
        let (value, outside) = self.keep(file, read)?;
        outside.iter().for_each(|fault| self.file(file, fault));
        Some(value)
    }

    /// A table that was read, with the numbers outside their limits as faults.
    pub(crate) fn keep_table<T>(
        &mut self,
        file: &str,
        read: Result<(T, Vec<ColumnOutOfLimits>)>,
    ) -> Option<T> {
        let (value, outside) = self.keep(file, read)?;
        for ColumnOutOfLimits {
            column,
            first,
            count,
        } in outside
        {
            for (row, number) in &first {
                self.push(file, Some(*row as u64), None, format!("{column} {number}"));
            }
            if count > first.len() {
                let more = count - first.len();
                self.file(
                    file,
                    format!("{column} is out of range in {more} more rows"),
                );
            }
        }
        Some(value)
    }

    fn push(&mut self, file: &str, row: Option<u64>, view: Option<&str>, message: String) {
        let scenario = self.scenario.clone();
        self.add(scenario.as_deref(), file, row, view, message);
    }

    fn add(
        &mut self,
        scenario: Option<&str>,
        file: &str,
        row: Option<u64>,
        view: Option<&str>,
        message: String,
    ) {
        self.findings.push(Finding {
            scenario: scenario.map(str::to_owned),
            file: file.to_owned(),
            row,
            view: view.map(str::to_owned),
            message,
        });
    }

    pub(crate) fn into_findings(mut self) -> Vec<Finding> {
        for ((file, kind), count) in std::mem::take(&mut self.rows) {
            if count > ROWS_LISTED {
                self.push(
                    &file,
                    None,
                    None,
                    format!("{kind}: {} more rows", count - ROWS_LISTED),
                );
            }
        }
        self.findings
    }
}

/// True if two numbers are equal except for rounding; false if one of them is NaN.
pub(crate) fn close(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() <= tolerance
}
