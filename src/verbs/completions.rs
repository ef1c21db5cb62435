//! `dtd completions`: a script that completes arguments in a shell.

use clap_complete::Shell;

use super::Outcome;
use crate::failure::Ending;
use crate::help;

/// Runs the verb.
pub(crate) fn run(shell: Shell) -> Outcome {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut help::command(), "dtd", &mut script);
    print!("{}", String::from_utf8_lossy(&script));
    Ok(Ending::Done)
}
