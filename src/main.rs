//! The `dtd` command.

#[macro_use]
mod print;
mod args;
mod failure;
mod help;
mod logging;
mod progress;
#[cfg(test)]
mod reference;
mod shipped;
mod signals;
mod telemetry;
mod verbs;

use std::process::ExitCode;

use args::{Args, ProgressForm};

fn main() -> ExitCode {
    telemetry::switch_off();
    let args = Args::of_process();
    if args.progress == ProgressForm::Json {
        logging::stderr::use_json();
    }
    logging::start(args.verbose);
    if let Some(limit) = args.max_memory {
        dataset::work::memory::set_limit(limit);
    }
    let code = failure::exit_code(verbs::run(args.verb));
    logging::repeats::write_counts();
    code
}
