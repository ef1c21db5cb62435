//! Predictions of a run: `predictions.parquet` and `metrics.json` of `dtd evaluate`, or the table that `dtd predict` wrote.
//!
//! They are read once, in the background: the table has a row for each tick of all scenarios.

use std::collections::BTreeMap;
use std::iter;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use dataset::corpus::scenario::other_flight::other_flight;
use dataset::corpus::seal::sealed::Sealed;
use dataset::files::json_file::read_json;
use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
use dataset::tables::columns::Table;
use dataset::tables::frames::TickRow;
use serde::{Deserialize, Serialize};

use crate::rounded::thousandths;

const PREDICTIONS: &str = "predictions.parquet";
const METRICS: &str = "metrics.json";
const RUN: &str = "run.json";
/// Suffix of columns with answers.
const ANSWER: &str = "_dtd_m";
/// Column of the ground truth, which has the same ending.
const TRUTH: &str = "dtd_m";
/// Row limit, above the ticks in any corpus.
const MAX_ROWS: u64 = 1 << 30;

/// A run, by folder name.
pub(crate) struct Run {
    pub(crate) name: String,
    path: PathBuf,
    answers: OnceLock<Answers>,
}

/// Readable parts of a run.
#[derive(Debug, Default)]
pub(crate) struct Answers {
    /// Flights by scenario.
    pub(crate) flights: BTreeMap<String, Flight>,
    metrics: Option<Metrics>,
    recommended: Option<String>,
    problems: Vec<String>,
}

/// The part of `run.json` that the page shows.
#[derive(Deserialize)]
struct Trained {
    choice: Choice,
}

#[derive(Deserialize)]
struct Choice {
    estimator: String,
}

/// The answers for one scenario.
#[derive(Debug, Default, Clone, Serialize)]
pub(crate) struct Flight {
    pub(crate) tick: Vec<u32>,
    /// The truth of the evaluation; empty for a corpus without labels.
    #[serde(skip)]
    dtd_m: Vec<f64>,
    /// Answers by estimator.
    pub(crate) estimators: BTreeMap<String, Vec<Option<f64>>>,
}

/// The part of `metrics.json` that the page shows.
#[derive(Debug, Clone, Deserialize, Serialize)]
struct Metrics {
    #[serde(default)]
    estimators: BTreeMap<String, Estimator>,
}

/// An estimator's figures over all judged ticks, and over parts of them.
#[derive(Debug, Clone, Deserialize, Serialize)]
struct Estimator {
    #[serde(flatten)]
    all: Figures,
    #[serde(default)]
    by_weather: BTreeMap<String, Figures>,
    #[serde(default)]
    by_distance_nm: Vec<DistanceBin>,
}

#[derive(Debug, Clone, Deserialize, Serialize)]
struct DistanceBin {
    from_nm: f64,
    to_nm: f64,
    #[serde(flatten)]
    figures: Figures,
}

#[derive(Debug, Clone, Deserialize, Serialize)]
struct Figures {
    mape_pct: Option<f64>,
    median_pct: Option<f64>,
    p95_pct: Option<f64>,
    p95_m: Option<f64>,
    coverage: Option<f64>,
}

/// A run's summary beside the scenarios.
#[derive(Debug, Serialize)]
pub(crate) struct Summary<'a> {
    name: &'a str,
    metrics: Option<&'a Metrics>,
    /// Name of the estimator that the training recommends.
    recommended: Option<&'a str>,
    /// Errors by scenario and estimator.
    flights: BTreeMap<&'a str, BTreeMap<&'a str, Errors>>,
    problems: Vec<String>,
}

/// An estimator's errors in one scenario, over the judged ticks.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Errors {
    mape_pct: f64,
    worst_pct: f64,
    worst_tick: u32,
    answered: usize,
    /// Sum and number of the errors, percent, by whole nautical miles of the true distance.
    by_nm: BTreeMap<i64, (f64, usize)>,
}

impl Run {
    pub(crate) fn at(path: PathBuf, name: String) -> Self {
        Self {
            name,
            path,
            answers: OnceLock::new(),
        }
    }

    /// Predictions of the run, read on first use.
    pub(crate) fn answers(&self) -> &Answers {
        self.answers.get_or_init(|| Answers::read(&self.path))
    }

    /// Figures; `None` if the run was evaluated on a different corpus, judged by its first scenario: reading all takes longer than the page
    /// may. `flown` returns the ticks of a scenario in this corpus, if it exists.
    pub(crate) fn summary(&self, flown: impl Fn(&str) -> Option<Vec<TickRow>>) -> Summary<'_> {
        let answers = self.answers();
        let mut problems = answers.problems.clone();
        let mut named_alike = answers.flights.iter();
        let first = named_alike.find_map(|(id, flight)| Some((id, flight, flown(id)?)));
        let other = first.and_then(|(id, flight, flown)| flight.other_than(id, &flown));
        if let Some(other) = other {
            problems.push(other);
            return Summary {
                name: &self.name,
                metrics: None,
                recommended: None,
                flights: BTreeMap::new(),
                problems,
            };
        }
        Summary {
            name: &self.name,
            metrics: answers.metrics.as_ref(),
            recommended: answers.recommended.as_deref(),
            flights: answers
                .flights
                .iter()
                .map(|(id, flight)| (id.as_str(), flight.errors()))
                .collect(),
            problems,
        }
    }
}

