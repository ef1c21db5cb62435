//! Answer columns in `predictions.parquet` and in the output of `dtd predict`.

use dataset::tables::columns::TableWriter;

use crate::estimators::inverse_range::flight_filter::{Estimate, Estimated};
use crate::evaluation::rules::EvaluationRules;
use crate::run::estimator::{Answered, Estimator};
use crate::samples::{Sample, Samples};

/// The columns before the answers at evaluated ticks. `detections`: the number of views that saw the aircraft, if known.
pub(crate) fn judged_ticks(
    ticks: &[&Sample],
    detections: Option<Vec<u32>>,
    samples: &Samples,
    rules: &EvaluationRules,
) -> TableWriter {
    let ticks = || ticks.iter().copied();
    let scenario = |sample: &Sample| &samples.scenarios[sample.scenario].id;
    let mut table = TableWriter::new()
        .text("scenario", ticks().map(scenario))
        .u32("tick", ticks().map(|sample| sample.tick));
    if let Some(detections) = detections {
        table = table.u32("detections", detections);
    }
    let hidden = ticks().map(|sample| rules.is_hidden(sample));
    table
        .bool("hidden_by_fog", hidden)
        .f64("dtd_m", ticks().map(|sample| sample.dtd_m))
}

/// Adds the answers at some ticks in a flight.
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

/// Adds an estimator's further quantities.
fn add_estimates(
    mut table: TableWriter,
    name: &str,
    estimates: &[Option<Estimate>],
) -> TableWriter {
    let numbers = |estimate: &Estimate| {
        [
            Some(estimate.distance_m),
            Some(estimate.ground_speed_mps),
            estimate.time_to_touchdown_s,
        ]
    };
    let parts = |of: Estimated| [of.value, of.sd, of.interval[0], of.interval[1]];
    let quantities = ["dtd_m", "ground_speed_mps", "time_to_touchdown_s"];
    for (number, quantity) in quantities.into_iter().enumerate() {
        for (part, suffix) in ["", "_sd", "_from", "_to"].into_iter().enumerate() {
            // The distance has a column already, as for every estimator.
            if (number, part) == (0, 0) {
                continue;
            }
            let of = |estimate: &Option<Estimate>| {
                Some(parts(numbers(estimate.as_ref()?)[number]?)[part])
            };
            let column = format!("{name}_{quantity}{suffix}");
            table = table.optional_f64(&column, estimates.iter().map(of));
        }
    }
    table
}
