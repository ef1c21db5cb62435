//! Prediction table columns: `scenario`, `tick`, optionally `detections`, and per estimator `NAME_dtd_m`, optionally with 90 % interval
//! ends.

use std::collections::BTreeSet;
use std::path::Path;

use crate::error::{self, Error};

pub(super) const SCENARIO: &str = "scenario";
pub(super) const TICK: &str = "tick";
/// Number of views that saw the aircraft, as written by `dtd predict`.
pub(super) const DETECTIONS: &str = "detections";
const DISTANCE: &str = "_dtd_m";
/// Suffixes of interval columns: as written by `dtd predict`, and a shorter form.
const INTERVALS: [[&str; 2]; 2] = [["_dtd_m_from", "_dtd_m_to"], ["_from_m", "_to_m"]];
const MAX_NAME_BYTES: usize = 64;
const NAMED: usize = 12;

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct EstimatorColumns {
    pub name: String,
    /// Column of the distances.
    pub distance: String,
    /// Columns of the interval ends, if any.
    pub interval: Option<[String; 2]>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Layout {
    /// True if the table has the number of views that saw the aircraft.
    pub has_detections: bool,
    /// Estimators in the order of their columns; at least one.
    pub estimators: Vec<EstimatorColumns>,
    /// Unused columns.
    pub ignored: Vec<String>,
}

impl EstimatorColumns {
    pub(super) fn names(&self) -> impl Iterator<Item = &String> {
        let ends = self.interval.iter().flatten();
        [&self.distance].into_iter().chain(ends)
    }
}

impl Layout {
    /// Layout of the table at `path` with these column names.
    pub(super) fn of(path: &Path, names: &[&str]) -> error::Result<Self> {
        Self::by_names(names).map_err(|fault| Error::predictions(path, fault))
    }

    fn by_names(names: &[&str]) -> Result<Self, String> {
        let mut there = BTreeSet::new();
        for &name in names {
            if !there.insert(name) {
                return Err(format!("has two columns named {name}; rename one of them"));
            }
        }
        for column in [SCENARIO, TICK] {
            if !there.contains(column) {
                return Err(format!(
                    "has no column {column}; its columns are {}; expected scenario, tick, and for each estimator NAME a column \
                     NAME_dtd_m, in metres",
                    listed(names)
                ));
            }
        }
        let mut used: BTreeSet<String> = [SCENARIO, TICK, DETECTIONS].map(str::to_owned).into();
        let mut estimators = Vec::new();
        for &column in names {
            let Some(name) = column.strip_suffix(DISTANCE) else {
                continue;
            };
            check_name(name, column)?;
            let interval = interval(name, &there)?;
            used.insert(column.to_owned());
            used.extend(interval.iter().flatten().cloned());
            estimators.push(EstimatorColumns {
                name: name.to_owned(),
                distance: column.to_owned(),
                interval,
            });
        }
        if estimators.is_empty() {
            return Err(format!(
                "has no column whose name ends in _dtd_m; its columns are {}; name the distances of an estimator NAME, in metres, \
                 NAME_dtd_m",
                listed(names)
            ));
        }
        let ignored = names.iter().filter(|name| !used.contains(**name));
        Ok(Self {
            has_detections: there.contains(DETECTIONS),
            estimators,
            ignored: ignored.map(|&name| name.to_owned()).collect(),
        })
    }

    /// Numeric columns in reading order: the tick, the detections if present, then each estimator's.
    pub(super) fn numbers(&self) -> Vec<&str> {
        let detections = self.has_detections.then_some(DETECTIONS);
        let of_estimators = self.estimators.iter().flat_map(EstimatorColumns::names);
        let first = [TICK].into_iter().chain(detections);
        first.chain(of_estimators.map(String::as_str)).collect()
    }
}

fn check_name(name: &str, column: &str) -> Result<(), String> {
    let is_usual = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.');
    if (1..=MAX_NAME_BYTES).contains(&name.len()) && name.chars().all(is_usual) {
        return Ok(());
    }
    let shown: String = column.chars().take(2 * MAX_NAME_BYTES).collect();
    Err(format!(
        "has a column {shown:?}; expected a name of an estimator of up to {MAX_NAME_BYTES} letters, digits, _, - and . before _dtd_m"
    ))
}

/// Interval columns for an estimator, if any.
fn interval(name: &str, there: &BTreeSet<&str>) -> Result<Option<[String; 2]>, String> {
    for ends in INTERVALS {
        let [from, to] = ends.map(|end| format!("{name}{end}"));
        match [&from, &to].map(|column| there.contains(column.as_str())) {
            [true, true] => return Ok(Some([from, to])),
            [false, false] => {}
            [has_from, _] => {
                let (there, missing) = if has_from { (from, to) } else { (to, from) };
                return Err(format!(
                    "has column {there} but no column {missing}; an interval has both ends: add the other, or rename this one"
                ));
            }
        }
    }
    Ok(None)
}

/// The first names, and the number left out.
pub(super) fn listed(names: &[impl AsRef<str>]) -> String {
    let first = names.iter().take(NAMED);
    let first: Vec<String> = first
        .map(|name| name.as_ref().escape_debug().to_string())
        .collect();
    match names.len().saturating_sub(NAMED) {
        0 if names.is_empty() => "none".into(),
        0 => first.join(", "),
        more => format!("{} and {more} more", first.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn estimators_are_found_by_the_ends_of_their_columns_and_other_columns_are_ignored() {
        let layout = Layout::by_names(&[
            "scenario",
            "tick",
            "time_ns",
            "dtd_m",
            "mine_dtd_m",
            "mine_dtd_m_sd",
            "mine_dtd_m_from",
            "mine_dtd_m_to",
            "other_to_m",
            "other_from_m",
            "other_dtd_m",
            "plain_dtd_m",
        ])
        .unwrap();
        let names = |of: &[EstimatorColumns]| -> Vec<String> {
            of.iter().map(|columns| columns.name.clone()).collect()
        };
        assert_eq!(names(&layout.estimators), ["mine", "other", "plain"]);
        assert_eq!(layout.ignored, ["time_ns", "dtd_m", "mine_dtd_m_sd"]);
        assert!(!layout.has_detections);
        assert_eq!(
            layout.numbers(),
            [
                "tick",
                "mine_dtd_m",
                "mine_dtd_m_from",
                "mine_dtd_m_to",
                "other_dtd_m",
                "other_from_m",
                "other_to_m",
                "plain_dtd_m"
            ]
        );
    }
}
