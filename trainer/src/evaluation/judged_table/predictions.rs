//! Prediction table rows, checked and matched with the ticks of the corpus.

use std::collections::{BTreeSet, HashMap};

use super::cells::Cells;
use super::layout::{DETECTIONS, EstimatorColumns, SCENARIO, TICK, listed};
use crate::error::PredictionsFault;
use crate::evaluation::rules::EvaluationRules;
use crate::samples::truth::Truth;
use crate::samples::{Sample, ScenarioSummary};

/// Maximum number of views in a rig, with a margin.
const MAX_DETECTIONS: u32 = 255;

/// Predictions at the evaluated ticks.
pub(super) struct Predictions {
    /// Number of views that saw the aircraft; `None` if the table does not say.
    pub detections: Option<Vec<usize>>,
    /// Sorted by name.
    pub estimators: Vec<EstimatorPredictions>,
    /// Number of rows at other ticks.
    pub not_judged: usize,
}

/// Predictions from one estimator at the evaluated ticks.
pub(super) struct EstimatorPredictions {
    pub name: String,
    pub distances_m: Vec<Option<f64>>,
    /// Ends of 90 % intervals, metres; `None` for an estimator without intervals.
    pub intervals_m: Option<Vec<Option<[f64; 2]>>>,
}

/// Rows matched with scenarios.
struct Rows<'a> {
    cells: &'a Cells,
    /// Scenario per row.
    scenario: Vec<usize>,
    tick: Vec<u32>,
    detections: Option<Vec<usize>>,
    scenarios: &'a [ScenarioSummary],
}

impl Predictions {
    /// Predictions at `judged` ticks; a tick without a row has no prediction.
    pub(super) fn at(
        judged: &[&Sample],
        cells: &Cells,
        truth: &Truth,
        rules: &EvaluationRules,
    ) -> Result<Self, PredictionsFault> {
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
        let estimators = cells.layout.estimators.iter();
        let mut estimators = estimators
            .map(|columns| rows.predicted(columns, &row_of))
            .collect::<Result<Vec<_>, _>>()?;
        estimators.sort_by(|one, other| one.name.cmp(&other.name));
        let seen = |seen: &Vec<usize>| {
            let of_row = |row: &Option<usize>| row.map_or(0, |row| seen[row]);
            row_of.iter().map(of_row).collect()
        };
        Ok(Self {
            detections: rows.detections.as_ref().map(seen),
            estimators,
            not_judged: rows.tick.len() - found,
        })
    }
}

impl<'a> Rows<'a> {
    fn of(cells: &'a Cells, truth: &'a Truth) -> Result<Self, PredictionsFault> {
        let scenarios = &truth.samples.scenarios;
        let scenario = known_scenarios(&cells.scenario, scenarios)?;
        let tick = whole_numbers(&cells.numbers[TICK], TICK, u32::MAX)?;
        let tick = tick.into_iter().enumerate().map(|(row, tick)| {
            tick.ok_or(PredictionsFault::NoKey {
                row: row + 1,
                column: TICK,
            })
        });
        let detections = match cells.numbers.get(DETECTIONS) {
            Some(detections) => whole_numbers(detections, DETECTIONS, MAX_DETECTIONS)?,
            None => Vec::new(),
        };
        let of_row = |seen: Option<u32>| seen.unwrap_or_default() as usize;
        let any = detections.iter().any(Option::is_some);
        Ok(Self {
            cells,
            scenario,
            tick: tick.collect::<Result<_, _>>()?,
            detections: any.then(|| detections.into_iter().map(of_row).collect()),
            scenarios,
        })
    }

    /// Row per scenario and tick.
    fn by_tick(&self, truth: &Truth) -> Result<Vec<Vec<Option<usize>>>, PredictionsFault> {
        let ticks = truth.ticks.iter();
        let mut by_tick: Vec<Vec<Option<usize>>> = ticks.map(|&ticks| vec![None; ticks]).collect();
        for (row, (&scenario, &tick)) in self.scenario.iter().zip(&self.tick).enumerate() {
            let id = || self.scenarios[scenario].id.clone();
            let ticks = &mut by_tick[scenario];
            let last = ticks.len().saturating_sub(1);
            let there =
                ticks
                    .get_mut(tick as usize)
                    .ok_or_else(|| PredictionsFault::NoSuchTick {
                        scenario: id(),
                        tick,
                        last,
                    })?;
            if there.replace(row).is_some() {
                return Err(PredictionsFault::TickTwice {
                    scenario: id(),
                    tick,
                });
            }
        }
        Ok(by_tick)
    }

