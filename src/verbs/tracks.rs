//! `dtd tracks import`: recordings from tracks of real arrivals.

use generator::airports::{bundled, in_file};
use generator::tracks::import_tracks;

use super::Outcome;
use super::output::{count, print_json};
use crate::args::imports::TracksCommand;
use crate::failure::{Ending, Failure};

/// Runs the verb.
pub(crate) fn run(TracksCommand::Import(args): &TracksCommand) -> Outcome {
    let (airport, name) = args.runway.split_once('/').ok_or_else(|| {
        Failure::bad_input_message(format!(
            "--runway {}: expected airport and runway, e.g. LFPG/09R",
            args.runway
        ))
    })?;
    let runway = match &args.airports {
        Some(file) => in_file(file, airport, name).map_err(Failure::bad_input)?,
        None => bundled(airport, name).ok_or_else(|| {
            Failure::bad_input_message(format!(
                "runway {name} of {airport} is not built in; make its table with `dtd airport import`, and name the file in --airports"
            ))
        })?,
    };
    let outcome = import_tracks(&args.files, &args.columns, &runway, &args.out)
        .map_err(Failure::of_corpus)?;
    if args.json {
        print_json(&outcome)?;
    } else {
        for track in &outcome.imported {
            println!("{}", track.recording.display());
        }
    }
    for track in &outcome.refused {
        eprintln!("refused: {track}");
    }
    let (imported, refused) = (outcome.imported.len(), outcome.refused.len());
    eprintln!("{} imported, {refused} refused", count(imported, "arrival"));
    match (imported, refused) {
        (0, _) => Err(Failure::bad_input_message(
            "no track is an arrival on this runway",
        )),
        (_, 0) => Ok(Ending::Done),
        _ => Ok(Ending::Losses),
    }
}
