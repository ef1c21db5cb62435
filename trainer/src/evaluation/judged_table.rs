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
use self::predictions::Predictions;
use self::units::{TOLERANCE, probable_unit};
use crate::error::Result;
use crate::evaluation::answers::JudgedTicks;
use crate::evaluation::judged::{JudgedSide, corpus_name, runways, scenarios_blake3};
use crate::evaluation::metrics::{EstimatorMetrics, TickCounts};
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
    let Predictions { names, answers, .. } = &predictions;
    for (name, of) in names.iter().zip(&answers.by_estimator) {
        refuse_other_unit(name, &of.distances_m, judged).map_err(|fault| cells.refused(fault))?;
        let negative = of
            .distances_m
            .iter()
            .filter(|distance_m| **distance_m < 0.0);
        let negative = negative.count();
        if negative > 0 {
            watch.warn(&format!(
                "{name}_dtd_m is negative at {negative} judged ticks, which are judged as they are"
            ));
        }
    }
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
    let metrics = metrics_of(identity, &ticks, &predictions);
    if let Some(place) = place {
        let new = place.begin()?;
        write_json_unsynced(&new.path(RunFolder::EVALUATION), &metrics.judged)?;
        write_json_unsynced(&new.metrics_path(), &metrics)?;
        table_of(&ticks, &predictions).write(&new.predictions_path())?;
        report::write(&new, &metrics)?;
        place.commit(&metrics.judged.predictions_blake3)?;
    }
    Ok(metrics)
}

/// Rejects predictions in a unit other than metres, or with the opposite sign.
fn refuse_other_unit(
    name: &str,
    distances_m: &[f64],
    judged: &[&Sample],
) -> std::result::Result<(), String> {
    let ticks = distances_m.iter().zip(judged);
    let ratios = ticks.map(|(distance_m, sample)| distance_m / sample.dtd_m);
    let Some(median_ratio) = median_of(ratios.filter(|ratio| ratio.is_finite())) else {
        return Ok(());
    };
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

fn metrics_of(judged: JudgedTable, ticks: &JudgedTicks, predictions: &Predictions) -> TableMetrics {
    let Predictions { names, answers, .. } = predictions;
    let JudgedTicks { samples, rules, .. } = *ticks;
    let common = answers.common();
    let figures = names.iter().enumerate().map(|(number, name)| {
        let outcomes = ticks.outcomes(answers, number);
        let figures = EstimatorMetrics::of(&outcomes, &common, BTreeMap::new(), rules);
        (name.clone(), figures)
    });
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
        ticks: ticks.counts(answers.seen(), &common),
        weather_at_aircraft: marked_scenarios::reported_on_test_side(samples),
        estimators: figures.collect(),
    }
}

/// Table for `predictions.parquet`: ticks with ground truth and predictions.
fn table_of(ticks: &JudgedTicks, predictions: &Predictions) -> TableWriter {
    let Predictions { names, answers, .. } = predictions;
    let known = |number: &f64| Some(*number).filter(|number| number.is_finite());
    let detections = answers.detections.as_ref();
    let detections = detections.map(|of| of.iter().copied().map(u32::from).collect());
    let mut table = judged_ticks(ticks.ticks(), detections, ticks.samples, ticks.rules);
    for (name, of) in names.iter().zip(&answers.by_estimator) {
        let column = format!("{name}_dtd_m");
        table = table.optional_f64(&column, of.distances_m.iter().map(known));
        for (end, suffix) in ["_from", "_to"].into_iter().enumerate() {
            if !of.intervals_m.is_empty() {
                let ends = of
                    .intervals_m
                    .iter()
                    .map(|interval_m| known(&interval_m[end]));
                table = table.optional_f64(&format!("{column}{suffix}"), ends);
            }
        }
    }
    table
}
