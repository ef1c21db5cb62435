//! Columns of the long tables, as dataset cards describe them.

const TEXT: &str = include_str!("columns.md");

/// Names of the tables with their sections of a card, in the order of the card.
pub(crate) fn tables() -> impl Iterator<Item = (&'static str, &'static str)> {
    let sections = TEXT.split("\n## ").skip(1);
    sections.filter_map(|section| Some((section.lines().next()?, section)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_table_has_a_section() {
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
    }
}
