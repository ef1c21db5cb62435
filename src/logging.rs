//! Logs go to stderr and results to stdout, so that both can be redirected separately.

use std::io::{self, IsTerminal};

use tracing_subscriber::EnvFilter;

/// Starts logging: warnings by default, `-v` adds events, `-vv` every detail. `RUST_LOG` overrides both.
pub(crate) fn start(verbose: u8) {
    let default = match verbose {
        0 => "warn",
        1 => "info",
        _ => "debug",
    };
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(default));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(io::stderr)
        .with_ansi(io::stderr().is_terminal())
        // A log that nobody reads any more is no reason to panic.
        .log_internal_errors(false)
        .without_time()
        .with_target(false)
        .init();
}
