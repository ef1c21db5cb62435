//! `report.html`: the results of a run in one file that opens offline.
//!
//! The page is a template (`report/report.html`) in the look of all pages (`report-page/`); its plots are SVG, drawn by [`plots`].
//! Figures of the paper are shown next to ours where it has them (its table 3).

mod plots;
mod tables;

use dataset::json_file::write_unsynced;
use dataset::splits::Side;
use minijinja::{Value, context};
use report_page::chart::css_colour;
use report_page::page::{drawn, render, value};
use serde::Serialize;

use crate::error::Result;
use crate::metrics::{EstimatorOutcomes, Metrics};
use crate::run_folder::RunFolder;
use crate::samples::{Sample, Samples};
use crate::trained_run::TrainedRun;

const TEMPLATE: &str = include_str!("report/report.html");

/// A scenario in the data summary.
#[derive(Serialize)]
struct ScenarioRow<'a> {
    id: &'a str,
    trajectory: &'a str,
    side: String,
    weather: &'a str,
    time_of_day: &'a str,
    ticks: usize,
    detected_pct: Vec<String>,
}

/// Writes the report of an evaluation.
pub(crate) fn write(
    run: &RunFolder,
    trained: &TrainedRun,
    samples: &Samples,
    test: &[&Sample],
    shown: &[EstimatorOutcomes],
    metrics: &Metrics,
    bin_nm: f64,
) -> Result<()> {
    let flown = tables::best_covered_scenario(samples, test);
    let page = render(
        TEMPLATE,
        context! {
            headline => value(tables::headline(metrics)),
            legend => value(legend(shown)),
            conditions => value(tables::conditions(metrics)),
            scenarios => value(scenario_rows(samples)),
            views => value(&samples.views),
            detected_total => value(detected_total(samples)),
            split => value(&metrics.split),
            model => samples.detections.model.as_deref(),
            model_hash => samples.detections.hash.as_str(),
            absent => samples.absent_scenarios.len(),
            summary => value(&trained.summary),
            loss => value(trained.config.loss),
            version => env!("CARGO_PKG_VERSION"),
            max_dtd => value(metrics.split.max_dtd_nm),
            flown => value(flown.map(|index| &samples.scenarios[index].id)),
            boxes_plot => drawn(plots::errors_by_distance(shown, bin_nm)?),
            convergence_plot => drawn(plots::convergence(&trained.convergence)?),
            flight_plot => match flown {
                Some(index) => drawn(plots::flight(shown, test, index)?),
                None => Value::UNDEFINED,
            },
        },
    )?;
    Ok(write_unsynced(&run.report_path(), page.as_bytes())?)
}

/// An estimator's colour in the plots.
#[derive(Serialize)]
struct LegendEntry {
    colour: String,
    title: &'static str,
}

fn legend(shown: &[EstimatorOutcomes]) -> Vec<LegendEntry> {
    let entry = |(which, shown): (usize, &EstimatorOutcomes)| LegendEntry {
        colour: css_colour(which),
        title: shown.estimator.description().title,
    };
    shown.iter().enumerate().map(entry).collect()
}

fn scenario_rows(samples: &Samples) -> Vec<ScenarioRow<'_>> {
    let row = |scenario: &crate::samples::ScenarioSummary| -> Vec<String> {
        scenario
            .detected_ticks
            .iter()
            .map(|&seen| percent(seen, scenario.ticks))
            .collect()
    };
    samples
        .scenarios
        .iter()
        .map(|scenario| ScenarioRow {
            id: &scenario.id,
            trajectory: &scenario.trajectory,
            side: match scenario.side {
                Side::Train => "train",
                Side::Validation => "validation",
                Side::Test => "test",
            }
            .into(),
            weather: &scenario.weather,
            time_of_day: &scenario.time_of_day,
            ticks: scenario.ticks,
            detected_pct: row(scenario),
        })
        .collect()
}

fn detected_total(samples: &Samples) -> Vec<String> {
    let ticks = samples
        .scenarios
        .iter()
        .map(|scenario| scenario.ticks)
        .sum();
    (0..samples.views.len())
        .map(|view| {
            percent(
                samples
                    .scenarios
                    .iter()
                    .map(|scenario| scenario.detected_ticks[view])
                    .sum(),
                ticks,
            )
        })
        .collect()
}

fn percent(part: usize, whole: usize) -> String {
    if whole == 0 {
        "–".into()
    } else {
        format!("{:.1}", part as f64 / whole as f64 * 100.0)
    }
}
