//! `report.html`: the results of a run in one file that opens offline.
//!
//! The page is a template (`report/report.html`) in the look of all pages (`report-page/`); its plots are SVG, drawn by [`plots`], and its
//! images are cut out of the corpus's videos, if they are there.
//! It begins with the recommended estimator. Figures of the paper are shown next to ours where it has them (its table 3).

mod examples;
pub(super) mod plots;
pub(super) mod tables;

use dataset::corpus::Corpus;
use dataset::corpus::splits::Side;
use dataset::files::json_file::write_unsynced;
use minijinja::{Value, context};
use report_page::chart::css_colour;
use report_page::page::{drawn, render, value};
use serde::Serialize;

use crate::error::Result;
use crate::evaluation::answers::{Answers, JudgedTicks};
use crate::evaluation::metrics::Metrics;
use crate::paper;
use crate::run::estimator::Estimator;
use crate::run::folder::RunFolder;
use crate::run::trained::TrainedRun;
use crate::samples::{DistanceRange, Samples};

const TEMPLATE: &str = concat!(
    include_str!("report/macros.html"),
    include_str!("report/report.html")
);
/// Maximum number of estimators in the charts of errors by distance: more lines cannot be distinguished.
pub(super) const CHARTED: usize = 5;

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

/// Results of an evaluation, with their inputs.
pub(crate) struct Results<'a> {
    /// Corpus with the images.
    pub corpus: &'a Corpus,
    pub trained: &'a TrainedRun,
    pub samples: &'a Samples,
    /// The ticks that count.
    pub ticks: &'a JudgedTicks<'a>,
    /// Answers at these ticks, with all views.
    pub answers: &'a Answers,
    pub metrics: &'a Metrics,
}

/// Writes the report of an evaluation.
pub(crate) fn write(run: &RunFolder, results: &Results) -> Result<()> {
    let Results {
        corpus,
        trained,
        samples,
        ticks,
        answers,
        metrics,
    } = *results;
    let rules = &metrics.rules;
    let seen = ticks_seen(samples, rules.range());
    let flown = tables::best_covered_scenario(samples, ticks.ticks());
    let best = tables::best(&metrics.estimators, CHARTED);
    let names = tables::names(&metrics.estimators);
    let bins = best.iter().filter_map(|&number| {
        let of = metrics.estimators.get(Estimator::ALL[number].name())?;
        Some((number, &of.by_distance_nm[..]))
    });
    let bins: Vec<_> = bins.collect();
    let recommended = |estimator: &Estimator| estimator.name() == trained.summary.choice.estimator;
    let examples = match Estimator::ALL.iter().position(recommended) {
        Some(number) => {
            let outcomes = ticks.outcomes(answers, number);
            examples::examples(corpus, samples, ticks.ticks(), &outcomes)?
        }
        None => Vec::new(),
    };
    let page = render(
        TEMPLATE,
        context! {
            recommendation => value(tables::recommendation(&trained.summary.choice, metrics)),
            headline => value(tables::headline(&metrics.estimators)),
            methods => value(tables::methods(metrics)),
            legend => value(legend(&names, &best)),
            best_plot => drawn(plots::best_by_distance(&bins)?),
            by_weather => value(tables::by_weather(&metrics.estimators)),
            by_time => value(tables::by_time(&metrics.estimators)),
            conditions => value(tables::conditions(metrics)),
            against_one_view => value(tables::against_one_view(metrics)),
            stages => value(tables::stages(metrics)),
            paper => context! {
                mape_pct => paper::MAPE_PCT,
                mono_mape_pct => paper::MONO_MAPE_PCT,
                reduction_pct => paper::REDUCTION_PCT,
                epochs => paper::EPOCHS,
                training_hours => paper::TRAINING_HOURS,
            },
            weather_at_aircraft => value(tables::weather_at_aircraft(&metrics.weather_at_aircraft)),
            scenarios => value(scenario_rows(samples, &seen)),
            views => value(&samples.views),
            detected_total => value(detected_total(samples, &seen)),
            split => value(&metrics.split),
            rules => value(rules),
            judged => value(&metrics.judged),
            ticks => value(metrics.ticks),
            disbelieved => metrics.disbelieved_boxes,
            cut_off => metrics.cut_off_boxes,
            removed => value(tables::removed(metrics)),
            flights => value(tables::flights(&metrics.estimators)),
            examples => value(examples),
            model => samples.detections.model.as_deref(),
            model_hash => samples.detections.hash.as_str(),
            absent => samples.absent_scenarios.len(),
            summary => value(&trained.summary),
            loss => value(trained.config.loss),
            version => env!("CARGO_PKG_VERSION"),
            flown => value(flown.map(|index| &samples.scenarios[index].id)),
            boxes_plot => drawn(plots::errors_by_distance(&bins)?),
            convergence_plot => drawn(plots::convergence(&trained.convergence)?),
            flight_plot => match flown {
                Some(index) => {
                    let of = |number| ticks.outcomes_of_scenario(index, answers, number);
                    drawn(plots::flight(of)?)
                }
                None => Value::UNDEFINED,
            },
        },
    )?;
    Ok(write_unsynced(&run.report_path(), page.as_bytes())?)
}

/// An estimator's colour in the plots.
#[derive(Serialize)]
pub(super) struct LegendEntry<'a> {
    colour: String,
    is_hollow: bool,
    name: &'a str,
}

/// Entries of the estimators of these numbers, as places in `names`.
pub(super) fn legend<'a>(names: &[&'a str], shown: &[usize]) -> Vec<LegendEntry<'a>> {
    let entry = |&number: &usize| LegendEntry {
        colour: css_colour(number),
        is_hollow: plots::is_hollow(number),
        name: names[number],
    };
    shown.iter().map(entry).collect()
}

/// Ticks of a scenario within the judged distances.
#[derive(Clone, Default)]
struct TicksSeen {
    all: usize,
    /// Those at which each view saw the aircraft.
    by_view: Vec<usize>,
}

fn ticks_seen(samples: &Samples, range: DistanceRange) -> Vec<TicksSeen> {
    let none = TicksSeen {
        all: 0,
        by_view: vec![0; samples.views.len()],
    };
    let mut seen = vec![none; samples.scenarios.len()];
    for sample in &samples.samples {
        if range.contains(sample.dtd_m) {
            let TicksSeen { all, by_view } = &mut seen[sample.scenario];
            *all += 1;
            for (count, found) in by_view.iter_mut().zip(&sample.boxes) {
                *count += usize::from(found.is_some());
            }
        }
    }
    seen
}

fn scenario_rows<'a>(samples: &'a Samples, seen: &[TicksSeen]) -> Vec<ScenarioRow<'a>> {
    samples
        .scenarios
        .iter()
        .zip(seen)
        .map(|(scenario, seen)| ScenarioRow {
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
            ticks: seen.all,
            detected_pct: seen
                .by_view
                .iter()
                .map(|&count| percent(count, seen.all))
                .collect(),
        })
        .collect()
}

fn detected_total(samples: &Samples, seen: &[TicksSeen]) -> Vec<String> {
    let ticks = seen.iter().map(|scenario| scenario.all).sum();
    let by_view = |view: usize| seen.iter().map(|scenario| scenario.by_view[view]).sum();
    (0..samples.views.len())
        .map(|view| percent(by_view(view), ticks))
        .collect()
}

fn percent(part: usize, whole: usize) -> String {
    if whole == 0 {
        "–".into()
    } else {
        format!("{:.1}", part as f64 / whole as f64 * 100.0)
    }
}
