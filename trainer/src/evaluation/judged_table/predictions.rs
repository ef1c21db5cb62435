//! Prediction table rows, checked and matched with the ticks of the corpus.

use std::collections::{BTreeSet, HashMap};

use super::cells::Cells;
use super::layout::{DETECTIONS, EstimatorColumns, SCENARIO, TICK, listed};
use crate::error::{Error, Result};
use crate::evaluation::answers::{Answers, EstimatorAnswers};
use crate::evaluation::rules::EvaluationRules;
use crate::samples::truth::Truth;
use crate::samples::{Sample, ScenarioSummary};

/// Maximum number of views in a rig, with a margin.
const MAX_DETECTIONS: u32 = 255;

/// Predictions at the evaluated ticks.
pub(super) struct Predictions {
    /// Estimators, sorted by name.
    pub names: Vec<String>,
    pub answers: Answers,
    /// Number of rows at other ticks.
    pub not_judged: usize,
}

/// Rows matched with scenarios.
struct Rows<'a> {
    cells: &'a Cells,
    /// Scenario per row.
    scenario: Vec<usize>,
    tick: Vec<u32>,
    detections: Option<Vec<u8>>,
    scenarios: &'a [ScenarioSummary],
}

impl Predictions {
    /// Predictions at `judged` ticks; a tick without a row has no prediction.
    pub(super) fn at(
        judged: &[&Sample],
        cells: &Cells,
        truth: &Truth,
        rules: &EvaluationRules,
    ) -> Result<Self> {
        let rows = Rows::of(cells, truth)?;
        rows.refuse_infinite()?;
        let by_tick = rows.by_tick(truth)?;
        let row_of = |sample: &&Sample| {
            by_tick[sample.scenario]
                .get(sample.tick as usize)
                .copied()
                .flatten()
        };
        let row_of: Vec<Option<usize>> = judged.iter().map(row_of).collect();
        let found = row_of.iter().flatten().count();
        if found == 0 {
            return Err(rows.none_judged(judged, rules));
        }
        let mut columns: Vec<&EstimatorColumns> = cells.layout.estimators.iter().collect();
        columns.sort_by_key(|columns| &columns.name);
        let by_estimator = columns.iter().map(|of| rows.predicted(of, &row_of));
        let seen = |seen: &Vec<u8>| {
            let of_row = |row: &Option<usize>| row.map_or(0, |row| seen[row]);
            row_of.iter().map(of_row).collect()
        };
        Ok(Self {
            answers: Answers {
                detections: rows.detections.as_ref().map(seen),
                by_estimator: by_estimator.collect::<Result<_>>()?,
                ..Answers::default()
            },
            names: columns.iter().map(|of| of.name.clone()).collect(),
            not_judged: rows.tick.len() - found,
        })
    }
}

impl<'a> Rows<'a> {
    fn of(cells: &'a Cells, truth: &'a Truth) -> Result<Self> {
        let scenarios = &truth.samples.scenarios;
        let scenario = known_scenarios(cells, scenarios)?;
        let tick = whole_numbers(cells, TICK, u32::MAX)?;
        let tick = tick.into_iter().enumerate();
        let tick = tick.map(|(row, tick)| tick.ok_or_else(|| without_key(cells, row, TICK)));
        let detections = if cells.layout.has_detections {
            whole_numbers(cells, DETECTIONS, MAX_DETECTIONS)?
        } else {
            Vec::new()
        };
        let of_row = |seen: Option<u32>| seen.unwrap_or_default() as u8;
        let any = detections.iter().any(Option::is_some);
        Ok(Self {
            cells,
            scenario,
            tick: tick.collect::<Result<_>>()?,
            detections: any.then(|| detections.into_iter().map(of_row).collect()),
            scenarios,
        })
    }

    /// Row per scenario and tick.
    fn by_tick(&self, truth: &Truth) -> Result<Vec<Vec<Option<usize>>>> {
        let ticks = truth.ticks.iter();
        let mut by_tick: Vec<Vec<Option<usize>>> = ticks.map(|&ticks| vec![None; ticks]).collect();
        for (row, (&scenario, &tick)) in self.scenario.iter().zip(&self.tick).enumerate() {
            let id = &self.scenarios[scenario].id;
            let ticks = &mut by_tick[scenario];
            let last = ticks.len().saturating_sub(1);
            let Some(there) = ticks.get_mut(tick as usize) else {
                return Err(self.cells.refused(format!(
                    "scenario {id} has tick {tick}, but in the corpus its ticks are 0 to {last}; count ticks from 0, as frames.parquet does"
                )));
            };
            if there.replace(row).is_some() {
                return Err(self.cells.refused(format!(
                    "scenario {id} has tick {tick} more than once; expected one row for each scenario and tick"
                )));
            }
        }
        Ok(by_tick)
    }

