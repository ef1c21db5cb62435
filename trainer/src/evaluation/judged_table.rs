//! Evaluation of predictions from any source: a table with a row per tick and a column per estimator.
//!
//! Ticks, figures and files are the same as for a run ([`crate::evaluation`]), without the parts that need a run: removed views, ignored
//! boxes, and, if the table lacks the number of views that saw the aircraft, figures by their number.

mod cells;
mod layout;
mod predictions;
mod report;
mod units;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use dataset::corpus::Corpus;
use dataset::corpus::effective_weather::ReportedWeather;
use dataset::corpus::splits::Side;
use dataset::files::json_file::write_json_unsynced;
use dataset::numbers::spread::median_of;
use dataset::tables::columns::TableWriter;
use dataset::work::watch::Watch;
use serde::{Deserialize, Serialize};

use self::cells::Cells;
use self::layout::listed;
use self::predictions::{EstimatorPredictions, Predictions};
use self::units::{TOLERANCE, probable_unit};
use crate::error::Result;
use crate::evaluation::answers::{JudgedTicks, common_ticks};
use crate::evaluation::judged::{JudgedSide, corpus_name, runways, scenarios_blake3};
use crate::evaluation::metrics::{EstimatorMetrics, Outcome, TickCounts, WithoutViews};
use crate::evaluation::prediction_table::judged_ticks;
use crate::evaluation::rules::EvaluationRules;
use crate::run::folder::RunFolder;
use crate::run::place::RunPlace;
use crate::samples::Sample;
use crate::samples::sides::marked_scenarios;
use crate::samples::truth::Truth;

/// Table evaluation: input and output.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct TableEvaluationConfig {
    /// Scenarios to evaluate.
    pub side: JudgedSide,
    /// An empty or new folder for the results; by default they are only returned.
    pub out: Option<PathBuf>,
}

/// Table evaluation identity (`evaluation.json`).
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct JudgedTable {
    /// Name of the table's file.
    pub predictions: String,
    /// Hash of the table's file.
    pub predictions_blake3: String,
    /// Name of the corpus's folder.
    pub corpus: String,
    /// Hash of the scenario identifiers and manifests.
    pub scenarios_blake3: String,
    /// Evaluated part of the scenarios.
    pub side: JudgedSide,
    /// ICAO code and designator of each runway.
    pub runways: Vec<String>,
    /// Name of the rig.
    pub rig: String,
    /// View names.
    pub views: Vec<String>,
    /// Version of the rules.
    pub rules: u32,
}

/// The known part of the split: the training flights are unknown.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct TableSplit {
    /// The unit that is kept together: `trajectory`.
    pub by: String,
    /// Evaluated flights.
    pub test: TableFlights,
}

/// Evaluated flights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct TableFlights {
    /// Number of scenarios.
    pub scenarios: usize,
    /// Number of trajectories.
    pub trajectories: usize,
}

/// `metrics.json` for a table evaluation: as for a run ([`crate::Metrics`]), without the parts that need a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TableMetrics {
    /// Rules of the evaluation.
    pub rules: EvaluationRules,
    /// Identity of the evaluation.
    pub judged: JudgedTable,
    /// The test side of the split.
    pub split: TableSplit,
    /// Numbers of evaluated ticks.
    pub ticks: TickCounts,
    /// Weather that simulators reported at the aircraft, by name of the planned weather; missing without reports.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub weather_at_aircraft: BTreeMap<String, ReportedWeather>,
    /// Figures by estimator name.
    pub estimators: BTreeMap<String, EstimatorMetrics>,
}

/// Evaluates the predictions in a table (Parquet, or CSV if its name ends in `.csv`) against corpus labels; the corpus needs no detections.
///
/// The table has the columns `scenario`, `tick`, and for each estimator `NAME_dtd_m` in metres, null where it has no prediction. Optional
/// columns are the ends of 90 % intervals, `NAME_dtd_m_from` and `NAME_dtd_m_to`, and `detections`, the number of views that saw the
/// aircraft.
///
/// # Errors
/// The table or the corpus cannot be used, or the results cannot be written.
pub fn evaluate_table(
    table: &Path,
    corpus: &Corpus,
    config: &TableEvaluationConfig,
    watch: &dyn Watch,
) -> Result<TableMetrics> {
    let rules = &EvaluationRules::current();
    let place = config.out.as_deref().map(RunPlace::take_vacant);
    let place = place.transpose()?;
    let cells = Cells::read(table)?;
    let ignored = &cells.layout.ignored;
    if !ignored.is_empty() {
        watch.say(&format!("columns ignored: {}", listed(ignored)));
    }
    let mut truth = Truth::read(corpus)?;
    if config.side == JudgedSide::All {
        truth.samples.test_all();
    }
    watch.check()?;
    let samples = &truth.samples;
    let ticks = JudgedTicks::of(samples, rules);
    let judged = ticks.ticks();
    if judged.is_empty() {
        return Err(rules.nothing_to_judge(corpus));
    }
    let predictions = Predictions::at(judged, &cells, &truth, rules)?;
    if predictions.not_judged > 0 {
        watch.say(&format!(
            "rows that are not judged, of other ticks or other sides of the split: {}",
            predictions.not_judged
        ));
    }
    for predicted in &predictions.estimators {
        refuse_other_unit(predicted, judged).map_err(|fault| cells.refused(fault))?;
        let distances_m = predicted.distances_m.iter().flatten();
        let negative = distances_m.filter(|distance_m| **distance_m < 0.0).count();
        if negative > 0 {
            watch.warn(&format!(
                "{}_dtd_m is negative at {negative} judged ticks, which are judged as they are",
                predicted.name
            ));
        }
    }
    let evaluation = TableEvaluation {
        ticks: &ticks,
        predictions: &predictions,
    };
    let identity = JudgedTable {
        predictions: table
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into(),
        predictions_blake3: cells.blake3,
        corpus: corpus_name(corpus),
        scenarios_blake3: scenarios_blake3(samples),
        side: config.side,
        runways: runways(samples).into_iter().collect(),
        rig: samples.rig.name.clone(),
        views: samples.views.clone(),
        rules: rules.version,
    };
    let metrics = evaluation.metrics(identity);
    if let Some(place) = place {
        let new = place.begin()?;
        write_json_unsynced(&new.path(RunFolder::EVALUATION), &metrics.judged)?;
        write_json_unsynced(&new.metrics_path(), &metrics)?;
        evaluation.table().write(&new.predictions_path())?;
        report::write(&new, &metrics)?;
        place.commit(&metrics.judged.predictions_blake3)?;
    }
    Ok(metrics)
}

