//! The tables of the report as rows of strings.

use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use dataset::corpus::effective_weather::ReportedWeather;

use crate::evaluation::metrics::{
    ErrorFigures, EstimatorMetrics, FlightFigures, Metrics, SplitFigures,
};
use crate::networks::stage::{Cycle, EndedBy};
use crate::paper::TABLE_3;
use crate::run::choice::Choice;
use crate::run::estimator::{Description, Estimator, Standing};
use crate::samples::{Sample, Samples};

/// The recommended estimator.
#[derive(Serialize)]
pub(super) struct Recommendation<'a> {
    name: &'a str,
    title: &'static str,
    reason: &'a str,
    /// `None` if it was not evaluated.
    all: Option<Cells>,
    interval: String,
    in_sight: String,
}

/// Figures by name of the estimator.
type ByEstimator = BTreeMap<String, EstimatorMetrics>;

/// An estimator of a report.
struct Shown<'a> {
    name: &'a str,
    /// `None` for an estimator of others.
    own: Option<Estimator>,
    of: &'a EstimatorMetrics,
}

impl Shown<'_> {
    fn standing(&self) -> Standing {
        self.own.map_or(Standing::Competitor, Estimator::standing)
    }
}

/// The estimators in the order of tables and charts: first this software's, then others by name.
fn shown(estimators: &ByEstimator) -> Vec<Shown<'_>> {
    let own = |name: &str| {
        let mut all = Estimator::ALL.into_iter();
        all.find(|estimator| estimator.name() == name)
    };
    let entries = estimators.iter();
    let mut shown: Vec<Shown> = entries
        .map(|(name, of)| Shown {
            name,
            own: own(name),
            of,
        })
        .collect();
    let place = |own: Option<Estimator>| {
        own.and_then(|own| Estimator::ALL.iter().position(|other| *other == own))
            .unwrap_or(usize::MAX)
    };
    shown.sort_by_key(|shown| place(shown.own));
    shown
}

/// Names of the estimators, in the order of tables and charts.
pub(in crate::evaluation) fn names(estimators: &ByEstimator) -> Vec<&str> {
    let shown = shown(estimators).into_iter();
    shown.map(|shown| shown.name).collect()
}

/// The method of an estimator.
#[derive(Serialize)]
pub(super) struct Method {
    name: &'static str,
    how: String,
}

/// One estimator.
#[derive(Serialize)]
pub(in crate::evaluation) struct HeadlineRow {
    name: String,
    title: &'static str,
    standing: Standing,
    all: Cells,
    /// Of the MAPE.
    interval: String,
    in_sight: String,
    common: Cells,
    dual: Option<Cells>,
    stated: Option<StatedCells>,
}

/// Share of an estimator's stated intervals that contain the true value, percent.
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

/// Figures of every estimator, in columns by something.
#[derive(Serialize)]
pub(in crate::evaluation) struct FiguresTable {
    columns: Vec<String>,
    rows: Vec<FiguresRow>,
}

/// One estimator.
#[derive(Serialize)]
struct FiguresRow {
    name: String,
    standing: Standing,
    /// In the order of [`FiguresTable::columns`].
    figures: Vec<Cells>,
}

/// The weather at the aircraft, by name of the planned weather, in words.
pub(in crate::evaluation) fn weather_at_aircraft(
    reported: &BTreeMap<String, ReportedWeather>,
) -> Vec<WeatherRow<'_>> {
    let weathers = reported.iter();
    weathers
        .map(|(name, weather)| WeatherRow {
            name,
            reported: weather.to_string(),
            marked: weather.marked.keys().map(String::as_str).collect(),
        })
        .collect()
}

/// One flight: MAPE of every estimator.
#[derive(Serialize)]
pub(in crate::evaluation) struct FlightRow {
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
    dual: Option<Cells>,
    combination: Option<Cells>,
    paper: Option<[String; 4]>,
}

/// Weather that simulators reported at the aircraft under one planned weather.
#[derive(Serialize)]
pub(in crate::evaluation) struct WeatherRow<'a> {
    name: &'a str,
    reported: String,
    /// Identifiers of the scenarios in which it was not the planned weather.
    marked: Vec<&'a str>,
}

/// The recommended estimator with its figures.
pub(super) fn recommendation<'a>(choice: &'a Choice, metrics: &Metrics) -> Recommendation<'a> {
    let description = Estimator::ALL.map(Estimator::description);
    let title = description.iter().find(|one| one.name == choice.estimator);
    let of = metrics.estimators.get(&choice.estimator);
    Recommendation {
        name: &choice.estimator,
        title: title.map_or("", |one| one.title),
        reason: &choice.reason,
        all: of.map(|of| cells(&of.overall.all)),
        interval: interval(of),
        in_sight: share(of.and_then(|of| of.overall.all.coverage_in_sight)),
    }
}

