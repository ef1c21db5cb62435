//! Tables of a page, or of a page in Markdown.

use serde::Serialize;

use crate::number::NONE;

/// A table. Its columns are added first, then its rows.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Table {
    /// Description for readers who do not see the table; unique within a page.
    pub label: String,
    groups: Vec<Group>,
    has_groups: bool,
    /// Class of the cells of each column.
    classes: Vec<&'static str>,
    rows: Vec<Row>,
}

/// Neighbouring columns with a common heading above theirs, if it has a name.
#[derive(Debug, Clone, Serialize)]
struct Group {
    name: String,
    columns: Vec<Column>,
}

#[derive(Debug, Clone, Serialize)]
struct Column {
    name: String,
    class: &'static str,
}

/// A row.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// Class of the row in the style sheet; empty for an ordinary one.
    pub class: &'static str,
    cells: Vec<Cell>,
}

/// Text of a cell.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Cell {
    text: String,
    /// HTML element around the text, or empty.
    element: &'static str,
    /// Second line, in small letters.
    note: String,
}

impl Cell {
    fn within(element: &'static str, text: impl Into<String>) -> Self {
        Self {
            text: text.into(),
            element,
            note: String::new(),
        }
    }

    /// An identifier.
    pub fn code(text: impl Into<String>) -> Self {
        Self::within("code", text)
    }

    /// Emphasised text.
    pub fn strong(text: impl Into<String>) -> Self {
        Self::within("strong", text)
    }

    /// Figures by others.
    pub fn quoted(text: impl Into<String>) -> Self {
        Self::within("em", text)
    }

    /// Adds a second line.
    #[must_use]
    pub fn with_note(self, note: impl Into<String>) -> Self {
        Self {
            note: note.into(),
            ..self
        }
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Self::within("", text)
    }
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Self::within("", text)
    }
}

impl From<usize> for Cell {
    fn from(count: usize) -> Self {
        count.to_string().into()
    }
}

impl From<u64> for Cell {
    fn from(count: u64) -> Self {
        count.to_string().into()
    }
}

impl Table {
    /// A table without columns and rows.
    pub fn new(label: impl Into<String>) -> Self {
        Self {
            label: label.into(),
            ..Self::default()
        }
    }

    /// Adds columns of words.
    #[must_use]
    pub fn words<'a>(self, names: impl IntoIterator<Item = &'a str>) -> Self {
        self.columns("", names, "word")
    }

    /// Adds columns of numbers; `group` is their common heading, or empty.
    #[must_use]
    pub fn numbers<'a>(self, group: &str, names: impl IntoIterator<Item = &'a str>) -> Self {
        self.columns(group, names, "")
    }

    fn columns<'a>(
        mut self,
        group: &str,
        names: impl IntoIterator<Item = &'a str>,
        class: &'static str,
    ) -> Self {
        let names = names.into_iter().enumerate();
        let columns = names.map(|(place, name)| Column {
            name: name.to_owned(),
            // A group has a line before it.
            class: if group.is_empty() || place > 0 {
                class
            } else {
                "first"
            },
        });
        let columns: Vec<Column> = columns.collect();
        self.has_groups |= !group.is_empty();
        self.classes
            .extend(columns.iter().map(|column| column.class));
        self.groups.push(Group {
            name: group.to_owned(),
            columns,
        });
        self
    }

    /// Adds a row with a cell per column.
    pub fn row(&mut self, cells: impl IntoIterator<Item = impl Into<Cell>>) -> &mut Row {
        let cells = cells.into_iter().map(Into::into).collect();
        self.rows.push(Row { class: "", cells });
        let last = self.rows.len() - 1;
        &mut self.rows[last]
    }

    /// The table in Markdown, without groups and forms.
    pub fn markdown(&self) -> String {
        let line = |cells: Vec<&str>| format!("| {} |", cells.join(" | "));
        let columns = self.groups.iter().flat_map(|group| &group.columns);
        let headings = columns.map(|column| &*column.name);
        let mut lines = vec![
            line(headings.collect()),
            format!("|{}", "---|".repeat(self.classes.len())),
        ];
        let rows = self.rows.iter();
        lines.extend(rows.map(|row| line(row.cells.iter().map(|cell| &*cell.text).collect())));
        lines.join("\n")
    }
}

/// Text of a value, or a dash without one.
pub fn or_dash(text: Option<String>) -> String {
    text.unwrap_or_else(|| NONE.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_in_markdown_has_a_ruler_below_its_headings() {
        let mut table = Table::new("").words(["a", "b"]);
        table.row(["1", "–"]);
        table.row(["2", "0.13"]);
        assert_eq!(
            table.markdown(),
            "| a | b |\n|---|---|\n| 1 | – |\n| 2 | 0.13 |"
        );
    }
}