/// Rejects predictions in a unit other than metres, or with the opposite sign.
fn refuse_other_unit(
    predicted: &EstimatorPredictions,
    judged: &[&Sample],
) -> std::result::Result<(), String> {
    let ticks = predicted.distances_m.iter().zip(judged);
    let ratios = ticks.filter_map(|(distance_m, sample)| Some((*distance_m)? / sample.dtd_m));
    let Some(median_ratio) = median_of(ratios) else {
        return Ok(());
    };
    let name = &predicted.name;
    // Hardly trained estimators may answer below zero, but not by this factor.
    if (median_ratio + 1.0).abs() <= TOLERANCE {
        return Err(format!(
            "the distances in {name}_dtd_m have the opposite sign: their median is {median_ratio:.3} of the true distance; expected \
             distances to touchdown, which fall to 0 m along the approach; change their sign"
        ));
    }
    match probable_unit(median_ratio) {
        None => Ok(()),
        Some((unit, length_m)) => Err(format!(
            "the distances in {name}_dtd_m are probably in {unit}: their median is {median_ratio:.3e} of the true distance in metres, \
             and {unit} would give {:.3e}; convert them to metres",
            1.0 / length_m
        )),
    }
}

struct TableEvaluation<'a> {
    ticks: &'a JudgedTicks<'a>,
    predictions: &'a Predictions,
}

impl TableEvaluation<'_> {
    /// Outcomes for an estimator, tick by tick.
    fn outcomes(&self, predicted: &EstimatorPredictions) -> Vec<Outcome<'_>> {
        let detections = self.predictions.detections.as_ref();
        let intervals_m = predicted.intervals_m.as_ref();
        let outcome = |tick: usize| Outcome {
            predicted_m: predicted.distances_m[tick],
            interval_m: intervals_m.and_then(|intervals_m| intervals_m[tick]),
            detections: detections.map(|detections| detections[tick]),
            ..self.ticks.unanswered(tick)
        };
        (0..self.ticks.ticks().len()).map(outcome).collect()
    }

    fn metrics(&self, judged: JudgedTable) -> TableMetrics {
        let of_estimators = self.predictions.estimators.iter();
        let distances_m = of_estimators.map(|predicted| &predicted.distances_m[..]);
        let common = common_ticks(self.ticks.ticks().len(), distances_m, Option::is_some);
        let JudgedTicks { samples, rules, .. } = *self.ticks;
        let estimators = self.predictions.estimators.iter();
        let figures = estimators.map(|predicted| {
            let outcomes = self.outcomes(predicted);
            let figures = EstimatorMetrics::of(&outcomes, &common, WithoutViews::default(), rules);
            (predicted.name.clone(), figures)
        });
        let seen = |seen: &Vec<usize>| seen.iter().filter(|&&views| views > 0).count();
        TableMetrics {
            rules: rules.clone(),
            judged,
            split: TableSplit {
                by: "trajectory".into(),
                test: TableFlights {
                    scenarios: samples.scenario_count(Side::Test),
                    trajectories: samples.flights(Side::Test).len(),
                },
            },
            ticks: (self.ticks).counts(self.predictions.detections.as_ref().map(seen), &common),
            weather_at_aircraft: marked_scenarios::reported_on_test_side(samples),
            estimators: figures.collect(),
        }
    }

    /// Table for `predictions.parquet`: ticks with ground truth and predictions.
    fn table(&self) -> TableWriter {
        let JudgedTicks { samples, rules, .. } = *self.ticks;
        let detections = self.predictions.detections.clone();
        let mut table = judged_ticks(self.ticks.ticks(), detections, samples, rules);
        for predicted in &self.predictions.estimators {
            let column = format!("{}_dtd_m", predicted.name);
            table = table.optional_f64(&column, predicted.distances_m.iter().copied());
            for (end, suffix) in ["_from", "_to"].into_iter().enumerate() {
                if let Some(intervals_m) = &predicted.intervals_m {
                    let ends = intervals_m
                        .iter()
                        .map(|interval_m| Some((*interval_m)?[end]));
                    table = table.optional_f64(&format!("{column}{suffix}"), ends);
                }
            }
        }
        table
    }
}
