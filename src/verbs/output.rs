//! Results on stdout.

use std::borrow::Cow;
use std::fmt::Display;
use std::path::Path;
use std::time::Instant;

use indicatif::HumanDuration;
use serde::Serialize;

use crate::failure::{Ending, Failure};
use crate::help::COLUMNS;
use crate::print::document_to_stdout;

/// Prints a value as one JSON document.
pub(crate) fn print_json(value: &impl Serialize) -> Result<(), Failure> {
    document_to_stdout(&serde_json::to_string_pretty(value)?);
    Ok(())
}

/// The number of failures in a summary.
pub(crate) fn failed(number: usize) -> String {
    match number {
        0 => String::new(),
        number => format!(", {number} failed"),
    }
}

/// The ending of a verb that was stopped; prints how much is done and left.
pub(crate) fn interrupted(scenarios: usize, done: &str, left: usize) -> Ending {
    let scenarios = count(scenarios, "scenario");
    eprintln!(
        "interrupted: {scenarios} {done}, {left} to go; run the same command again to resume"
    );
    Ending::Interrupted
}

/// Prints rows under a heading in aligned columns: the first left-aligned, the others right-aligned.
pub(crate) fn print_table(heading: &[&str], rows: &[Vec<String>]) {
    let width = |column: usize| {
        let cells = rows
            .iter()
            .filter_map(|row| row.get(column))
            .map(|cell| cell.chars().count());
        cells
            .chain([heading[column].chars().count()])
            .max()
            .unwrap_or(0)
    };
    let widths: Vec<usize> = (0..heading.len()).map(width).collect();
    let print_row = |cells: &mut dyn Iterator<Item = &str>| {
        let line: Vec<String> = cells
            .zip(&widths)
            .enumerate()
            .map(|(column, (cell, &width))| {
                if column == 0 {
                    format!("{cell:<width$}")
                } else {
                    format!("{cell:>width$}")
                }
            })
            .collect();
        println!("{}", line.join("  ").trim_end());
    };
    print_row(&mut heading.iter().copied());
    for row in rows {
        print_row(&mut row.iter().map(String::as_str));
    }
}

/// Prints a text after its name, e.g. `size        14 GB`. A text that is too long for the line goes on below its beginning.
pub(crate) fn print_after(name: &str, text: &str) {
    for line in wrapped(name, text, COLUMNS) {
        println!("{line}");
    }
}

/// Lines of at most these columns. The text begins after its name, and goes on below its beginning.
pub(crate) fn wrapped(name: &str, text: &str, most_columns: usize) -> Vec<String> {
    let indent = name.chars().count();
    let mut lines = Vec::new();
    let mut line = name.to_owned();
    let mut columns = indent;
    for word in text.split(' ') {
        let length = word.chars().count();
        if columns > indent && columns + 1 + length > most_columns {
            lines.push(std::mem::replace(&mut line, " ".repeat(indent)));
            columns = indent;
        } else if columns > indent {
            line.push(' ');
            columns += 1;
        }
        line.push_str(word);
        columns += length;
    }
    lines.push(line);
    lines
}

/// Ends a verb that went well: how long it took, and what people run next. On stderr, where no program reads it.
pub(crate) fn finish(verb: &str, began: Instant, next: &Next) {
    eprintln!("{verb}: done in {}", HumanDuration(began.elapsed()));
    next.show();
}

/// Arguments of the `dtd` that people run next. None: the work is complete, or others do the rest.
#[derive(Debug, Default)]
pub(crate) struct Next(Vec<String>);

impl Next {
    /// A verb and its first argument.
    pub(crate) fn verb(verb: &str, argument: &Path) -> Self {
        Self(vec![verb.into()]).and(argument.display())
    }

    /// Adds an argument.
    pub(crate) fn and(mut self, argument: impl Display) -> Self {
        self.0.push(argument.to_string());
        self
    }

    /// Prints the command as a shell reads it.
    pub(crate) fn show(&self) {
        if !self.0.is_empty() {
            let words: Vec<_> = self.0.iter().map(|word| shell_word(word)).collect();
            eprintln!("next: dtd {}", words.join(" "));
        }
    }
}

/// A word that a POSIX shell reads as this text.
fn shell_word(text: &str) -> Cow<'_, str> {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./:@%+=,".contains(c);
    if !text.is_empty() && text.chars().all(is_plain) {
        Cow::Borrowed(text)
    } else {
        Cow::Owned(format!("'{}'", text.replace('\'', r"'\''")))
    }
}

/// Some of the identifiers, and how many more there are.
pub(crate) fn listed<'a>(
    ids: impl IntoIterator<Item = &'a String, IntoIter: ExactSizeIterator>,
) -> String {
    const MAX_COUNT: usize = 5;
    let ids = ids.into_iter();
    let more = ids.len().saturating_sub(MAX_COUNT);
    let shown: Vec<&str> = ids.take(MAX_COUNT).map(String::as_str).collect();
    match more {
        0 => shown.join(", "),
        more => format!("{} and {more} more", shown.join(", ")),
    }
}

/// A number of things: `1 scenario`, `2 scenarios`.
pub(crate) fn count(number: usize, thing: &str) -> String {
    let plural = if number == 1 { "" } else { "s" };
    format!("{number} {thing}{plural}")
}

#[cfg(test)]
mod tests {
    use std::process::Command;

    use super::*;

    #[test]
    fn a_shell_reads_the_words_of_a_command_as_they_are() {
        for text in ["corpus", "my corpus", "it's", "$(rm -rf .)", "", "a\\b\"c"] {
            let shown = format!("printf %s {}", shell_word(text));
            let output = Command::new("sh").args(["-c", &shown]).output().unwrap();
            assert_eq!(String::from_utf8_lossy(&output.stdout), text);
        }
    }

    #[test]
    fn a_long_text_goes_on_below_its_beginning() {
        let words = |count| vec!["word"; count].join(" ");
        let lines = wrapped("size  ", &words(20), COLUMNS);
        assert_eq!(
            lines,
            [
                format!("size  {}", words(15)),
                format!("      {}", words(5))
            ]
        );
        assert_eq!(wrapped("a ", "", COLUMNS), ["a "]);
        let unbreakable = "x".repeat(100);
        assert_eq!(
            wrapped("a ", &unbreakable, COLUMNS),
            [format!("a {unbreakable}")]
        );
    }
}
