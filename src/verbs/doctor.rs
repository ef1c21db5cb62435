//! `dtd doctor`: a live connection examined point by point.

use xplane_bridge::WebApiPlace;
use xplane_bridge::doctor::{Check, Patient, Verdict, examine};

use super::Outcome;
use super::address::simulator;
use super::async_runtime::async_runtime;
use super::output::print_json;
use crate::args::DoctorArgs;
use crate::failure::{Ending, Failure};

/// Runs the verb. Fails if a check does.
pub(crate) fn run(args: &DoctorArgs) -> Outcome {
    // Without an address, whoever announces itself is examined.
    let address = match &args.sim {
        Some(text) => simulator(text)?,
        None => None,
    };
    let web_api = match args.web_api {
        Some(place) => place,
        None => WebApiPlace::from_environment().map_err(Failure::bad_input)?,
    };
    let patient = Patient {
        web_api,
        ..Patient::at(address)
    };
    let mut show = |check: &Check| {
        if !args.json {
            print(check);
        }
    };
    let checks = async_runtime()?.block_on(examine(&patient, &mut show));
    if args.json {
        print_json(&checks)?;
    }
    match checks
        .iter()
        .filter(|check| check.verdict == Verdict::Failed)
        .count()
    {
        0 => Ok(Ending::Done),
        failed => Err(Failure::Failed(anyhow::anyhow!(
            "{failed} of {} checks failed",
            checks.len()
        ))),
    }
}

fn print(check: &Check) {
    println!("{:<8} {:<18} {}", check.verdict, check.name, check.found);
    if let Some(hint) = &check.hint {
        println!("{:<8} {:<18} -> {hint}", "", "");
    }
}
