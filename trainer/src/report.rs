//! `report.html`: the results of a run in one file that opens offline.
//!
//! The page is a template (`report/report.html`); its plots are SVG, drawn by [`plots`] and inserted into it. Figures of the paper
//! are shown next to ours where it has them (its table 3).

mod plots;
mod tables;

use dataset::json_file::write_unsynced;
use dataset::splits::Side;
use minijinja::value::Serde;
use minijinja::{Environment, Value, context};
use serde::Serialize;

use crate::error::{Error, Result};
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
    let page = render(context! {
        headline => Value::from(Serde(tables::headline(metrics))),
        legend => Value::from(Serde(legend(shown))),
        conditions => Value::from(Serde(tables::conditions(metrics))),
        scenarios => Value::from(Serde(scenario_rows(samples))),
        views => Value::from(Serde(&samples.views)),
        detected_total => Value::from(Serde(detected_total(samples))),
        split => Value::from(Serde(&metrics.split)),
        model_hash => samples.model_hash.as_str(),
        absent => samples.absent_scenarios.len(),
        summary => Value::from(Serde(&trained.summary)),
        loss => Value::from(Serde(&trained.config.loss)),
        version => env!("CARGO_PKG_VERSION"),
        max_dtd => Value::from(Serde(&metrics.split.max_dtd_nm)),
        flown => Value::from(Serde(flown.map(|index| &samples.scenarios[index].id))),
        boxes_plot => Value::from_safe_string(plots::errors_by_distance(shown, bin_nm)?),
        convergence_plot => Value::from_safe_string(plots::convergence(&trained.convergence)?),
        flight_plot => match flown {
            Some(index) => Value::from_safe_string(plots::flight(shown, test, index)?),
            None => Value::UNDEFINED,
        },
    })?;
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
        colour: plots::css_colour(which),
        title: shown.estimator.description().title,
    };
    shown.iter().enumerate().map(entry).collect()
}

fn render(values: Value) -> Result<String> {
    let mut environment = Environment::new();
    environment.set_undefined_behavior(minijinja::UndefinedBehavior::SemiStrict);
    environment
        .add_template("report.html", TEMPLATE)
        .map_err(Error::Page)?;
    environment
        .get_template("report.html")
        .and_then(|template| template.render(values))
        .map_err(Error::Page)
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
