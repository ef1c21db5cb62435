//! `dtd man`: the manual pages.

use std::fs;
use std::path::Path;

use dataset::Error;

use super::Outcome;
use crate::args::Args;
use crate::failure::Ending;

/// Runs the verb: a page for the program, and one for each verb.
pub(crate) fn run(folder: &Path) -> Outcome {
    fs::create_dir_all(folder).map_err(Error::io("create", folder))?;
    clap_mangen::generate_to(Args::grouped_command(), folder)
        .map_err(Error::io("write to", folder))?;
    eprintln!("man: pages written to {}", folder.display());
    Ok(Ending::Done)
}
