//! `dtd airport import`: a runway's table from published ones.

use generator::airports::{Conflict, Imported, UNCONFIRMED, import};
use serde::Serialize;

use super::Outcome;
use super::output::print_json;
use crate::args::imports::AirportCommand;
use crate::failure::{Ending, Failure};

/// Runs the verb.
pub(crate) fn run(AirportCommand::Import(args): &AirportCommand) -> Outcome {
    let found = import(&args.airport, &args.runway, &args.from).map_err(Failure::bad_input)?;
    let is_agreed = args.accept || found.conflicts.is_empty();
    if args.json {
        print_json(&Printed {
            imported: &found,
            toml: is_agreed.then(|| found.toml()),
        })?;
    } else if is_agreed {
        print!("{}", found.toml());
    }
    for Conflict {
        figure,
        found,
        recommended,
    } in &found.conflicts
    {
        eprintln!("{figure}: {found}\n    recommended: {recommended}");
    }
    if found.confirmed_by.is_empty() {
        eprintln!("centreline: {UNCONFIRMED}");
    }
    if is_agreed {
        return Ok(Ending::Done);
    }
    Err(Failure::bad_input_message(format!(
        "the tables differ on {} {}; check them against a chart, then take the recommended figures with --accept",
        args.airport, args.runway
    )))
}

#[derive(Serialize)]
struct Printed<'a> {
    #[serde(flatten)]
    imported: &'a Imported,
    /// The table for a sweep, if the figures agree.
    toml: Option<String>,
}
