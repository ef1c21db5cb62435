//! `dtd schema`: the JSON Schemas of files that people write, and of progress that programs read.

use super::Outcome;
use crate::args::SchemaOf;
use crate::failure::Ending;

const PROGRESS: &str = include_str!("../../schema/progress.schema.json");

/// Runs the verb.
pub(crate) fn run(of: SchemaOf) -> Outcome {
    let schema = match of {
        SchemaOf::Sweep => generator::sweep::schema(),
        SchemaOf::Train => trainer::schema(),
        SchemaOf::Progress => PROGRESS.to_owned(),
    };
    println!("{}", schema.trim_end());
    Ok(Ending::Done)
}
