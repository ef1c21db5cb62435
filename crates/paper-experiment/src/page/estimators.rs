//! Tables of the estimators' errors.

use std::collections::BTreeMap;

use trainer::paper::{MAPE_PCT, MONO_MAPE_PCT, PaperCondition, REDUCTION_PCT, TABLE_3};
use trainer::{EstimatorMetrics, Metrics};

use super::table::{Table, number};
use crate::results::Results;

/// The paper's estimator.
const PAPER: &str = "paper_lstm";
/// Monoscopic networks.
const MONOSCOPIC: [&str; 3] = ["mono_network", "mono_network_position", "mono_network_box"];
/// Weathers among the conditions of table 3; the others are local times.
const WEATHERS: usize = 4;
/// Decimals of a percentage error.
const DECIMALS: usize = 3;

/// MAPE of two views, and of at least one, in a weather or at a local time.
fn in_condition(of: &EstimatorMetrics, name: &str) -> [Option<f64>; 2] {
    let figures = of.by_weather.get(name).or_else(|| of.by_time.get(name));
    [
        figures.and_then(|of| of.dual.as_ref()?.mape_pct),
        figures.and_then(|of| of.combination.as_ref()?.mape_pct),
    ]
}

/// The same of all ticks.
fn overall(of: &EstimatorMetrics) -> [Option<f64>; 2] {
    let pair = [of.overall.dual.as_ref(), of.overall.combination.as_ref()];
    pair.map(|of| of?.mape_pct)
}

/// Figures of an estimator, or none if it is unknown.
fn figures(
    metrics: &Metrics,
    estimator: &str,
    of: impl Fn(&EstimatorMetrics) -> [Option<f64>; 2],
) -> [Option<f64>; 2] {
    metrics.estimators.get(estimator).map_or([None; 2], of)
}

/// Table 3: by weather and by local time, beside the paper's.
pub(super) fn by_condition(results: &Results) -> String {
    let best = &results.recommended;
    let ours = format!("`{best}`, other flights");
    let mut table = Table::new(&[
        "two views / at least one (table 3)",
        "paper",
        "`paper_lstm`, scenarios drawn",
        "over the paper's",
        "`paper_lstm`, other flights",
        &ours,
    ]);
    let mut row = |name: &str,
                   published: [Option<f64>; 2],
                   of: &dyn Fn(&EstimatorMetrics) -> [Option<f64>; 2]| {
        let drawn = figures(&results.by_scenario, PAPER, of);
        table.row([
            name.into(),
            pair(published, 2),
            pair(drawn, DECIMALS),
            pair(ratio(drawn, published), 1),
            pair(figures(&results.by_trajectory, PAPER, of), DECIMALS),
            pair(figures(&results.by_trajectory, best, of), DECIMALS),
        ]);
    };
    for PaperCondition {
        name,
        dual_pct,
        combination_pct,
    } in TABLE_3
    {
        let stated = [dual_pct[0], combination_pct[0]].map(Some);
        row(name, stated, &|estimator| in_condition(estimator, name));
    }
    row("all", [Some(MAPE_PCT), None], &overall);
    let shared = figures(&results.by_trajectory, PAPER, overall)
        .into_iter()
        .zip(figures(&results.by_scenario, PAPER, overall))
        .map(|(other, drawn)| Some(other? - drawn?));
    let shared: Vec<String> = shared.map(|points| number(points, DECIMALS)).collect();
    format!(
        "## Errors by weather and local time\n\n{}\n\n\
         `dtd train corpus --out run` keeps the scenarios of a flight together; with `--split-by-scenario 0.3` scenarios are drawn, as in\n\
         the paper, so that most test flights also train. That is worth {} points.",
        table.markdown(),
        shared.join(" / ")
    )
}

/// Ours over theirs.
fn ratio(ours: [Option<f64>; 2], published: [Option<f64>; 2]) -> [Option<f64>; 2] {
    [0, 1].map(|number| Some(ours[number]? / published[number]?))
}

fn pair(values: [Option<f64>; 2], decimals: usize) -> String {
    values.map(|value| number(value, decimals)).join(" / ")
}

/// By weather and time.
pub(super) fn by_cell(results: &Results) -> String {
    let Some(of) = results.by_scenario.estimators.get(PAPER) else {
        return String::new();
    };
    let (weathers, times) = TABLE_3.split_at(WEATHERS);
    let heading: Vec<&str> = ["two views"]
        .into_iter()
        .chain(times.iter().map(|time| time.name))
        .collect();
    let mut table = Table::new(&heading);
    for weather in weathers {
        let cells = times.iter().map(|time| {
            let cell = of
                .by_weather_and_time
                .get(&format!("{} {}", weather.name, time.name));
            number(cell.and_then(|of| of.dual.as_ref()?.mape_pct), DECIMALS)
        });
        table.row([weather.name.to_owned()].into_iter().chain(cells));
    }
    format!(
        "`paper_lstm` by both, scenarios drawn:\n\n{}",
        table.markdown()
    )
}

