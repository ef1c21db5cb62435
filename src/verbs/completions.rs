//! `dtd completions`: a script that completes arguments in a shell.

use clap_complete::Shell;

use super::Outcome;
use crate::args::Args;
use crate::failure::Ending;

/// Runs the verb.
pub(crate) fn run(shell: Shell) -> Outcome {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Args::grouped_command(), "dtd", &mut script);
    print!("{}", String::from_utf8_lossy(&script));
    Ok(Ending::Done)
}