impl Answers {
    fn read(path: &Path) -> Self {
        let mut answers = Self::default();
        let is_folder = path.is_dir();
        let sealed = if is_folder {
            Sealed::read(path)
        } else {
            Ok(None)
        };
        let sealed = sealed.unwrap_or_else(|error| {
            answers.problems.push(error.to_string());
            None
        });
        let file = |name: &str| match &sealed {
            Some(sealed) if sealed.hash_of(name).is_some() => sealed.check(name),
            _ => Ok(path.join(name)),
        };
        let table = if is_folder {
            file(PREDICTIONS)
        } else {
            Ok(path.to_owned())
        };
        match table.and_then(|table| flights(&table)) {
            Ok(flights) => answers.flights = flights,
            Err(error) if error.is_not_found() => answers.problems.push(format!(
                "has no {PREDICTIONS}: run `dtd evaluate` on it first"
            )),
            Err(error) => answers.problems.push(error.to_string()),
        }
        if is_folder {
            match file(METRICS).and_then(|path| read_json(&path, "metrics")) {
                Ok(metrics) => answers.metrics = Some(metrics),
                Err(error) if error.is_not_found() => {}
                Err(error) => answers.problems.push(error.to_string()),
            }
            // Results of `dtd evaluate --out` are no run.
            let trained = file(RUN).and_then(|path| read_json::<Trained>(&path, "run"));
            answers.recommended = trained.ok().map(|trained| trained.choice.estimator);
        }
        answers
    }
}

/// Answers by scenario.
fn flights(path: &Path) -> dataset::Result<BTreeMap<String, Flight>> {
    let table = Table::read(path, MAX_ROWS)?;
    let scenario = table.text("scenario")?;
    let tick = table.u32("tick")?;
    let truth = if table.has(TRUTH) {
        table.f64(TRUTH)?
    } else {
        Vec::new()
    };
    let mut estimators = Vec::new();
    for column in table.column_names() {
        if let Some(name) = column.strip_suffix(ANSWER) {
            estimators.push((name.to_owned(), table.optional_f64(column)?));
        }
    }
    drop(table);
    let mut flights: BTreeMap<String, Flight> = BTreeMap::new();
    let mut begin = 0;
    for rows in scenario.chunk_by(|a, b| a == b) {
        let rows_of = begin..begin + rows.len();
        begin = rows_of.end;
        let flight = flights.entry(rows[0].clone()).or_default();
        flight.tick.extend_from_slice(&tick[rows_of.clone()]);
        flight
            .dtd_m
            .extend_from_slice(truth.get(rows_of.clone()).unwrap_or_default());
        for (name, answers) in &estimators {
            let of_flight = flight.estimators.entry(name.clone()).or_default();
            let answers = answers[rows_of.clone()].iter();
            of_flight.extend(answers.map(|answer| answer.map(thousandths)));
        }
    }
    Ok(flights)
}

impl Flight {
    /// Evidence that these predictions belong to a different flight.
    pub(crate) fn other_than(&self, scenario: &str, flown: &[TickRow]) -> Option<String> {
        let truth_m = self.dtd_m.iter().copied().map(Some);
        let truth_m = truth_m.chain(iter::repeat(None));
        let answered = self.tick.iter().copied().zip(truth_m);
        other_flight(scenario, answered, flown)
    }

    fn errors(&self) -> BTreeMap<&str, Errors> {
        let estimators = self.estimators.iter();
        estimators
            .filter_map(|(name, answers)| {
                Some((name.as_str(), Errors::of(&self.tick, &self.dtd_m, answers)?))
            })
            .collect()
    }
}

impl Errors {
    /// `None` without an answer or without truth.
    fn of(tick: &[u32], truth_m: &[f64], answers: &[Option<f64>]) -> Option<Self> {
        let rows = tick.iter().zip(truth_m).zip(answers);
        let errors = rows.filter_map(|((&tick, &truth_m), answer)| {
            let error_pct = ((*answer)? - truth_m).abs() / truth_m * 100.0;
            let nm = (truth_m / METERS_PER_NAUTICAL_MILE).floor() as i64;
            error_pct.is_finite().then_some((tick, error_pct, nm))
        });
        let mut sum_pct = 0.0;
        let mut by_nm = BTreeMap::<i64, (f64, usize)>::new();
        let mut found: Option<Self> = None;
        for (tick, error_pct, nm) in errors {
            sum_pct += error_pct;
            let bin = by_nm.entry(nm).or_default();
            *bin = (bin.0 + error_pct, bin.1 + 1);
            let worst = found.get_or_insert(Self {
                mape_pct: 0.0,
                worst_pct: error_pct,
                worst_tick: tick,
                answered: 0,
                by_nm: BTreeMap::new(),
            });
            worst.answered += 1;
            if error_pct > worst.worst_pct {
                (worst.worst_pct, worst.worst_tick) = (error_pct, tick);
            }
        }
        found.map(|found| Self {
            mape_pct: thousandths(sum_pct / found.answered as f64),
            worst_pct: thousandths(found.worst_pct),
            by_nm,
            ..found
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_error_is_the_largest_share_of_the_truth_and_knows_its_tick() {
        let errors = Errors::of(
            &[3, 4, 5, 6],
            &[1000.0, 1000.0, 100.0, 50.0],
            &[Some(1010.0), Some(970.0), Some(102.0), None],
        );
        assert_eq!(
            errors,
            Some(Errors {
                mape_pct: 2.0,
                worst_pct: 3.0,
                worst_tick: 4,
                answered: 3,
                by_nm: BTreeMap::from([(0, (6.0, 3))]),
            })
        );
        assert_eq!(Errors::of(&[3], &[1000.0], &[None]), None);
        assert_eq!(Errors::of(&[3], &[], &[Some(1.0)]), None);
    }
}
