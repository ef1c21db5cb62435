//! What is wrong with a sweep, and where.

use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// An invalid sweep. It prints as `scenarios.toml:12:9: what was found and what was expected`.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub struct SweepError {
    /// The file.
    pub file: PathBuf,
    /// Line and column, from 1, if the fault has a position in the file.
    pub place: Option<(usize, usize)>,
    /// What was found, what was expected, what to do.
    pub message: String,
}

impl fmt::Display for SweepError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.file.display())?;
        if let Some((line, column)) = self.place {
            write!(f, ":{line}:{column}")?;
        }
        write!(f, ": {}", self.message)
    }
}

impl SweepError {
    pub(super) fn unreadable(file: &Path, source: &dataset::Error) -> Self {
        Self {
            file: file.to_owned(),
            place: None,
            message: format!("cannot read the sweep: {source}"),
        }
    }

    pub(super) fn at(file: &Path, text: &str, span: Option<Range<usize>>, message: &str) -> Self {
        Self {
            file: file.to_owned(),
            place: span.map(|span| line_and_column(text, span.start)),
            message: message.replace('\n', "; "),
        }
    }
}

fn line_and_column(text: &str, offset: usize) -> (usize, usize) {
    let before = text.get(..offset).unwrap_or(text);
    let line = before.matches('\n').count() + 1;
    let column = before.chars().rev().take_while(|c| *c != '\n').count() + 1;
    (line, column)
}
