//! The tables of the report.

use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet};

use minijinja::{Value, context};
use report_page::table::{Cell, Table, or_dash};
use report_page::{optional, percent};

use dataset::corpus::effective_weather::ReportedWeather;

use crate::evaluation::metrics::{
    ErrorFigures, EstimatorMetrics, FlightFigures, Metrics, SplitFigures,
};
use crate::networks::stage::{Cycle, EndedBy};
use crate::paper::TABLE_3;
use crate::run::estimator::{Description, Estimator, Standing};
use crate::samples::{Sample, Samples};

/// Figures by name of the estimator.
type ByEstimator = BTreeMap<String, EstimatorMetrics>;

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

    /// CSS class of its rows.
    fn class(&self, best: &str) -> &'static str {
        match self.standing() {
            Standing::Oracle | Standing::NoVision => "oracle",
            Standing::Competitor if self.name == best => "best",
            Standing::Competitor => "",
        }
    }
}

/// The estimators in the order of tables and charts: first this software's, then others by name.
fn shown(estimators: &ByEstimator) -> Vec<Shown<'_>> {
    let own = |name: &str| {
        let mut all = Estimator::ALL.into_iter();
        all.find(|estimator| estimator.name() == name)
    };
    let entries = estimators.iter();
    let mut shown: Vec<Shown<'_>> = entries
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

/// Weather that simulators reported at the aircraft, by name of the planned weather, with the scenarios that were drawn under different
/// weather.
pub(in crate::evaluation) fn weather_at_aircraft(
    reported: &BTreeMap<String, ReportedWeather>,
) -> Vec<Value> {
    let row = |(name, weather): (&String, &ReportedWeather)| {
        let marked: Value = weather.marked.keys().collect();
        context! { name, reported => weather.to_string(), marked }
    };
    reported.iter().map(row).collect()
}

/// An estimator's figures above the tables; `None` for an unknown estimator.
pub(in crate::evaluation) fn tiles(name: &str, estimators: &ByEstimator) -> Option<Value> {
    let of = estimators.get(name)?;
    let all = &of.overall.all;
    let mut own = Estimator::ALL.map(Estimator::description).into_iter();
    Some(context! {
        name,
        title => own.find(|one| one.name == name).map_or("", |one| one.title),
        mape => error(all.mape_pct),
        interval => interval(of),
        p95 => error(all.p95_pct),
        p95_m => optional(all.p95_m, 1),
        coverage => percent(all.coverage, 1),
        in_sight => percent(all.coverage_in_sight, 1),
    })
}

/// Ends of the interval of the MAPE.
fn interval(of: &EstimatorMetrics) -> String {
    or_dash(of.intervals.map(|ends| {
        let [low, high] = ends.mape_pct.map(|end| format!("{end:.3}"));
        format!("{low} to {high}")
    }))
}

/// Numbers of the competitors, in the order of [`names`], with the smallest errors over the common ticks, the best first; and of the
/// paper's method.
pub(in crate::evaluation) fn best(estimators: &ByEstimator, most: usize) -> Vec<usize> {
    let shown = shown(estimators).into_iter().enumerate();
    let competitors = shown.filter(|(_, shown)| shown.standing() == Standing::Competitor);
    let errors =
        competitors.filter_map(|(number, shown)| Some((shown.of.common.mape_pct?, number)));
    let mut errors: Vec<(f64, usize)> = errors.collect();
    errors.sort_by(|one, other| one.0.total_cmp(&other.0));
    let is_paper = |number: usize| names(estimators)[number] == Estimator::PaperLstm.name();
    let ranks = errors.into_iter().map(|one| one.1).enumerate();
    let charted = ranks.filter(|(rank, number)| *rank < most || is_paper(*number));
    charted.map(|(_, number)| number).collect()
}

/// Errors of all estimators. `best` is the highlighted one, with the reason; `interval_share` is the share of the intervals.
pub(in crate::evaluation) fn headline(
    estimators: &ByEstimator,
    (best, best_is): (&str, &str),
    interval_share: f64,
    has_dual: bool,
) -> Table {
    let of_interval = format!("its {:.0} % interval", 100.0 * interval_share);
    let all = ["MAPE", &of_interval, "median", "95 %", "SD", "95 %, m"];
    let mut table = Table::new("Errors of all estimators")
        .words(["Estimator"])
        .numbers("Error of all answers, % unless in metres", all)
        .numbers("Coverage, %", ["all", "in sight"])
        .numbers("Common ticks", ["MAPE, %"]);
    if has_dual {
        table = table.numbers("Dual", ["MAPE, %", "ticks"]);
    }
    let mut rows = shown(estimators);
    rows.sort_by_key(|shown| shown.name != best);
    for shown in rows {
        let of = shown.of;
        let (all, dual) = (&of.overall.all, of.overall.dual.as_ref());
        let title = shown.own.map_or("", |own| own.description().title);
        let note = if shown.name == best && !title.is_empty() {
            format!("{title}, {best_is}")
        } else {
            title.to_owned()
        };
        let mut row: Vec<Cell> = vec![Cell::code(shown.name).with_note(note)];
        row.extend(
            [
                error(all.mape_pct),
                interval(of),
                error(all.median_pct),
                error(all.p95_pct),
                error(all.sd_pct),
                optional(all.p95_m, 1),
                percent(all.coverage, 1),
                percent(all.coverage_in_sight, 1),
                error(of.common.mape_pct),
            ]
            .map(Cell::from),
        );
        if has_dual {
            row.push(error(dual.and_then(|dual| dual.mape_pct)).into());
            row.push(or_dash(dual.map(|dual| dual.samples.to_string())).into());
        }
        table.row(row).class = shown.class(best);
    }
    table
}

