//! `dtd examples`: the sweeps that ship, as files to change.

use super::Outcome;
use super::output::{Next, count};
use crate::args::ExamplesArgs;
use crate::failure::Ending;
use crate::shipped;

/// Runs the verb.
pub(crate) fn run(args: &ExamplesArgs) -> Outcome {
    let written = shipped::write(&args.folder)?;
    for path in &written {
        println!("{}", path.display());
    }
    eprintln!(
        "examples: {} written; those that were there stay as they are",
        count(written.len(), "file")
    );
    Next::verb("plan", &args.folder.join("scenarios.toml")).show();
    Ok(Ending::Done)
}
