//! Variants of `println!` and `eprintln!` that stay quiet when the reader is gone.
//!
//! The standard ones panic when a pipe is closed, as in `dtd plan scenarios.toml | head -1`. The reader has what it wanted; the
//! verb continues and ends with its own exit code. These macros shadow the standard ones in all modules after this one.
//!
//! Output may contain text from a simulator, a client or a file. So it is also sanitised here: no control characters from outside
//! reach a terminal, which would interpret them.

use std::borrow::Cow;
use std::fmt::Arguments;
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::process;

use crate::failure::FAILED;
use crate::progress::beside_bars;

macro_rules! println {
    () => { $crate::print::to_stdout(format_args!("")) };
    ($($words:tt)*) => { $crate::print::to_stdout(format_args!($($words)*)) };
}

macro_rules! eprintln {
    ($($words:tt)*) => { $crate::print::to_stderr(format_args!($($words)*)) };
}

/// Writes a line of a result for a person, possibly through a pager or into a file. If the result cannot be written to its
/// destination, e.g. a full disk, the process ends.
pub(crate) fn to_stdout(line: Arguments<'_>) {
    write_to_stdout(&plain(&line.to_string()));
}

/// Writes a document for a program, exactly. On a terminal it is sanitised like any other text.
pub(crate) fn document_to_stdout(document: &str) {
    match io::stdout().is_terminal() {
        true => write_to_stdout(&plain(document)),
        false => write_to_stdout(document),
    }
}

fn write_to_stdout(line: &str) {
    let mut stdout = io::stdout().lock();
    let written = writeln!(stdout, "{line}");
    match written.and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            to_stderr(format_args!(
                "error: cannot write the result to stdout: {error}"
            ));
            process::exit(FAILED.into());
        }
        _ => {}
    }
}

/// Writes a line for a person. If nobody reads it, nothing is lost.
pub(crate) fn to_stderr(line: Arguments<'_>) {
    let line = line.to_string();
    let _ = beside_bars(|| writeln!(io::stderr().lock(), "{}", plain(&line)));
}

/// Text that is safe for a terminal: lines and tabs stay; other control characters, and those that change the writing direction,
/// are shown by their numbers.
pub(crate) fn plain(words: &str) -> Cow<'_, str> {
    let harmful = |c: char| {
        (c.is_control() && c != '\n' && c != '\t')
            || matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
    };
    if !words.contains(harmful) {
        return Cow::Borrowed(words);
    }
    let mut shown = String::with_capacity(words.len() + 16);
    for c in words.chars() {
        if harmful(c) {
            shown.extend(c.escape_default());
        } else {
            shown.push(c);
        }
    }
    Cow::Owned(shown)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_terminal_would_obey_is_shown_instead() {
        assert_eq!(plain("two\nlines\tüß"), "two\nlines\tüß");
        assert_eq!(
            plain("\u{1b}]0;owned\u{7}\r\u{9b}2J\u{202e}cod\u{7f}"),
            "\\u{1b}]0;owned\\u{7}\\r\\u{9b}2J\\u{202e}cod\\u{7f}"
        );
    }
}