/// Ends of the interval of the MAPE.
fn interval(of: Option<&EstimatorMetrics>) -> String {
    let ends = of.and_then(|of| Some(of.intervals?.mape_pct));
    ends.map_or(NONE.into(), |ends| {
        let [low, high] = ends.map(|end| format!("{end:.3}"));
        format!("{low} to {high}")
    })
}

/// Numbers of the estimators, in the order of [`names`], with the smallest errors over the common ticks, the best first. Neither the oracle
/// nor an estimator without vision is one of them.
pub(in crate::evaluation) fn best(estimators: &ByEstimator, most: usize) -> Vec<usize> {
    let shown = shown(estimators).into_iter().enumerate();
    let competitors = shown.filter(|(_, shown)| shown.standing() == Standing::Competitor);
    let errors =
        competitors.filter_map(|(number, shown)| Some((shown.of.common.mape_pct?, number)));
    let mut errors: Vec<(f64, usize)> = errors.collect();
    errors.sort_by(|one, other| one.0.total_cmp(&other.0));
    errors.into_iter().take(most).map(|one| one.1).collect()
}

/// All estimators.
pub(in crate::evaluation) fn headline(estimators: &ByEstimator) -> Vec<HeadlineRow> {
    let row = |shown: Shown| {
        let of = shown.of;
        let overall = &of.overall;
        HeadlineRow {
            name: shown.name.to_owned(),
            title: shown.own.map_or("", |own| own.description().title),
            standing: shown.standing(),
            all: cells(&overall.all),
            interval: interval(Some(of)),
            in_sight: share(overall.all.coverage_in_sight),
            common: cells(&of.common),
            dual: overall.dual.as_ref().map(cells),
            stated: of.stated_intervals.map(|stated| {
                let [least, most] = stated.held_by_flight.map(|held| share(Some(held)));
                let held = share(Some(stated.held));
                StatedCells { held, least, most }
            }),
        }
    };
    shown(estimators).into_iter().map(row).collect()
}

/// The methods of a run's estimators.
pub(super) fn methods(metrics: &Metrics) -> Vec<Method> {
    let own = shown(&metrics.estimators)
        .into_iter()
        .filter_map(|shown| shown.own);
    own.map(|estimator| {
        let Description { name, how, .. } = estimator.description();
        let how = match estimator {
            Estimator::PaperLstm => format!("{how}; {}", faithfulness(metrics)),
            _ => how.to_owned(),
        };
        Method { name, how }
    })
    .collect()
}

/// States in words whether `paper_lstm` is the paper's method.
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
        dual: figures.dual.as_ref().map(cells),
        combination: figures.combination.as_ref().map(cells),
        paper: TABLE_3
            .iter()
            .find(|condition| condition.name == name)
            .map(|condition| {
                let [[dual, dual_sd], [combination, combination_sd]] =
                    [condition.dual_pct, condition.combination_pct];
                [dual, dual_sd, combination, combination_sd].map(|figure| format!("{figure:.2}"))
            }),
    };
    let weathers = ours.by_weather.iter().map(|entry| row("Weather", entry));
    weathers
        .chain(ours.by_time.iter().map(|entry| row("Time", entry)))
        .collect()
}

/// A monoscopic network.
#[derive(Serialize)]
pub(super) struct OneViewRow<'a> {
    name: &'a str,
    inputs: &'a str,
    /// By view, as text.
    by_view: Vec<(&'a str, String)>,
    mean: String,
    reduction: String,
}

/// `paper_lstm` against networks that see one view.
pub(super) fn against_one_view(metrics: &Metrics) -> Vec<OneViewRow<'_>> {
    let rows = metrics.against_one_view.iter();
    rows.map(|row| OneViewRow {
        name: &row.estimator,
        inputs: &row.inputs,
        by_view: (row.mape_by_view_pct.iter())
            .map(|(view, mape_pct)| (view.as_str(), percent(*mape_pct)))
            .collect(),
        mean: percent(row.mean_pct),
        reduction: row
            .reduction_pct
            .map_or(NONE.into(), |part| format!("{part:.0}")),
    })
    .collect()
}

/// A stage of the training.
#[derive(Serialize)]
pub(super) struct StageRow<'a> {
    network: &'a str,
    view: Option<&'a str>,
    steps: usize,
    kept_step: usize,
    batch_size: usize,
    passes: String,
    ended_by: &'static str,
    /// Validation errors at the ends of its cycles.
    cycles: String,
}