/// Share of the stated intervals that contain the true value, percent, for the estimators that state any.
pub(in crate::evaluation) fn stated_intervals(estimators: &ByEstimator) -> Vec<Value> {
    let stated = |shown: Shown<'_>| {
        let stated = shown.of.stated_intervals?;
        let [least, most] = stated.held_by_flight.map(|held| percent(Some(held), 1));
        let held = percent(Some(stated.held), 1);
        Some(context! { name => shown.name, held, least, most })
    };
    shown(estimators).into_iter().filter_map(stated).collect()
}

/// The estimators' methods.
pub(super) fn methods(metrics: &Metrics) -> Vec<Value> {
    let own = shown(&metrics.estimators)
        .into_iter()
        .filter_map(|shown| shown.own);
    own.map(|estimator| {
        let Description { name, how, .. } = estimator.description();
        let how = match estimator {
            Estimator::PaperLstm => format!("{how}; {}", faithfulness(metrics)),
            _ => how.to_owned(),
        };
        context! { name, how }
    })
    .collect()
}

/// States in words how `paper_lstm` differs from the paper's method.
fn faithfulness(metrics: &Metrics) -> String {
    let deviations = metrics.deviations_from_paper.iter();
    let named: Vec<_> = deviations.map(ToString::to_string).collect();
    format!("deviates from the paper in: {}", named.join(", "))
}

/// The paper's table 3 for `paper_lstm`, with the paper's own figures where it has the condition.
pub(super) fn conditions(metrics: &Metrics) -> Table {
    let figures = ["MAPE %", "SD %", "samples", "paper", "its SD"];
    let mut table = Table::new("Errors beside the paper's")
        .words(["By", "Condition"])
        .numbers("Dual", figures)
        .numbers("Combination", figures);
    let Some(ours) = metrics.estimators.get(Estimator::PaperLstm.name()) else {
        return table;
    };
    let weathers = ours.by_weather.iter().map(|entry| ("Weather", entry));
    let times = ours.by_time.iter().map(|entry| ("Time", entry));
    for (kind, (name, figures)) in weathers.chain(times) {
        let of_paper = TABLE_3.iter().find(|condition| condition.name == name);
        let mut row: Vec<Cell> = vec![kind.into(), name.as_str().into()];
        for (ours, paper) in [
            (figures.dual, of_paper.map(|paper| paper.dual_pct)),
            (
                figures.combination,
                of_paper.map(|paper| paper.combination_pct),
            ),
        ] {
            row.push(error(ours.and_then(|ours| ours.mape_pct)).into());
            row.push(error(ours.and_then(|ours| ours.sd_pct)).into());
            row.push(or_dash(ours.map(|ours| ours.samples.to_string())).into());
            for place in 0..2 {
                row.push(Cell::quoted(optional(paper.map(|paper| paper[place]), 2)));
            }
        }
        table.row(row);
    }
    table
}

/// `paper_lstm` against networks that see one view; `None` without such networks.
pub(super) fn against_one_view(metrics: &Metrics) -> Option<Table> {
    let views = metrics.against_one_view.first()?.mape_by_view_pct.iter();
    let mut table = Table::new("Errors of single views")
        .words(["Estimator", "Inputs"])
        .numbers(
            "MAPE, %",
            views.map(|(view, _)| view.as_str()).chain(["mean"]),
        )
        .numbers("", ["paper_lstm has less, %"]);
    for row in &metrics.against_one_view {
        let by_view = row.mape_by_view_pct.iter();
        let cells = [Cell::code(&row.estimator), row.inputs.as_str().into()]
            .into_iter()
            .chain(by_view.map(|(_, mape_pct)| error(*mape_pct).into()))
            .chain([error(row.mean_pct), optional(row.reduction_pct, 0)].map(Cell::from));
        table.row(cells);
    }
    Some(table)
}

