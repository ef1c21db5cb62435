//! The tables of the report as rows of strings.

use serde::Serialize;

use crate::estimator::{Description, Estimator};
use crate::metrics::{ErrorFigures, Metrics, SplitFigures};
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
    how: &'static str,
    dual: Cells,
    combination: Cells,
}

/// Figures as text; an en dash where there are none.
#[derive(Serialize)]
struct Cells {
    mape: String,
    sd: String,
    samples: usize,
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

/// All estimators, dual and combination.
pub(super) fn headline(metrics: &Metrics) -> Vec<HeadlineRow> {
    Estimator::ALL
        .into_iter()
        .filter_map(|estimator| {
            let Description { name, title, how } = estimator.description();
            let overall = &metrics.estimators.get(name)?.overall;
            Some(HeadlineRow {
                name,
                title,
                how,
                dual: cells(&overall.dual),
                combination: cells(&overall.combination),
            })
        })
        .collect()
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

fn cells(figures: &ErrorFigures) -> Cells {
    let word = |value: Option<f64>| value.map_or("–".into(), |value| format!("{value:.2}"));
    Cells {
        mape: word(figures.mape_pct),
        sd: word(figures.sd_pct),
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