/// By distance.
pub(super) fn by_distance(results: &Results) -> String {
    let metrics = &results.by_scenario;
    let shown: Vec<&str> = [PAPER]
        .into_iter()
        .chain(MONOSCOPIC)
        .chain([&*results.recommended])
        .collect();
    let mut bins: BTreeMap<u32, Vec<Option<f64>>> = BTreeMap::new();
    for (column, name) in shown.iter().enumerate() {
        let Some(of) = metrics.estimators.get(*name) else {
            continue;
        };
        for bin in &of.by_distance_nm {
            let cells = bins
                .entry(bin.from_nm.round() as u32)
                .or_insert_with(|| vec![None; shown.len()]);
            cells[column] = bin.figures.mape_pct;
        }
    }
    let names: Vec<String> = shown.iter().map(|name| format!("`{name}`")).collect();
    let heading: Vec<&str> = ["from, NM"]
        .into_iter()
        .chain(names.iter().map(String::as_str))
        .collect();
    let mut table = Table::new(&heading);
    for (nm, cells) in bins {
        let cells = cells.into_iter().map(|value| number(value, DECIMALS));
        table.row([nm.to_string()].into_iter().chain(cells));
    }
    format!(
        "## Errors by distance\n\n{}\n\n\
         Scenarios drawn. In the paper the error of two views exceeds the monoscopic one near 7 NM, by up to 0.75 %, where its flights\n\
         descend between two levels.",
        table.markdown()
    )
}

/// All estimators, and those that see one view.
pub(super) fn all(results: &Results) -> String {
    let mut table = Table::new(&[
        "estimator",
        "scenarios drawn",
        "other flights",
        "coverage, %",
    ]);
    for (name, of) in &results.by_trajectory.estimators {
        let drawn = figures(&results.by_scenario, name, overall);
        table.row([
            format!("`{name}`"),
            pair(drawn, DECIMALS),
            pair(overall(of), DECIMALS),
            number(of.overall.all.coverage.map(|share| 100.0 * share), 1),
        ]);
    }
    let mut against = Table::new(&[
        "one view, network on",
        "MAPE, mean of the views",
        "`paper_lstm` has less, %",
    ]);
    against.row([
        "paper: size".into(),
        MONO_MAPE_PCT.to_string(),
        format!("{REDUCTION_PCT:.0}"),
    ]);
    for one in &results.by_scenario.against_one_view {
        against.row([
            one.inputs.clone(),
            number(one.mean_pct, DECIMALS),
            number(one.reduction_pct, 0),
        ]);
    }
    format!(
        "## All estimators\n\n{}\n\n\
         Two views / at least one. `no_vision_time` and `no_vision_time_weather` see no picture: the mean distance of the training flights\n\
         by time since the start, and by weather; what does not beat them has learned the flights.\n\n{}",
        table.markdown(),
        against.markdown()
    )
}

/// While views are missing.
pub(super) fn single_views(results: &Results) -> String {
    let metrics = &results.by_trajectory;
    let removals = metrics.estimators.get(PAPER).into_iter();
    let removals: Vec<&String> = removals.flat_map(|of| of.views_removed.keys()).collect();
    let names: Vec<String> = removals.iter().map(|name| name.replace('_', " ")).collect();
    let heading: Vec<&str> = ["views removed, other flights"]
        .into_iter()
        .chain(names.iter().map(String::as_str))
        .collect();
    let mut table = Table::new(&heading);
    for name in [PAPER, &*results.recommended] {
        let Some(of) = metrics.estimators.get(name) else {
            continue;
        };
        let cells = removals.iter().map(|removal| {
            let of = of.views_removed.get(*removal);
            number(of.and_then(|of| of.all.mape_pct), DECIMALS)
        });
        table.row([format!("`{name}`")].into_iter().chain(cells));
    }
    table.markdown()
}

/// Steps of the trainings, and the reasons why they ended.
pub(super) fn training(results: &Results) -> String {
    let mut table = Table::new(&[
        "networks",
        "steps",
        "kept step",
        "passes over the data",
        "ended by",
    ]);
    table.row([
        "paper".into(),
        String::new(),
        String::new(),
        "225,000 at most".into(),
        "Algorithm 1; about 2 h on an RTX 3080".into(),
    ]);
    let stages = &results.by_scenario.training.stages;
    for stage in stages {
        let view = stage
            .view
            .as_deref()
            .map(|view| format!(", {view}"))
            .unwrap_or_default();
        table.row([
            format!("{}{view}", stage.network),
            stage.steps.to_string(),
            stage.kept_step.to_string(),
            format!("{:.0}", stage.passes),
            format!("{:?}", stage.ended_by).to_lowercase(),
        ]);
    }
    format!(
        "## Training\n\n{}\n\nMini-batches of {} samples; {:.0} minutes for all networks and formulas.",
        table.markdown(),
        stages.first().map_or(0, |stage| stage.batch_size),
        results.by_scenario.training.training_s / 60.0
    )
}
