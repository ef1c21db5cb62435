//! Tables of the estimators' errors.

use std::collections::BTreeMap;

use report_page::table::Table;
use report_page::{optional, percent};
use trainer::paper::{
    EPOCHS, MAPE_PCT, MONO_MAPE_PCT, PaperCondition, REDUCTION_PCT, TABLE_3, TRAINING_HOURS,
};
use trainer::{EndedBy, ErrorFigures, EstimatorMetrics, Metrics, SplitFigures};

use crate::results::{PAPER, Results};

/// The formula that knows the true cameras, on the same boxes.
const FROM_BOXES: &str = "triangulation";
/// The formula that sees the same boxes, and the registered shifts between the views.
const WITH_SHIFTS: &str = "inverse_range";
/// Monoscopic networks.
const MONOSCOPIC: [&str; 3] = ["mono_network", "mono_network_position", "mono_network_box"];
/// Weathers among the conditions of table 3; the others are local times.
const WEATHERS: usize = 4;
/// Starts of the nautical miles around the step of the profile.
const NEAR_STEP_NM: [f64; 2] = [6.0, 7.0];
/// Decimals in percentage errors.
const DECIMALS: usize = 3;

/// Our estimator that also answers ticks with a single view.
const FILTERED: &str = "inverse_range_filtered";
/// Minimum share of answered ticks.
const ANSWERED: f64 = 0.99;

/// Mean and standard deviation of the absolute percentage error.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Error {
    mape_pct: f64,
    sd_pct: Option<f64>,
}

/// The error over all ticks; `None` if the estimator does not answer them.
fn answered(of: Option<&ErrorFigures>) -> Option<Error> {
    error(of.filter(|of| of.samples as f64 >= ANSWERED * of.ticks as f64)?)
}

/// The error over the ticks that the estimator answers.
fn error(of: &ErrorFigures) -> Option<Error> {
    Some(Error {
        mape_pct: of.mape_pct?,
        sd_pct: of.sd_pct,
    })
}

/// Errors of two views, and of at least one.
fn of_views(of: &SplitFigures) -> [Option<Error>; 2] {
    [
        answered(of.dual.as_ref()),
        answered(of.combination.as_ref()),
    ]
}

/// Errors in one weather or at one local time.
fn in_condition(of: &EstimatorMetrics, name: &str) -> [Option<Error>; 2] {
    let figures = of.by_weather.get(name).or_else(|| of.by_time.get(name));
    figures.map_or([None; 2], of_views)
}

fn overall(of: &EstimatorMetrics) -> [Option<Error>; 2] {
    of_views(&of.overall)
}

/// Figures for an estimator, `None` if it is unknown.
fn figures(
    metrics: &Metrics,
    estimator: &str,
    of: impl Fn(&EstimatorMetrics) -> [Option<Error>; 2],
) -> [Option<Error>; 2] {
    metrics.estimators.get(estimator).map_or([None; 2], of)
}

