//! The `dtd` command.

#[macro_use]
mod print;
mod args;
mod failure;
mod help;
mod logging;
mod progress;
mod shipped;
mod signals;
mod telemetry;
mod verbs;

use std::process::ExitCode;

fn main() -> ExitCode {
    telemetry::switch_off();
    let args = help::parse();
    logging::start(args.verbose);
    if let Some(limit) = args.max_memory {
        dataset::memory::set_limit(limit);
    }
    failure::exit_code(verbs::run(args.verb))
}
