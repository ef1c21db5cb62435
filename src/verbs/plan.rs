//! `dtd plan`: what a sweep expands to.

use std::collections::BTreeMap;
use std::path::Path;

use generator::plan::{Plan, expand};
use generator::sweep::Sweep;

use super::Outcome;
use super::output::{print_json, print_table};
use crate::args::PlanArgs;
use crate::failure::{Ending, Failure};

/// Runs the verb.
pub(crate) fn run(args: &PlanArgs) -> Outcome {
    let (_, plan) = read_plan(&args.sweep)?;
    let summary = plan.summary();
    if args.json {
        print_json(&summary)?;
        return Ok(Ending::Done);
    }
    let rows: Vec<Vec<String>> = summary
        .scenarios
        .iter()
        .map(|s| {
            vec![
                s.id.into(),
                s.time_of_day.into(),
                s.weather.into(),
                s.flight.into(),
                s.ticks.to_string(),
                s.seed.to_string(),
            ]
        })
        .collect();
    print_table(
        &["scenario", "time", "weather", "flight", "ticks", "seed"],
        &rows,
    );
    let ticks: u64 = summary.scenarios.iter().map(|s| u64::from(s.ticks)).sum();
    let mut flights: BTreeMap<&str, usize> = BTreeMap::new();
    for scenario in &summary.scenarios {
        *flights
            .entry(if scenario.flight == "live" {
                "live"
            } else {
                "recorded"
            })
            .or_default() += 1;
    }
    let flights: Vec<String> = flights
        .iter()
        .map(|(kind, count)| format!("{count} {kind}"))
        .collect();
    println!();
    println!(
        "{} scenarios ({}), {ticks} ticks, plan {}",
        rows.len(),
        flights.join(", "),
        summary.plan_hash
    );
    Ok(Ending::Done)
}

/// Reads a sweep and expands it.
pub(crate) fn read_plan(path: &Path) -> Result<(Sweep, Plan), Failure> {
    let sweep = Sweep::read(path).map_err(Failure::bad_input)?;
    let plan = expand(&sweep);
    Ok((sweep, plan))
}
