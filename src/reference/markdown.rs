//! Markdown elements.

use crate::verbs::output;

const WIDTH: usize = 140;

/// Words on lines of at most [`WIDTH`] columns, with an empty line after them.
pub(super) fn paragraph(text: &str) -> String {
    wrapped("", text) + "\n"
}

/// A list item.
pub(super) fn item(text: &str) -> String {
    wrapped("- ", text)
}

fn wrapped(start: &str, text: &str) -> String {
    let words: Vec<&str> = text.split_whitespace().collect();
    let lines = output::wrapped(start, &words.join(" "), WIDTH).into_iter();
    lines
        .map(|line| linked_words(line.split(' ')) + "\n")
        .collect()
}

fn linked_words<'a>(words: impl Iterator<Item = &'a str>) -> String {
    words.map(linked).collect::<Vec<_>>().join(" ")
}

/// A word that may name another page of the documentation: comments and help texts say `docs/video.md`.
fn linked(word: &str) -> String {
    let page = word
        .split_once("docs/")
        .and_then(|(before, rest)| Some((before, rest.split_once(".md")?)));
    match page {
        Some((before, (page, after))) if matches!(before, "" | "(") => {
            format!("{before}[{page}.md](../{page}.md){after}")
        }
        _ => word.to_owned(),
    }
}

/// A table without its empty columns, and with an empty line after it.
pub(super) fn table<const N: usize>(head: [&str; N], rows: &[[String; N]]) -> String {
    let kept: Vec<usize> = (0..N)
        .filter(|&column| rows.iter().any(|row| !row[column].is_empty()))
        .collect();
    let line = |cells: &[String; N]| {
        let cells = kept.iter().map(|&column| {
            let cell = linked_words(cells[column].split_whitespace()).replace('|', "\\|");
            if cell.is_empty() {
                " |".into()
            } else {
                format!(" {cell} |")
            }
        });
        format!("|{}\n", cells.collect::<String>())
    };
    let rule = format!("|{}\n", "---|".repeat(kept.len()));
    let lines: String = rows.iter().map(line).collect();
    line(&head.map(str::to_owned)) + &rule + &lines + "\n"
}
