//! The columns of answers in `predictions.parquet` and in what `dtd predict` writes.

use dataset::tables::columns::TableWriter;

use crate::estimators::inverse_range::flight_filter::{Estimate, Estimated};
use crate::evaluation::answers::Answered;
use crate::run::estimator::Estimator;

/// A number that an estimator states, of a column's name.
type Stated = (&'static str, fn(&Estimate) -> Option<Estimated>);
/// A column of such a number, of the suffix of its name.
type Part = (&'static str, fn(Estimated) -> f64);

/// Adds what all estimators answered to some ticks of a flight.
pub(crate) fn add_answers(
    mut table: TableWriter,
    ticks: &[usize],
    answered: &[Answered],
) -> TableWriter {
    for (estimator, answered) in Estimator::ALL.into_iter().zip(answered) {
        let column = format!("{}_dtd_m", estimator.name());
        let distances_m = ticks.iter().map(|&tick| answered.distances_m[tick]);
        table = table.optional_f64(&column, distances_m);
        if let Some(estimates) = &answered.estimates {
            let estimates: Vec<_> = ticks.iter().map(|&tick| estimates[tick]).collect();
            table = add_estimates(table, estimator.name(), &estimates);
        }
    }
    table
}

/// Columns of an estimator's further quantities.
fn add_estimates(
    mut table: TableWriter,
    name: &str,
    estimates: &[Option<Estimate>],
) -> TableWriter {
    let numbers: [Stated; 3] = [
        ("dtd_m", |estimate| Some(estimate.distance_m)),
        ("ground_speed_mps", |estimate| {
            Some(estimate.ground_speed_mps)
        }),
        ("time_to_touchdown_s", |estimate| {
            estimate.time_to_touchdown_s
        }),
    ];
    for (quantity, number) in numbers {
        let parts: [Part; 4] = [
            ("", |number| number.value),
            ("_sd", |number| number.sd),
            ("_from", |number| number.interval[0]),
            ("_to", |number| number.interval[1]),
        ];
        // The distance has a column already, as for every estimator.
        for (suffix, part) in parts.into_iter().skip(usize::from(quantity == "dtd_m")) {
            let of = |estimate: &Option<Estimate>| estimate.as_ref().and_then(number).map(part);
            let column = format!("{name}_{quantity}{suffix}");
            table = table.optional_f64(&column, estimates.iter().map(of));
        }
    }
    table
}
