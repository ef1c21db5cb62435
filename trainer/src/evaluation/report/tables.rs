//! The tables of the report as rows of strings.

use std::collections::BTreeSet;

use serde::Serialize;

use crate::evaluation::metrics::{
    ErrorFigures, EstimatorMetrics, FlightFigures, Metrics, SplitFigures,
};
use crate::run::estimator::{Description, Estimator};
use crate::samples::{Sample, Samples};

/// `MAPE` and `SD` of the paper's table 3 for a weather or a time: dual, then combination; percent.
const PAPER: [(&str, [f64; 4]); 9] = [
    ("clear", [0.10, 0.15, 0.18, 0.75]),
    ("cloudy", [0.22, 0.68, 0.30, 0.91]),
    ("foggy", [0.09, 0.09, 0.21, 0.70]),
    ("stormy", [0.11, 0.15, 0.18, 0.57]),
    ("06:00", [0.13, 0.27, 0.25, 0.79]),
    ("08:00", [0.14, 0.18, 0.23, 0.66]),
    ("12:00", [0.18, 0.52, 0.25, 0.75]),
    ("17:00", [0.16, 0.18, 0.23, 0.62]),
    ("18:00", [0.13, 0.14, 0.19, 0.55]),
];

/// One estimator.
#[derive(Serialize)]
pub(super) struct HeadlineRow {
    name: &'static str,
    title: &'static str,
    how: String,
    all: Cells,
    /// Of the MAPE.
    interval: String,
    in_sight: String,
    common: Cells,
    dual: Cells,
    stated: Option<StatedCells>,
}

/// How many of the intervals that an estimator states hold the truth, percent.
#[derive(Serialize)]
struct StatedCells {
    held: String,
    least: String,
    most: String,
}

/// Figures as text; an en dash where there are none.
#[derive(Serialize)]
struct Cells {
    mape: String,
    median: String,
    p95: String,
    sd: String,
    p95_m: String,
    coverage: String,
    samples: usize,
}

/// One estimator while views fail.
#[derive(Serialize)]
struct RemovedRow {
    name: &'static str,
    /// In the order of [`RemovedTable::removals`].
    figures: Vec<Cells>,
}

/// The weather at the aircraft, by name of the planned weather, in words.
pub(super) fn weather_at_aircraft(metrics: &Metrics) -> Vec<WeatherRow<'_>> {
    let weathers = metrics.weather_at_aircraft.iter();
    weathers
        .map(|(name, weather)| WeatherRow {
            name,
            reported: weather.to_string(),
            marked: weather.marked.keys().map(String::as_str).collect(),
        })
        .collect()
}

/// All estimators while views fail.
#[derive(Serialize)]
pub(super) struct RemovedTable {
    removals: Vec<String>,
    rows: Vec<RemovedRow>,
}

/// One flight: MAPE of every estimator.
#[derive(Serialize)]
pub(super) struct FlightRow {
    scenario: String,
    trajectory: String,
    ticks: usize,
    mapes: Vec<String>,
}

/// One weather or time.
#[derive(Serialize)]
pub(super) struct ConditionRow {
    kind: &'static str,
    name: String,
    dual: Cells,
    combination: Cells,
    paper: Option<[String; 4]>,
}

/// What simulators reported at the aircraft under one planned weather.
#[derive(Serialize)]
pub(super) struct WeatherRow<'a> {
    name: &'a str,
    reported: String,
    /// Identifiers of the scenarios in which it was not the planned weather.
    marked: Vec<&'a str>,
}

/// All estimators.
pub(super) fn headline(metrics: &Metrics) -> Vec<HeadlineRow> {
    Estimator::ALL
        .into_iter()
        .filter_map(|estimator| {
            let Description { name, title, how } = estimator.description();
            let of = metrics.estimators.get(name)?;
            let overall = &of.overall;
            let interval = of.intervals.map(|intervals| {
                let [low, high] = intervals.mape_pct.map(|end| format!("{end:.3}"));
                format!("{low} to {high}")
            });
            Some(HeadlineRow {
                name,
                title,
                how: match estimator {
                    Estimator::PaperLstm => format!("{how}; {}", faithfulness(metrics)),
                    _ => how.to_owned(),
                },
                all: cells(&overall.all),
                interval: interval.unwrap_or_else(|| NONE.into()),
                in_sight: share(overall.all.coverage_in_sight),
                common: cells(&of.common),
                dual: cells(&overall.dual),
                stated: of.stated_intervals.map(|stated| {
                    let [least, most] = stated.held_by_flight.map(|held| share(Some(held)));
                    let held = share(Some(stated.held));
                    StatedCells { held, least, most }
                }),
            })
        })
        .collect()
}

