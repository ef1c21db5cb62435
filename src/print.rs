//! `println!` and `eprintln!` as this command means them: quiet when the reader has gone.
//!
//! The standard ones panic when a pipe is closed, as in `dtd plan scenarios.toml | head -1`. Whoever closed it has read what it
//! wanted; the verb goes on and ends with its own exit code. These macros shadow the standard ones in all modules after this one.

use std::fmt::Arguments;
use std::io::{self, ErrorKind, Write};
use std::process;

use crate::failure::FAILED;

macro_rules! println {
    () => { $crate::print::to_stdout(format_args!("")) };
    ($($words:tt)*) => { $crate::print::to_stdout(format_args!($($words)*)) };
}

macro_rules! eprintln {
    ($($words:tt)*) => { $crate::print::to_stderr(format_args!($($words)*)) };
}

/// Writes a line of a result. A result that cannot be written to where it should go, e.g. a full disk, ends the process.
pub(crate) fn to_stdout(line: Arguments<'_>) {
    let mut stdout = io::stdout().lock();
    match writeln!(stdout, "{line}").and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            to_stderr(format_args!(
                "error: cannot write the result to stdout: {error}"
            ));
            process::exit(FAILED.into());
        }
        _ => {}
    }
}

/// Writes a line for a person. If nobody takes it, nothing is lost.
pub(crate) fn to_stderr(line: Arguments<'_>) {
    let _ = writeln!(io::stderr().lock(), "{line}");
}
