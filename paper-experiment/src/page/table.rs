//! Tables in Markdown.

/// A table.
pub(super) struct Table {
    rows: Vec<Vec<String>>,
}

impl Table {
    pub(super) fn new(heading: &[&str]) -> Self {
        let heading = heading.iter().map(|&cell| cell.to_owned());
        Self {
            rows: vec![heading.collect()],
        }
    }

    pub(super) fn row(&mut self, cells: impl IntoIterator<Item = String>) {
        self.rows.push(cells.into_iter().collect());
    }

    pub(super) fn markdown(&self) -> String {
        let line = |cells: &[String]| format!("| {} |", cells.join(" | "));
        let mut lines: Vec<String> = self.rows.iter().map(|row| line(row)).collect();
        let ruler = format!("|{}", "---|".repeat(self.rows[0].len()));
        lines.insert(1, ruler);
        lines.join("\n")
    }
}

/// A number, or a dash if there is none.
pub(super) fn number(value: Option<f64>, decimals: usize) -> String {
    value.map_or_else(|| "-".into(), |value| format!("{value:.decimals$}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_has_a_ruler_below_its_heading_and_a_dash_for_what_is_missing() {
        let mut table = Table::new(&["a", "b"]);
        table.row(["1".into(), number(None, 2)]);
        table.row(["2".into(), number(Some(0.126), 2)]);
        assert_eq!(
            table.markdown(),
            "| a | b |\n|---|---|\n| 1 | - |\n| 2 | 0.13 |"
        );
    }
}
