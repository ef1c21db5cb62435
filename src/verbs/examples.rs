//! `dtd examples`: the sweeps that ship, as files to change.

use std::path::Path;

use super::Outcome;
use super::output::{Next, count};
use crate::failure::Ending;
use crate::shipped;

/// Runs the verb.
pub(crate) fn run(folder: &Path) -> Outcome {
    let written = shipped::write(folder)?;
    for path in &written {
        println!("{}", path.display());
    }
    eprintln!(
        "examples: {} written; those that were there stay as they are",
        count(written.len(), "file")
    );
    Next::verb("plan", &folder.join("scenarios.toml")).show();
    Ok(Ending::Done)
}