/// Whether `paper_lstm` is the paper's method, in words.
fn faithfulness(metrics: &Metrics) -> String {
    let deviations = metrics.deviations_from_paper.iter();
    let named: Vec<_> = deviations.map(ToString::to_string).collect();
    match named.as_slice() {
        [] => "trained as in the paper".into(),
        named => format!("deviates from the paper in: {}", named.join(", ")),
    }
}

/// The paper's table 3 for `paper_lstm`, with the paper's own figures where it has the condition.
pub(super) fn conditions(metrics: &Metrics) -> Vec<ConditionRow> {
    let Some(ours) = metrics.estimators.get(Estimator::PaperLstm.name()) else {
        return Vec::new();
    };
    let row = |kind, (name, figures): (&String, &SplitFigures)| ConditionRow {
        kind,
        name: name.clone(),
        dual: cells(&figures.dual),
        combination: cells(&figures.combination),
        paper: PAPER
            .iter()
            .find(|(condition, _)| condition == name)
            .map(|(_, figures)| figures.map(|figure| format!("{figure:.2}"))),
    };
    let weathers = ours.by_weather.iter().map(|entry| row("Weather", entry));
    weathers
        .chain(ours.by_time.iter().map(|entry| row("Time", entry)))
        .collect()
}

/// All estimators while views fail.
pub(super) fn removed(metrics: &Metrics) -> RemovedTable {
    let shown: Vec<(&'static str, &EstimatorMetrics)> = (Estimator::ALL.iter())
        .filter_map(|estimator| {
            let name = estimator.name();
            Some((name, metrics.estimators.get(name)?))
        })
        .collect();
    let names = shown.iter().flat_map(|(_, of)| of.views_removed.keys());
    let removals: BTreeSet<&String> = names.collect();
    let row = |&(name, of): &(&'static str, &EstimatorMetrics)| RemovedRow {
        name,
        figures: (removals.iter())
            .filter_map(|&removal| Some(cells(&of.views_removed.get(removal)?.all)))
            .collect(),
    };
    RemovedTable {
        rows: shown.iter().map(row).collect(),
        removals: removals.into_iter().cloned().collect(),
    }
}

/// MAPE by flight.
pub(super) fn flights(metrics: &Metrics) -> Vec<FlightRow> {
    let shown: Vec<&EstimatorMetrics> = (Estimator::ALL.iter())
        .filter_map(|estimator| metrics.estimators.get(estimator.name()))
        .collect();
    let first = shown.first().map_or(&[][..], |of| &of.by_flight);
    let row = |(flight, of_first): (usize, &FlightFigures)| FlightRow {
        scenario: of_first.scenario.clone(),
        trajectory: of_first.trajectory.clone(),
        ticks: of_first.figures.ticks,
        mapes: (shown.iter())
            .map(|of| percent(of.by_flight[flight].figures.mape_pct))
            .collect(),
    };
    first.iter().enumerate().map(row).collect()
}

/// Stands where there is no figure.
const NONE: &str = "–";

fn percent(value: Option<f64>) -> String {
    value.map_or(NONE.into(), |value| format!("{value:.3}"))
}

fn share(value: Option<f64>) -> String {
    value.map_or(NONE.into(), |value| format!("{:.1}", 100.0 * value))
}

fn cells(figures: &ErrorFigures) -> Cells {
    Cells {
        mape: percent(figures.mape_pct),
        median: percent(figures.median_pct),
        p95: percent(figures.p95_pct),
        sd: percent(figures.sd_pct),
        p95_m: figures
            .p95_m
            .map_or(NONE.into(), |error_m| format!("{error_m:.1}")),
        coverage: share(figures.coverage),
        samples: figures.samples,
    }
}

/// The test scenario with the most samples: the best one to plot.
pub(super) fn best_covered_scenario(samples: &Samples, test: &[&Sample]) -> Option<usize> {
    let count = |index: usize| {
        test.iter()
            .filter(|sample| sample.scenario == index)
            .count()
    };
    (0..samples.scenarios.len())
        .filter(|&index| count(index) > 0)
        .max_by_key(|&index| count(index))
}
