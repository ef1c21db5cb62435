//! Variants of `println!` and `eprintln!` that stay quiet when the reader is gone.
//!
//! The standard ones panic when a pipe is closed, as in `dtd plan scenarios.toml | head -1`. The reader has seen enough; the
//! verb continues and ends with its own exit code. These macros shadow the standard ones in all modules after this one.
//!
//! Output may contain text from a simulator, a client or a file. So it is also sanitised here: no control characters from outside
//! reach a terminal, which would interpret them.

use std::fmt::Arguments;
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::process;

use dataset::plain::plain;

use crate::failure::FAILED;
use crate::logging::repeats;
use crate::logging::stderr::{self, Level};

macro_rules! println {
    () => { $crate::print::to_stdout(format_args!("")) };
    ($($words:tt)*) => { $crate::print::to_stdout(format_args!($($words)*)) };
}

macro_rules! eprintln {
    ($($words:tt)*) => {
        $crate::print::to_stderr($crate::logging::stderr::Level::Info, format_args!($($words)*))
    };
}

/// Writes a line that says what went wrong although the verb goes on.
macro_rules! eprint_warning {
    ($($words:tt)*) => {
        $crate::print::to_stderr($crate::logging::stderr::Level::Warning, format_args!($($words)*))
    };
}

/// Writes a line that says what failed.
macro_rules! eprint_error {
    ($($words:tt)*) => {
        $crate::print::to_stderr($crate::logging::stderr::Level::Error, format_args!($($words)*))
    };
}

/// Writes a result line for a person, possibly through a pager or into a file. If the result cannot be written to its
/// destination, e.g. a full disk, the process ends.
pub(crate) fn to_stdout(line: Arguments<'_>) {
    write_to_stdout(&plain(&line.to_string()));
}

/// Writes a document for a program, exactly. On a terminal it is sanitised like any other text.
pub(crate) fn document_to_stdout(document: &str) {
    if io::stdout().is_terminal() {
        write_to_stdout(&plain(document));
    } else {
        write_to_stdout(document);
    }
}

fn write_to_stdout(line: &str) {
    let mut stdout = io::stdout().lock();
    let written = writeln!(stdout, "{line}");
    match written.and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            eprint_error!("cannot write the result to stdout: {error}");
            repeats::write_counts();
            process::exit(FAILED.into());
        }
        _ => {}
    }
}

/// Writes a line for a person.
pub(crate) fn to_stderr(level: Level, line: Arguments<'_>) {
    stderr::say(level, "", &line.to_string());
}