    /// Rejects infinite and NaN distances.
    fn refuse_infinite(&self) -> Result<(), PredictionsFault> {
        for columns in &self.cells.layout.estimators {
            for column in columns.names() {
                let values = &self.cells.numbers[column];
                let is_bad = |value: &Option<f64>| value.is_some_and(|value| !value.is_finite());
                if let Some(row) = values.iter().position(is_bad) {
                    return Err(PredictionsFault::NotFinite {
                        scenario: self.id(row),
                        tick: self.tick[row],
                        column: column.clone(),
                        found: values[row].unwrap_or(f64::NAN),
                    });
                }
            }
        }
        Ok(())
    }

    fn predicted(
        &self,
        columns: &EstimatorColumns,
        row_of: &[Option<usize>],
    ) -> Result<EstimatorPredictions, PredictionsFault> {
        let numbers = &self.cells.numbers;
        let distances = &numbers[&columns.distance];
        let at_ticks = row_of.iter().copied();
        let distances_m = at_ticks.clone().map(|row| distances[row?]).collect();
        let Some([from_column, to_column]) = &columns.interval else {
            return Ok(EstimatorPredictions {
                name: columns.name.clone(),
                distances_m,
                intervals_m: None,
            });
        };
        let [from, to] = [from_column, to_column].map(|column| &numbers[column]);
        let interval_m = |row: usize| match (distances[row], from[row], to[row]) {
            (_, None, None) => Ok(None),
            (Some(_), Some(from_m), Some(to_m)) if from_m <= to_m => Ok(Some([from_m, to_m])),
            (_, from_m, to_m) => Err(PredictionsFault::NotAnInterval {
                scenario: self.id(row),
                tick: self.tick[row],
                from_column: from_column.clone(),
                to_column: to_column.clone(),
                from_m,
                to_m,
            }),
        };
        let intervals_m = at_ticks.map(|row| row.map_or(Ok(None), interval_m));
        Ok(EstimatorPredictions {
            name: columns.name.clone(),
            distances_m,
            intervals_m: Some(intervals_m.collect::<Result<_, _>>()?),
        })
    }

    fn id(&self, row: usize) -> String {
        self.scenarios[self.scenario[row]].id.clone()
    }

    fn none_judged(&self, judged: &[&Sample], rules: &EvaluationRules) -> PredictionsFault {
        let sides: BTreeSet<usize> = judged.iter().map(|sample| sample.scenario).collect();
        let on_other_side = |scenario: &&usize| !sides.contains(scenario);
        PredictionsFault::NoneJudged {
            rows: self.tick.len(),
            elsewhere: self.scenario.iter().filter(on_other_side).count(),
            min_dtd_nm: rules.min_dtd_nm,
            max_dtd_nm: rules.max_dtd_nm,
        }
    }
}

/// Scenario index per row.
fn known_scenarios(
    ids: &[Option<String>],
    scenarios: &[ScenarioSummary],
) -> Result<Vec<usize>, PredictionsFault> {
    let places = scenarios.iter().enumerate();
    let places: HashMap<&str, usize> = places.map(|(at, s)| (s.id.as_str(), at)).collect();
    let mut unknown: BTreeSet<&str> = BTreeSet::new();
    let mut found = Vec::with_capacity(ids.len());
    for (row, id) in ids.iter().enumerate() {
        let id = id.as_deref().ok_or(PredictionsFault::NoKey {
            row: row + 1,
            column: SCENARIO,
        })?;
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
    Err(PredictionsFault::UnknownScenarios {
        count: unknown.len(),
        first: listed(&unknown),
        known: listed(&known),
    })
}

fn whole_numbers(
    values: &[Option<f64>],
    column: &'static str,
    most: u32,
) -> Result<Vec<Option<u32>>, PredictionsFault> {
    let whole = |(row, value): (usize, &Option<f64>)| match *value {
        Some(found) if !(0.0..=f64::from(most)).contains(&found) || found.fract() != 0.0 => {
            Err(PredictionsFault::NotWhole {
                row: row + 1,
                column,
                found,
                most,
            })
        }
        value => Ok(value.map(|value| value as u32)),
    };
    values.iter().enumerate().map(whole).collect()
}
