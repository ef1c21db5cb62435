//! `report.html` of a table of predictions: the charts and tables of a run's report that need no run.

use dataset::files::json_file::write_unsynced;
use minijinja::context;
use report_page::page::{drawn, page, value};

use super::TableMetrics;
use crate::error::Result;
use crate::evaluation::report::{CHARTED, MACROS, legend, plots, tables};
use crate::run::folder::RunFolder;

const TEMPLATE: &str = include_str!("report.html");

/// Writes the report of an evaluation.
pub(super) fn write(folder: &RunFolder, metrics: &TableMetrics) -> Result<()> {
    let TableMetrics {
        rules,
        judged,
        split,
        ticks,
        weather_at_aircraft,
        estimators,
    } = metrics;
    let names = tables::names(estimators);
    let best = tables::best(estimators, CHARTED);
    let bins: Vec<_> = best
        .iter()
        .map(|&number| (number, &estimators[names[number]].by_distance_nm[..]))
        .collect();
    let first = best.first().map_or("", |&number| names[number]);
    let has_dual = ticks.seen.is_some();
    let headline = tables::headline(
        estimators,
        (first, "smallest error"),
        rules.bootstrap.share,
        has_dual,
    );
    let page = page(
        &format!(
            "Distance to touchdown: predictions of {}",
            judged.predictions
        ),
        &[MACROS, TEMPLATE].concat(),
        context! {
            best => tables::tiles(first, estimators),
            headline => value(headline),
            estimators => names.len(),
            has_dual,
            stated_intervals => tables::stated_intervals(estimators),
            series => value(legend(&names, &best)),
            best_plot => drawn(plots::best_by_distance(&bins)),
            boxes_plot => drawn(plots::errors_by_distance(&bins)),
            by_weather => value(tables::by_weather(estimators, "")),
            by_time => value(tables::by_time(estimators, "")),
            by_type => value(tables::by_type(estimators, "")),
            weather_at_aircraft => tables::weather_at_aircraft(weather_at_aircraft),
            flights => value(tables::flights(estimators)),
            split => value(split),
            judged => value(judged),
            rules => value(rules),
            ticks => value(ticks),
            version => env!("CARGO_PKG_VERSION"),
        },
    )?;
    Ok(write_unsynced(&folder.report_path(), page.as_bytes())?)
}
