//! `dtd airport import`: a runway's table from published ones.

use generator::airports::{Conflict, Imported, UNCONFIRMED, import};
use serde::Serialize;

use super::Outcome;
use super::output::{count, print_json};
use crate::args::imports::AirportCommand;
use crate::failure::{Ending, Failure};

/// Runs the verb.
pub(crate) fn run(AirportCommand::Import(args): &AirportCommand) -> Outcome {
    let found = import(&args.airport, &args.runway, &args.from, &args.tracks)
        .map_err(Failure::bad_input)?;
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
    for track in &found.tracks_left_out {
        eprintln!("left out: {track}");
    }
    if let Some(axis) = &found.arrivals {
        eprintln!(
            "{}: {:+.1} m to the right of the centreline at the touchdown target, turned by {:+.3} degrees",
            count(axis.arrivals, "arrival"),
            axis.offset_m,
            axis.turned_deg
        );
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
