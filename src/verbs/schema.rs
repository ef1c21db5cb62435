//! `dtd schema`: the JSON Schemas of files that people write.

use super::Outcome;
use crate::args::SchemaOf;
use crate::failure::Ending;

/// Runs the verb.
pub(crate) fn run(of: SchemaOf) -> Outcome {
    let schema = match of {
        SchemaOf::Sweep => generator::sweep::schema(),
        SchemaOf::Train => trainer::schema(),
    };
    println!("{}", schema.trim_end());
    Ok(Ending::Done)
}
