//! `dtd schema`: the JSON Schema of sweep files.

use generator::sweep::schema;

use super::Outcome;
use crate::failure::Ending;

/// Runs the verb.
pub(crate) fn run() -> Outcome {
    println!("{}", schema().trim_end());
    Ok(Ending::Done)
}