/// Table 3: by weather and by local time, beside the paper's.
pub(super) fn by_condition(results: &Results) -> String {
    let best = &results.recommended;
    let names = [best, FILTERED].map(|name| format!("`{name}`, other flights"));
    let mut table = Table::new("").words([
        "condition (table 3)",
        "paper",
        "`paper_lstm`, scenarios drawn",
        "over the paper's",
        "`paper_lstm`, other flights",
        &names[0],
        &names[1],
    ]);
    let mut row = |name: &str,
                   published: [Option<Error>; 2],
                   of: &dyn Fn(&EstimatorMetrics) -> [Option<Error>; 2]| {
        let drawn = figures(&results.by_scenario, PAPER, of);
        table.row([
            name.into(),
            joined(&published, 2),
            joined(&drawn, DECIMALS),
            ratio(drawn, published),
            joined(&figures(&results.by_trajectory, PAPER, of), DECIMALS),
            joined(&figures(&results.by_trajectory, best, of), DECIMALS),
            joined(&figures(&results.by_trajectory, FILTERED, of), DECIMALS),
        ]);
    };
    for PaperCondition {
        name,
        dual_pct,
        combination_pct,
    } in TABLE_3
    {
        let stated = [dual_pct, combination_pct].map(|[mape_pct, sd_pct]| {
            Some(Error {
                mape_pct,
                sd_pct: Some(sd_pct),
            })
        });
        row(name, stated, &|estimator| in_condition(estimator, name));
    }
    row("all", [None; 2], &overall);
    let other = figures(&results.by_trajectory, PAPER, overall);
    let drawn = figures(&results.by_scenario, PAPER, overall);
    let points = [0, 1].map(|views| {
        let difference = other[views].zip(drawn[views]);
        difference.map_or_else(
            || "–".into(),
            |(other, drawn)| format!("{:+.DECIMALS$}", other.mape_pct - drawn.mape_pct),
        )
    });
    let interval = results
        .by_scenario
        .estimators
        .get(PAPER)
        .and_then(|of| of.intervals.as_ref());
    let interval = interval.map_or_else(String::new, |of| {
        let [from, to] = of.mape_pct;
        format!(" (90 % confidence over flights: {from:.DECIMALS$} to {to:.DECIMALS$})")
    });
    format!(
        "## Errors by weather and local time\n\n{}\n\n\
         Ticks that two views see / that at least one sees. A dash: the estimator does not answer all of these ticks, or there are none. The\n\
         paper's overall MAPE is {MAPE_PCT} %, and it does not say over which ticks; `paper_lstm` has {} %{interval} over those that at least\n\
         one view sees, scenarios drawn.\n\n\
         `dtd train corpus --out run` keeps the scenarios of a flight together; with `--split-by-scenario 0.3` scenarios are drawn, as in\n\
         the paper, and {} of {} test scenarios share their flight with the training. On other flights the MAPE of `paper_lstm`\n\
         differs by {} points from its MAPE with drawn scenarios: one draw, one seed, other test scenarios.",
        table.markdown(),
        optional(drawn[1].map(|of| of.mape_pct), DECIMALS),
        results.by_scenario.split.test_scenarios_sharing_flights,
        results.by_scenario.split.test.scenarios,
        points.join(" / ")
    )
}

/// Ours over theirs.
fn ratio(ours: [Option<Error>; 2], published: [Option<Error>; 2]) -> String {
    let ratios = [0, 1].map(|views| {
        let both = ours[views].zip(published[views]);
        optional(
            both.map(|(ours, theirs)| ours.mape_pct / theirs.mape_pct),
            1,
        )
    });
    ratios.join(" / ")
}

fn joined(values: &[Option<Error>], decimals: usize) -> String {
    let cell = |value: Option<Error>| {
        let mape = optional(value.map(|of| of.mape_pct), decimals);
        match value.and_then(|of| of.sd_pct) {
            Some(sd_pct) => format!("{mape} ({sd_pct:.decimals$})"),
            None => mape,
        }
    };
    let cells: Vec<String> = values.iter().copied().map(cell).collect();
    cells.join(" / ")
}

/// Table by weather and time.
pub(super) fn by_cell(results: &Results) -> String {
    let Some(of) = results.by_scenario.estimators.get(PAPER) else {
        return String::new();
    };
    let (weathers, times) = TABLE_3.split_at(WEATHERS);
    let heading: Vec<&str> = ["weather"]
        .into_iter()
        .chain(times.iter().map(|time| time.name))
        .collect();
    let mut table = Table::new("").words(heading);
    for weather in weathers {
        let cells = times.iter().map(|time| {
            let cell = of
                .by_weather_and_time
                .get(&format!("{} {}", weather.name, time.name));
            let [dual, _] = cell.map_or([None; 2], of_views);
            optional(dual.map(|of| of.mape_pct), DECIMALS)
        });
        table.row([weather.name.to_owned()].into_iter().chain(cells));
    }
    format!(
        "`paper_lstm` by both, where two views see the aircraft, scenarios drawn:\n\n{}",
        table.markdown()
    )
}

