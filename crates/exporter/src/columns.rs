//! Columns of the long tables, as dataset cards describe them.

const TEXT: &str = include_str!("columns.md");

/// Names of the tables with their sections of a card, in the order of the card.
pub(crate) fn tables() -> impl Iterator<Item = (&'static str, &'static str)> {
    let sections = TEXT.split("\n## ").skip(1);
    sections.filter_map(|section| Some((section.lines().next()?, section)))
}

/// Meaning of a column of the table `ticks`; empty for an unknown one.
pub(crate) fn meaning_in_ticks(column: &str) -> &'static str {
    let row = format!("| `{column}` | ");
    let mut tables = tables();
    let ticks = tables.find(|(name, _)| *name == "ticks");
    let mut lines = ticks.map_or("", |(_, section)| section).lines();
    let meaning = lines.find_map(|line| line.strip_prefix(&row)?.strip_suffix(" |"));
    meaning.unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_table_has_a_section_and_each_column_of_the_ticks_a_meaning() {
        let names: Vec<_> = tables().map(|(name, _)| name).collect();
        let expected = [
            "scenarios",
            "views",
            "ticks",
            "boxes",
            "detections",
            "predictions",
        ];
        assert_eq!(names, expected);
        assert_eq!(meaning_in_ticks("gear_ratio"), "gear, 0 up to 1 down");
        assert_eq!(meaning_in_ticks("visibility_m"), "", "of another table");
    }
}
