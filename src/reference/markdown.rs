//! Markdown elements.

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
    let mut lines = String::from(start);
    let mut columns = start.len();
    for (number, word) in text.split_whitespace().enumerate() {
        let length = word.chars().count();
        if number > 0 && columns + 1 + length > WIDTH {
            lines += "\n";
            lines += &" ".repeat(start.len());
            columns = start.len();
        } else if number > 0 {
            lines += " ";
            columns += 1;
        }
        lines += &linked(word);
        columns += length;
    }
    lines + "\n"
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
            let words: Vec<_> = cells[column].split_whitespace().map(linked).collect();
            let cell = words.join(" ").replace('|', "\\|");
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