/// Table by distance.
pub(super) fn by_distance(results: &Results) -> String {
    let metrics = &results.by_scenario;
    let shown: Vec<&str> = [PAPER]
        .into_iter()
        .chain(MONOSCOPIC)
        .chain([&*results.recommended])
        .collect();
    let mut bins: BTreeMap<u32, Vec<Option<f64>>> = BTreeMap::new();
    let mut ticks: BTreeMap<u32, usize> = BTreeMap::new();
    for (column, name) in shown.iter().enumerate() {
        let Some(of) = metrics.estimators.get(*name) else {
            continue;
        };
        for bin in &of.by_distance_nm {
            let cells = bins
                .entry(bin.from_nm.round() as u32)
                .or_insert_with(|| vec![None; shown.len()]);
            cells[column] = bin.figures.mape_pct;
            if *name == PAPER {
                ticks.insert(bin.from_nm.round() as u32, bin.figures.samples);
            }
        }
    }
    let names: Vec<String> = shown.iter().map(|name| format!("`{name}`")).collect();
    let heading: Vec<&str> = ["from, NM", "ticks of `paper_lstm`"]
        .into_iter()
        .chain(names.iter().map(String::as_str))
        .collect();
    let mut table = Table::new("").words(heading);
    for (nm, cells) in bins {
        let cells = cells.into_iter().map(|value| optional(value, DECIMALS));
        let answered = ticks.get(&nm).copied().unwrap_or_default();
        let start = [nm.to_string(), answered.to_string()];
        table.row(start.into_iter().chain(cells));
    }
    let near = |name: &str, is_near: bool| {
        let bins = metrics.estimators.get(name)?.by_distance_nm.iter();
        let bins = bins.filter(|bin| NEAR_STEP_NM.contains(&bin.from_nm.round()) == is_near);
        let answered = bins.filter_map(|bin| Some((bin.figures.mape_pct?, bin.figures.samples)));
        let (sum, count) = answered.fold((0.0, 0), |(sum, count), (mape_pct, samples)| {
            (sum + mape_pct * samples as f64, count + samples)
        });
        (count > 0).then(|| sum / count as f64)
    };
    let told = [PAPER, MONOSCOPIC[0]].map(|name| {
        let [step, elsewhere] =
            [true, false].map(|is_near| optional(near(name, is_near), DECIMALS));
        format!("`{name}` has {step} % from 6 to 8 NM and {elsewhere} % elsewhere")
    });
    format!(
        "## Errors by distance\n\n{}\n\n\
         MAPE, scenarios drawn; each estimator over the ticks that it answers. In the paper the errors near 7 NM, where its flights descend\n\
         between two levels, exceed its monoscopic model's and reach 0.75 %. Here {}.",
        table.markdown(),
        told.join(", ")
    )
}

/// All estimators, and those that see one view.
pub(super) fn all(results: &Results) -> String {
    let mut table = Table::new("").words([
        "estimator",
        "scenarios drawn",
        "other flights",
        "coverage, other flights, %",
    ]);
    for (name, of) in &results.by_trajectory.estimators {
        let cell = |of: &EstimatorMetrics| {
            let [dual, combination] = overall(of);
            joined(&[dual, combination, error(&of.overall.all)], DECIMALS)
        };
        let drawn = results.by_scenario.estimators.get(name);
        table.row([
            format!("`{name}`"),
            drawn.map_or_else(|| "–".into(), cell),
            cell(of),
            percent(of.overall.all.coverage, 1),
        ]);
    }
    let mut against = Table::new("").words([
        "one view, network on, scenarios drawn",
        "MAPE, mean of the views",
        "error of `paper_lstm` is lower by, %",
    ]);
    against.row([
        "paper: size".into(),
        MONO_MAPE_PCT.to_string(),
        format!("{REDUCTION_PCT:.0}, as it states"),
    ]);
    for one in &results.by_scenario.against_one_view {
        against.row([
            one.inputs.clone(),
            optional(one.mean_pct, DECIMALS),
            optional(one.reduction_pct, 0),
        ]);
    }
    let [dual, combination] = figures(&results.by_scenario, WITH_SHIFTS, overall)
        .map(|of| optional(of.map(|of| of.mape_pct), DECIMALS));
    let of_two_views = |name| figures(&results.by_scenario, name, overall)[0].map(|of| of.mape_pct);
    let from_boxes = of_two_views(FROM_BOXES);
    let suffice = match (from_boxes, of_two_views(PAPER)) {
        (Some(formula), Some(network)) if formula < network => {
            ", so the boxes suffice for less than the error of `paper_lstm`"
        }
        _ => "",
    };
    let from_boxes = optional(from_boxes, DECIMALS);
    format!(
        "## All estimators\n\n{}\n\n\
         Two views / at least one / all ticks that the estimator answers, whose share is the coverage. Filter and smoother also answer\n\
         where no view sees the aircraft. `no_vision_time` and `no_vision_time_weather` see no image: the mean distance of the training\n\
         flights by time since the start, and by weather. An estimator that does no better has learned nothing from the images.\n\n\
         `{WITH_SHIFTS}` has {dual} % (two views) and {combination} % (at least one) from the boxes of `paper_lstm` and the registered shifts\n\
         between the views, which `paper_lstm` does not get. `{FROM_BOXES}` has {from_boxes} % (two views) from the boxes and the true\n\
         cameras{suffice}.\n\n{}\n\n\
         Each network over the ticks of its view, `paper_lstm` over the ticks of at least one view.",
        table.markdown(),
        against.markdown()
    )
}

