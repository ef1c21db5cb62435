//! `report.html`: the results of a run in one file that opens offline.
//!
//! The page is a template (`report/report.html`) in the shell of all pages (`report-page/`); its plots are SVG, drawn by [`plots`], and its
//! images are cut out of the corpus's videos, if they are there.
//! It begins with the recommended estimator. Figures of the paper are shown next to ours where it has them (its table 3).

mod examples;
pub(super) mod plots;
pub(super) mod tables;

use dataset::corpus::Corpus;
use dataset::corpus::splits::Side;
use dataset::files::json_file::write_unsynced;
use minijinja::{Value, context};
use report_page::chart::LegendEntry;
use report_page::page::{drawn, page, value};
use report_page::table::{Cell, Table};

use crate::error::Result;
use crate::evaluation::answers::{Answers, JudgedTicks};
use crate::evaluation::metrics::Metrics;
use crate::paper;
use crate::run::estimator::Estimator;
use crate::run::folder::RunFolder;
use crate::run::trained::TrainedRun;
use crate::samples::{DistanceRange, Samples};

pub(super) const MACROS: &str = include_str!("report/macros.html");
const TEMPLATE: &str = include_str!("report/report.html");
/// Maximum number of estimators in the charts of errors by distance: more lines cannot be distinguished.
pub(super) const CHARTED: usize = 5;

/// Evaluation results with their inputs.
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
    let flown = tables::best_covered_scenario(samples, ticks.ticks());
    let best = tables::best(&metrics.estimators, CHARTED);
    let names = tables::names(&metrics.estimators);
    let bins = best.iter().filter_map(|&number| {
        let of = metrics.estimators.get(Estimator::ALL[number].name())?;
        Some((number, &of.by_distance_nm[..]))
    });
    let bins: Vec<_> = bins.collect();
    let choice = &trained.summary.choice;
    let recommended = |estimator: &Estimator| estimator.name() == choice.estimator;
    let examples = match Estimator::ALL.iter().position(recommended) {
        Some(number) => {
            let outcomes = ticks.outcomes(answers, number);
            examples::examples(corpus, samples, ticks.ticks(), &outcomes)?
        }
        None => Vec::new(),
    };
    let headline = tables::headline(
        &metrics.estimators,
        (&choice.estimator, "recommended"),
        rules.bootstrap.share,
        true,
    );
    let estimators = &metrics.estimators;
    let page = page(
        "Distance to touchdown: evaluation",
        &[MACROS, TEMPLATE].concat(),
        context! {
            choice => value(choice),
            recommended => tables::tiles(&choice.estimator, estimators),
            headline => value(headline),
            has_oracle => estimators.contains_key(Estimator::Triangulation.name()),
            stated_intervals => tables::stated_intervals(estimators),
            methods => tables::methods(metrics),
            series => value(legend(&names, &best)),
            best_plot => drawn(plots::best_by_distance(&bins)),
            by_weather => value(tables::by_weather(estimators, &choice.estimator)),
            by_time => value(tables::by_time(estimators, &choice.estimator)),
            by_type => value(tables::by_type(estimators, &choice.estimator)),
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
            weather_at_aircraft => tables::weather_at_aircraft(&metrics.weather_at_aircraft),
            scenarios => value(scenarios(samples, rules.range())),
            split => value(&metrics.split),
            rules => value(rules),
            judged => value(&metrics.judged),
            ticks => value(metrics.ticks),
            disbelieved => metrics.disbelieved_boxes,
            cut_off => metrics.cut_off_boxes,
            removed => value(tables::removed(metrics, &choice.estimator)),
            flights => value(tables::flights(estimators)),
            examples,
            model => samples.detections.model.as_deref(),
            model_hash => samples.detections.hash.as_str(),
            absent => samples.absent_scenarios.len(),
            summary => value(&trained.summary),
            loss => value(trained.config.loss),
            version => env!("CARGO_PKG_VERSION"),
            flown => value(flown.map(|index| &samples.scenarios[index].id)),
            boxes_plot => drawn(plots::errors_by_distance(&bins)),
            convergence_plot => drawn(plots::convergence(&trained.convergence)),
            flight_plot => match flown {
                Some(index) => {
                    let of = |number| ticks.outcomes_of_scenario(index, answers, number);
                    drawn(plots::flight(of))
                }
                None => Value::UNDEFINED,
            },
        },
    )?;
    Ok(write_unsynced(&run.report_path(), page.as_bytes())?)
}

/// Legend entries; `shown` are indices of `names`.
pub(super) fn legend(names: &[&str], shown: &[usize]) -> Vec<LegendEntry> {
    let entry = |&number: &usize| LegendEntry::new(number, names[number]);
    shown.iter().map(entry).collect()
}

/// Scenarios with their ticks within the judged distances, and the share at which each view saw the aircraft.
fn scenarios(samples: &Samples, range: DistanceRange) -> Table {
    let mut table = Table::new("Scenarios")
        .words(["Scenario", "Trajectory", "Side", "Weather", "Time"])
        .numbers("", ["Ticks"])
        .numbers("Seen by, %", samples.views.iter().map(String::as_str));
    let none = (0, vec![0; samples.views.len()]);
    let mut counts = vec![none.clone(); samples.scenarios.len()];
    for sample in &samples.samples {
        if range.contains(sample.dtd_m) {
            let (ticks, by_view) = &mut counts[sample.scenario];
            *ticks += 1;
            for (view, _) in sample.seen() {
                by_view[view] += 1;
            }
        }
    }
    let mut all = none;
    for (scenario, (ticks, by_view)) in samples.scenarios.iter().zip(&counts) {
        let side = match scenario.side {
            Side::Train => "train",
            Side::Validation => "validation",
            Side::Test => "test",
        };
        let words = [
            &scenario.trajectory,
            side,
            &scenario.weather,
            &scenario.time_of_day,
        ];
        let cells = [Cell::code(&scenario.id)]
            .into_iter()
            .chain(words.map(Cell::from))
            .chain([Cell::from(*ticks)])
            .chain(by_view.iter().map(|&count| percent(count, *ticks).into()));
        table.row(cells);
        all.0 += ticks;
        for (sum, count) in all.1.iter_mut().zip(by_view) {
            *sum += count;
        }
    }
    let (ticks, by_view) = all;
    let words = ["All", "", "", "", ""].map(Cell::strong);
    let counts = by_view
        .iter()
        .map(|&count| Cell::strong(percent(count, ticks)));
    let counts = [Cell::strong(ticks.to_string())].into_iter().chain(counts);
    table.row(words.into_iter().chain(counts));
    table
}

fn percent(part: usize, whole: usize) -> String {
    report_page::percent((whole > 0).then(|| part as f64 / whole as f64), 1)
}
