//! Logs go to stderr and results to stdout, so that both can be redirected separately.

use std::io::{self, IsTerminal, Stderr, Write};

use tracing_subscriber::EnvFilter;

use crate::progress::beside_bars;

/// Starts logging: warnings by default, `-v` adds events, `-vv` every detail. `RUST_LOG` overrides both. In a file, each line has its
/// time.
pub(crate) fn start(verbose: u8) {
    let default = match verbose {
        0 => "warn",
        1 => "info",
        _ => "debug",
    };
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(default));
    let on_terminal = io::stderr().is_terminal();
    let log = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(|| BesideBars(io::stderr()))
        .with_ansi(on_terminal)
        // A log that nobody reads any more is no reason to panic.
        .log_internal_errors(false)
        .with_target(false);
    match on_terminal {
        true => log.without_time().init(),
        false => log.init(),
    }
}

/// Standard error, whose lines do not tear progress bars.
struct BesideBars(Stderr);

impl Write for BesideBars {
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        beside_bars(|| self.0.write(line))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}