/// While views are missing.
pub(super) fn single_views(results: &Results) -> String {
    let metrics = &results.by_trajectory;
    let removals = metrics.estimators.get(PAPER).into_iter();
    let mut removals: Vec<&String> = removals.flat_map(|of| of.views_removed.keys()).collect();
    // Bursts by their length.
    removals.sort_by_key(|name| (seconds_in(name), (*name).clone()));
    let names = removals.iter().map(|name| name.replace('_', " "));
    let names: Vec<String> = names.map(|name| name.replace(" pct", " %")).collect();
    let heading: Vec<&str> = ["views removed, other flights"]
        .into_iter()
        .chain(names.iter().map(String::as_str))
        .collect();
    let mut table = Table::new("").words(heading);
    for name in [PAPER, &*results.recommended] {
        let Some(of) = metrics.estimators.get(name) else {
            continue;
        };
        let cells = removals.iter().map(|removal| {
            let of = of.views_removed.get(*removal);
            optional(of.and_then(|of| of.all.mape_pct), DECIMALS)
        });
        table.row([format!("`{name}`")].into_iter().chain(cells));
    }
    table.markdown()
}

/// Seconds in a removal's name.
fn seconds_in(name: &str) -> Option<u32> {
    let words = name.split('_').collect::<Vec<_>>();
    let seconds = words.windows(2).find(|pair| pair[1] == "s")?[0];
    seconds.parse().ok()
}

/// Note on a training of the paper's estimator that the limit of steps ended while its error still fell; empty if it did not.
pub(super) fn still_falling(results: &Results) -> String {
    let stages = &results.by_scenario.training.stages;
    let of_paper = stages.iter().find(|stage| stage.network == PAPER);
    let fall_pct = of_paper.and_then(|stage| match &stage.cycles[..] {
        [.., before, last] if stage.ended_by == EndedBy::Steps => {
            let before_pct = before.validation_mape_pct.first().copied().flatten()?;
            Some(before_pct - last.validation_mape_pct.first().copied().flatten()?)
        }
        _ => None,
    });
    match fall_pct {
        Some(fall_pct) if fall_pct > 0.0 => format!(
            "; it reached its limit of steps while its validation error still fell (by {fall_pct:.DECIMALS$} points in the last [cycle](#training))"
        ),
        _ => String::new(),
    }
}

/// Steps of the trainings, and the reasons why they ended.
pub(super) fn training(results: &Results) -> String {
    let mut table = Table::new("").words([
        "networks, scenarios drawn",
        "steps",
        "passes over the data",
        "validation MAPE at the ends of the last two cycles, %",
        "ended by",
    ]);
    table.row([
        "paper".into(),
        String::new(),
        format!("{EPOCHS} at most"),
        String::new(),
        format!("number of epochs; about {TRAINING_HOURS:.0} h on an RTX 3080"),
    ]);
    let stages = &results.by_scenario.training.stages;
    for stage in stages {
        let view = stage
            .view
            .as_deref()
            .map(|view| format!(", {view}"))
            .unwrap_or_default();
        let last_two = &stage.cycles[stage.cycles.len().saturating_sub(2)..];
        let ends = last_two.iter().map(|cycle| {
            let errors = cycle.validation_mape_pct.iter();
            let errors: Vec<String> = errors.map(|error| optional(*error, DECIMALS)).collect();
            errors.join(" and ")
        });
        table.row([
            format!("{}{view}", stage.network),
            stage.steps.to_string(),
            format!("{:.0}", stage.passes),
            ends.collect::<Vec<_>>().join("; "),
            format!("{:?}", stage.ended_by).to_lowercase(),
        ]);
    }
    format!(
        "## Training\n\n{}\n\nMini-batches of {} samples; {:.0} minutes for all networks and formulas. `plateau`: a cycle of the learning rate,\n\
         each twice as long as the one before, lowered no validation error by more than the threshold (0.01 points unless set); `steps`: the limit was reached.",
        table.markdown(),
        stages.first().map_or(0, |stage| stage.batch_size),
        results.by_scenario.training.training_s / 60.0
    )
}