/// The stages of the training.
pub(super) fn stages(metrics: &Metrics) -> Vec<StageRow<'_>> {
    let errors = |cycle: &Cycle| {
        let errors = cycle.validation_mape_pct.iter();
        errors
            .map(|error| percent(*error))
            .collect::<Vec<_>>()
            .join(" / ")
    };
    let stages = metrics.training.stages.iter();
    stages
        .map(|stage| StageRow {
            network: &stage.network,
            view: stage.view.as_deref(),
            steps: stage.steps,
            kept_step: stage.kept_step,
            batch_size: stage.batch_size,
            passes: format!("{:.0}", stage.passes),
            ended_by: match stage.ended_by {
                EndedBy::Plateau => "its plateau",
                EndedBy::Steps => "the number of steps",
            },
            cycles: stage
                .cycles
                .iter()
                .map(errors)
                .collect::<Vec<_>>()
                .join(", "),
        })
        .collect()
}

/// All estimators while views fail.
pub(super) fn removed(metrics: &Metrics) -> FiguresTable {
    let by_removal = |of: &EstimatorMetrics| {
        let removals = of.views_removed.iter();
        removals
            .map(|(name, figures)| (name.clone(), figures.all))
            .collect()
    };
    figures_table(&metrics.estimators, by_removal)
}

/// All estimators by weather.
pub(in crate::evaluation) fn by_weather(estimators: &ByEstimator) -> FiguresTable {
    figures_table(estimators, |of| overall(&of.by_weather))
}

/// All estimators by local time.
pub(in crate::evaluation) fn by_time(estimators: &ByEstimator) -> FiguresTable {
    figures_table(estimators, |of| overall(&of.by_time))
}

fn overall(figures: &BTreeMap<String, SplitFigures>) -> BTreeMap<String, ErrorFigures> {
    let of = |(name, figures): (&String, &SplitFigures)| (name.clone(), figures.all);
    figures.iter().map(of).collect()
}

fn figures_table(
    estimators: &ByEstimator,
    by: impl Fn(&EstimatorMetrics) -> BTreeMap<String, ErrorFigures>,
) -> FiguresTable {
    let shown: Vec<(Shown, BTreeMap<String, ErrorFigures>)> = (shown(estimators).into_iter())
        .map(|shown| {
            let figures = by(shown.of);
            (shown, figures)
        })
        .collect();
    let names = shown.iter().flat_map(|(_, figures)| figures.keys());
    let mut columns: Vec<String> = names
        .cloned()
        .collect::<BTreeSet<_>>()
        .into_iter()
        .collect();
    columns.sort_by(|one, other| by_number(one, other));
    let row = |(shown, figures): &(Shown, BTreeMap<String, ErrorFigures>)| FiguresRow {
        name: shown.name.to_owned(),
        standing: shown.standing(),
        figures: (columns.iter())
            .map(|name| figures.get(name).map_or_else(Cells::none, cells))
            .collect(),
    };
    FiguresTable {
        rows: shown.iter().map(row).collect(),
        columns,
    }
}

/// Sorts `bursts_5_s` before `bursts_20_s`: by what is before the first digit, by the number there, and by the rest.
fn by_number(one: &str, other: &str) -> Ordering {
    let parts = |name: &str| -> (String, f64, String) {
        let is_digit = |c: char| c.is_ascii_digit() || c == '.';
        let begin = name.find(is_digit).unwrap_or(name.len());
        let (words, rest) = name.split_at(begin);
        let end = rest.find(|c| !is_digit(c)).unwrap_or(rest.len());
        let (digits, rest) = rest.split_at(end);
        (
            words.into(),
            digits.parse().unwrap_or_default(),
            rest.into(),
        )
    };
    let (one, other) = (parts(one), parts(other));
    let by_words = one.0.cmp(&other.0);
    by_words
        .then(one.1.total_cmp(&other.1))
        .then(one.2.cmp(&other.2))
}

/// MAPE by flight.
pub(in crate::evaluation) fn flights(estimators: &ByEstimator) -> Vec<FlightRow> {
    let shown: Vec<&EstimatorMetrics> = (shown(estimators).into_iter())
        .map(|shown| shown.of)
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

impl Cells {
    /// Cells of an estimator without figures.
    fn none() -> Self {
        let none = || NONE.to_owned();
        Self {
            mape: none(),
            median: none(),
            p95: none(),
            sd: none(),
            p95_m: none(),
            coverage: none(),
            samples: 0,
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bursts_are_sorted_by_their_length() {
        let mut names = [
            "bursts_20_s",
            "only_left",
            "bursts_5_s",
            "bursts_60_s",
            "bursts_0.5_s",
        ];
        names.sort_by(|one, other| by_number(one, other));
        let sorted = [
            "bursts_0.5_s",
            "bursts_5_s",
            "bursts_20_s",
            "bursts_60_s",
            "only_left",
        ];
        assert_eq!(names, sorted);
        assert_eq!(by_number("06:00", "18:00"), Ordering::Less);
    }
}