/// The stages of the training.
pub(super) fn stages(metrics: &Metrics) -> Table {
    let cycles = "Validation MAPE at the ends of its cycles, %";
    let mut table = Table::new("Stages of the training")
        .words(["Networks", "View"])
        .numbers("", ["Steps", "kept after", "batch", "passes"])
        .words(["Ended by", cycles]);
    let errors = |cycle: &Cycle| {
        let errors = cycle.validation_mape_pct.iter();
        errors.map(|of| error(*of)).collect::<Vec<_>>().join(" / ")
    };
    for stage in &metrics.training.stages {
        let cycles: Vec<String> = stage.cycles.iter().map(errors).collect();
        table.row([
            stage.network.clone(),
            stage.view.clone().unwrap_or_else(|| "all".to_owned()),
            stage.steps.to_string(),
            stage.kept_step.to_string(),
            stage.batch_size.to_string(),
            format!("{:.0}", stage.passes),
            match stage.ended_by {
                EndedBy::Plateau => "its plateau",
                EndedBy::Steps => "the number of steps",
            }
            .to_owned(),
            cycles.join(", "),
        ]);
    }
    table
}

/// All estimators while views fail; `None` if none was removed.
pub(super) fn removed(metrics: &Metrics, best: &str) -> Option<Table> {
    let all = metrics.estimators.values();
    let is_any = all.into_iter().any(|of| !of.views_removed.is_empty());
    let by_removal = |of: &EstimatorMetrics| {
        let removals = of.views_removed.iter();
        let of = removals.map(|(name, figures)| (name.clone(), figures.all));
        of.collect()
    };
    is_any.then(|| {
        figures(
            "Errors while views fail",
            &metrics.estimators,
            best,
            by_removal,
        )
    })
}

/// All estimators by weather.
pub(in crate::evaluation) fn by_weather(estimators: &ByEstimator, best: &str) -> Table {
    figures("Errors by weather", estimators, best, |of| {
        overall(&of.by_weather)
    })
}

/// All estimators by aircraft type; without rows if all scenarios have the same.
pub(in crate::evaluation) fn by_type(estimators: &ByEstimator, best: &str) -> Table {
    figures("Errors by aircraft type", estimators, best, |of| {
        overall(&of.by_type)
    })
}

/// All estimators by local time.
pub(in crate::evaluation) fn by_time(estimators: &ByEstimator, best: &str) -> Table {
    figures("Errors by time of day", estimators, best, |of| {
        overall(&of.by_time)
    })
}

fn overall(figures: &BTreeMap<String, SplitFigures>) -> BTreeMap<String, ErrorFigures> {
    let of = |(name, figures): (&String, &SplitFigures)| (name.clone(), figures.all);
    figures.iter().map(of).collect()
}

fn figures(
    label: &'static str,
    estimators: &ByEstimator,
    best: &str,
    by: impl Fn(&EstimatorMetrics) -> BTreeMap<String, ErrorFigures>,
) -> Table {
    let shown = shown(estimators).into_iter();
    let shown: Vec<_> = shown.map(|shown| (by(shown.of), shown)).collect();
    let names = shown.iter().flat_map(|(figures, _)| figures.keys());
    let names: BTreeSet<&String> = names.collect();
    let mut names: Vec<&String> = names.into_iter().collect();
    names.sort_by(|one, other| by_number(one, other));
    let mut table = Table::new(label).words(["Estimator"]);
    for name in &names {
        table = table.numbers(name, ["MAPE %", "coverage %"]);
    }
    if names.is_empty() {
        return table;
    }
    for (figures, shown) in &shown {
        let note = match shown.standing() {
            Standing::Competitor => "",
            Standing::Oracle => "oracle",
            Standing::NoVision => "no vision",
        };
        let of = names.iter().map(|name| figures.get(*name));
        let cells = of.flat_map(|of| {
            let mape = error(of.and_then(|of| of.mape_pct));
            [mape, percent(of.and_then(|of| of.coverage), 1)].map(Cell::from)
        });
        let first = Cell::code(shown.name).with_note(note);
        table.row([first].into_iter().chain(cells)).class = shown.class(best);
    }
    table
}

/// Sorts `bursts_5_s` before `bursts_20_s`: by the text before the first digit, by the number there, and by the rest.
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
pub(in crate::evaluation) fn flights(estimators: &ByEstimator) -> Table {
    let shown = shown(estimators);
    let mut table = Table::new("Errors by flight")
        .words(["Scenario", "Trajectory"])
        .numbers("", ["Ticks"])
        .numbers("MAPE, %", shown.iter().map(|one| one.name));
    let first = shown.first().map_or(&[][..], |one| &one.of.by_flight);
    for (flight, of_first) in first.iter().enumerate() {
        let FlightFigures {
            scenario,
            trajectory,
            figures,
            ..
        } = of_first;
        let cells = [
            Cell::code(scenario),
            trajectory.as_str().into(),
            figures.ticks.into(),
        ];
        let of = |one: &Shown<'_>| error(one.of.by_flight[flight].figures.mape_pct).into();
        table.row(cells.into_iter().chain(shown.iter().map(of)));
    }
    table
}

/// A percentage error.
fn error(error_pct: Option<f64>) -> String {
    optional(error_pct, 3)
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
