//! The `dtd` command.

#[macro_use]
mod print;
mod args;
mod estimate_args;
mod estimator_args;
mod export_args;
mod failure;
mod help;
mod local_udp_args;
mod logging;
mod output_arg;
mod progress;
#[cfg(test)]
mod reference;
mod repeats;
mod search_args;
mod shard_arg;
mod shipped;
mod signals;
mod stderr;
mod telemetry;
mod verb_watch;
mod verbs;
mod view_args;

use std::process::ExitCode;

use args::{Args, ProgressForm};

fn main() -> ExitCode {
    telemetry::switch_off();
    let args = Args::of_process();
    if args.progress == ProgressForm::Json {
        stderr::use_json();
    }
    logging::start(args.verbose);
    if let Some(limit) = args.max_memory {
        dataset::work::memory::set_limit(limit);
    }
    let code = failure::exit_code(verbs::run(args.verb));
    repeats::write_counts();
    code
}