    /// Rejects infinite and NaN distances.
    fn refuse_infinite(&self) -> Result<()> {
        for columns in &self.cells.layout.estimators {
            for column in columns.names() {
                let values = &self.cells.numbers[column];
                let bad = |value: &Option<f64>| value.filter(|value| !value.is_finite());
                let mut rows = values.iter().enumerate();
                if let Some((row, found)) = rows.find_map(|(row, value)| Some((row, bad(value)?))) {
                    return Err(self.cells.refused(format!(
                        "{}: {column} is {found:?}, expected a finite number of metres; where there is no prediction, leave the value \
                         out (null in Parquet, an empty field in CSV)",
                        self.place(row)
                    )));
                }
            }
        }
        Ok(())
    }

    fn predicted(
        &self,
        columns: &EstimatorColumns,
        row_of: &[Option<usize>],
    ) -> Result<EstimatorAnswers> {
        let numbers = &self.cells.numbers;
        let distances = &numbers[&columns.distance];
        let distance_m = |row: &Option<usize>| (*row).and_then(|row| distances[row]);
        let distances_m = row_of.iter().map(|row| distance_m(row).unwrap_or(f64::NAN));
        let distances_m = distances_m.collect();
        let Some([from_column, to_column]) = &columns.interval else {
            return Ok(EstimatorAnswers {
                distances_m,
                intervals_m: Vec::new(),
            });
        };
        let [from, to] = [from_column, to_column].map(|column| &numbers[column]);
        let interval_m = |row: usize| match (distances[row], from[row], to[row]) {
            (_, None, None) => Ok([f64::NAN; 2]),
            (Some(_), Some(from_m), Some(to_m)) if from_m <= to_m => Ok([from_m, to_m]),
            (_, from_m, to_m) => {
                let [from, to] = [from_m, to_m].map(|end| {
                    end.map_or_else(|| "missing".to_owned(), |end_m| format!("{end_m:?}"))
                });
                Err(self.cells.refused(format!(
                    "{}: {from_column} is {from} and {to_column} is {to}, expected two finite distances in this order, or none where \
                     there is no prediction",
                    self.place(row)
                )))
            }
        };
        let intervals_m = row_of
            .iter()
            .map(|row| row.map_or(Ok([f64::NAN; 2]), interval_m));
        Ok(EstimatorAnswers {
            distances_m,
            intervals_m: intervals_m.collect::<Result<_>>()?,
        })
    }

    /// Scenario and tick of a row.
    fn place(&self, row: usize) -> String {
        let id = &self.scenarios[self.scenario[row]].id;
        format!("scenario {id}, tick {}", self.tick[row])
    }

    fn none_judged(&self, judged: &[&Sample], rules: &EvaluationRules) -> Error {
        let sides: BTreeSet<usize> = judged.iter().map(|sample| sample.scenario).collect();
        let on_other_side = |scenario: &&usize| !sides.contains(scenario);
        self.cells.refused(format!(
            "none of its {} rows is of a tick that counts, with the aircraft in an image, {} to {} NM away; {} rows are of scenarios \
             outside the judged side: predict the test side, or judge all scenarios with --side all",
            self.tick.len(),
            rules.min_dtd_nm,
            rules.max_dtd_nm,
            self.scenario.iter().filter(on_other_side).count()
        ))
    }
}

fn without_key(cells: &Cells, row: usize, column: &str) -> Error {
    cells.refused(format!(
        "row {} has no {column}; every row needs a scenario and a tick, for a tick without a prediction as well",
        row + 1
    ))
}

/// Scenario index per row.
fn known_scenarios(cells: &Cells, scenarios: &[ScenarioSummary]) -> Result<Vec<usize>> {
    let places = scenarios.iter().enumerate();
    let places: HashMap<&str, usize> = places.map(|(at, s)| (s.id.as_str(), at)).collect();
    let mut unknown: BTreeSet<&str> = BTreeSet::new();
    let mut found = Vec::with_capacity(cells.scenario.len());
    for (row, id) in cells.scenario.iter().enumerate() {
        let id = id.as_deref();
        let id = id.ok_or_else(|| without_key(cells, row, SCENARIO))?;
        match places.get(id) {
            Some(&place) => found.push(place),
            None => {
                unknown.insert(id);
            }
        }
    }
    if unknown.is_empty() {
        return Ok(found);
    }
    let known: Vec<&str> = scenarios.iter().map(|s| s.id.as_str()).collect();
    let unknown: Vec<&str> = unknown.into_iter().collect();
    let count = match unknown.len() {
        1 => "1 scenario".to_owned(),
        count => format!("{count} scenarios"),
    };
    Err(cells.refused(format!(
        "has {count} that the corpus does not have: {}; the corpus has {}; judge it with the corpus that it was made from",
        listed(&unknown),
        listed(&known)
    )))
}

fn whole_numbers(cells: &Cells, column: &str, most: u32) -> Result<Vec<Option<u32>>> {
    let whole = |(row, value): (usize, &Option<f64>)| match *value {
        Some(found) if !(0.0..=f64::from(most)).contains(&found) || found.fract() != 0.0 => {
            Err(cells.refused(format!(
                "row {}: {column} is {found:?}, expected a whole number from 0 to {most}",
                row + 1
            )))
        }
        value => Ok(value.map(|value| value as u32)),
    };
    cells.numbers[column]
        .iter()
        .enumerate()
        .map(whole)
        .collect()
}
