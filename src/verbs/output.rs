//! Results on stdout.

use std::time::Instant;

use indicatif::HumanDuration;
use serde::Serialize;

use crate::failure::Failure;
use crate::print::document_to_stdout;

/// Prints a value as one JSON document.
pub(crate) fn print_json(value: &impl Serialize) -> Result<(), Failure> {
    document_to_stdout(&serde_json::to_string_pretty(value)?);
    Ok(())
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

/// Ends a verb that went well: how long it took, and what people run next. On stderr, where no program reads it.
pub(crate) fn finish(verb: &str, began: Instant, next: &str) {
    eprintln!("{verb}: done in {}", HumanDuration(began.elapsed()));
    eprintln!("next: {next}");
}

/// A number of things: `1 scenario`, `2 scenarios`.
pub(crate) fn count(number: usize, thing: &str) -> String {
    let plural = if number == 1 { "" } else { "s" };
    format!("{number} {thing}{plural}")
}
