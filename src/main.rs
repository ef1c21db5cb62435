//! The `dtd` command.

#![forbid(unsafe_code)]

#[macro_use]
mod print;
mod args;
mod failure;
mod logging;
mod progress;
mod signals;
mod verbs;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    let args = args::Args::parse();
    logging::start(args.verbose);
    failure::exit_code(verbs::run(args.verb))
}
