//! The rows of a table of predictions, checked and put beside the ticks of the corpus.

use std::collections::{BTreeSet, HashMap};

use super::cells::Cells;
use super::layout::{DETECTIONS, EstimatorColumns, Layout, SCENARIO, TICK, listed};
use crate::error::PredictionsFault;
use crate::evaluation::rules::EvaluationRules;
use crate::samples::truth::Truth;
use crate::samples::{Sample, ScenarioSummary};

/// Maximum number of views of a rig, and more.
const MAX_DETECTIONS: u32 = 255;

/// What a table says about the ticks that are judged.
pub(super) struct Predictions {
    /// Number of views that saw the aircraft; `None` if the table does not say.
    pub detections: Option<Vec<usize>>,
    /// In the order of the names.
    pub estimators: Vec<Predicted>,
    /// Number of rows of other ticks.
    pub not_judged: usize,
}

/// Predictions of one estimator at the judged ticks.
pub(super) struct Predicted {
    pub name: String,
    /// Metres.
    pub distances_m: Vec<Option<f64>>,
    /// Ends of 90 % intervals, metres; `None` if the estimator states none.
    pub intervals_m: Option<Vec<Option<[f64; 2]>>>,
}

/// The columns of an estimator, its distances, and the ends of its intervals.
type EstimatorCells<'a> = (
    &'a EstimatorColumns,
    &'a [Option<f64>],
    &'a [Vec<Option<f64>>],
);

/// Cells whose rows are ticks of a corpus.
struct Rows<'a> {
    layout: &'a Layout,
    /// Scenario of each row.
    scenario: Vec<usize>,
    tick: Vec<u32>,
    detections: Option<Vec<usize>>,
    /// Columns of the estimators, each followed by the ends of its intervals.
    of_estimators: &'a [Vec<Option<f64>>],
    scenarios: &'a [ScenarioSummary],
}

impl Predictions {
    /// The predictions at `judged` ticks; a tick without a row has no prediction.
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
        let mut estimators = rows
            .estimators()
            .map(|(columns, values, ends)| rows.predicted(columns, values, ends, &row_of))
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
        let Cells {
            layout,
            scenario,
            numbers,
            ..
        } = cells;
        let scenarios = &truth.samples.scenarios;
        let scenario = known_scenarios(scenario, scenarios)?;
        let (tick, others) = numbers
            .split_first()
            .map_or((&[][..], &[][..]), |(tick, others)| (&tick[..], others));
        let tick = whole_numbers(tick, TICK, u32::MAX)?;
        let tick = tick.into_iter().enumerate().map(|(row, tick)| {
            tick.ok_or(PredictionsFault::NoKey {
                row: row + 1,
                column: TICK,
            })
        });
        let (detections, of_estimators) = match others {
            [detections, others @ ..] if layout.has_detections => {
                let detections = whole_numbers(detections, DETECTIONS, MAX_DETECTIONS)?;
                let of_row = |seen: Option<u32>| seen.unwrap_or_default() as usize;
                let any = detections.iter().any(Option::is_some);
                let detections = any.then(|| detections.into_iter().map(of_row).collect());
                (detections, others)
            }
            others => (None, others),
        };
        Ok(Self {
            layout,
            scenario,
            tick: tick.collect::<Result<_, _>>()?,
            detections,
            of_estimators,
            scenarios,
        })
    }

    /// The row of each tick of each scenario.
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

    /// The columns of each estimator: distances and ends of intervals.
    fn estimators(&self) -> impl Iterator<Item = EstimatorCells<'a>> {
        let mut left = self.of_estimators;
        self.layout.estimators.iter().filter_map(move |columns| {
            let (distances, others) = left.split_first()?;
            let (ends, others) =
                others.split_at_checked(columns.interval.iter().flatten().count())?;
            left = others;
            Some((columns, &distances[..], ends))
        })
    }

    /// Rejects numbers that are no distances anywhere.
    fn refuse_infinite(&self) -> Result<(), PredictionsFault> {
        for (columns, distances, ends) in self.estimators() {
            let names = [&columns.distance].into_iter();
            let names = names.chain(columns.interval.iter().flatten());
            let values = [distances]
                .into_iter()
                .chain(ends.iter().map(|end| &end[..]));
            for (column, values) in names.zip(values) {
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
        distances: &[Option<f64>],
        ends: &[Vec<Option<f64>>],
        row_of: &[Option<usize>],
    ) -> Result<Predicted, PredictionsFault> {
        let at_ticks = row_of.iter().copied();
        let distances_m = at_ticks.clone().map(|row| distances[row?]).collect();
        let (Some([from_column, to_column]), [from, to]) = (&columns.interval, ends) else {
            return Ok(Predicted {
                name: columns.name.clone(),
                distances_m,
                intervals_m: None,
            });
        };
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
        Ok(Predicted {
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

/// The scenario of each row, as a place in `scenarios`.
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
