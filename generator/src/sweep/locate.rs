//! Finds the position of a key in a TOML text, so that errors of meaning are located as precisely as syntax errors.

use std::ops::Range;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// The position of the value at a dotted key such as `grid.times.2`, or of the nearest existing table around it.
pub(super) fn span_of(text: &str, dotted_key: &str) -> Option<Range<usize>> {
    let root = DeTable::parse(text).ok()?;
    let mut steps = dotted_key.split('.');
    let (key, first) = root.get_ref().get_key_value(steps.next()?)?;
    let mut span = key.span();
    let mut value = first;
    for step in steps {
        let Some((place, next)) = child(value, step) else {
            break;
        };
        span = place;
        value = next;
    }
    Some(span)
}

type Child<'a, 'i> = (Range<usize>, &'a Spanned<DeValue<'i>>);

fn child<'a, 'i>(value: &'a Spanned<DeValue<'i>>, step: &str) -> Option<Child<'a, 'i>> {
    match value.get_ref() {
        DeValue::Table(table) => {
            let (key, next) = table.get_key_value(step)?;
            // A scalar is located at its value, a table at its name.
            let place = if next.get_ref().is_table() {
                key.span()
            } else {
                next.span()
            };
            Some((place, next))
        }
        DeValue::Array(items) => {
            let next = items.get(step.parse::<usize>().ok()?)?;
            Some((next.span(), next))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str =
        "[grid]\ntimes = [\"06:00\", \"25:00\"]\n[weather.foggy]\nvisibility_m = -1\n";

    fn found(key: &str) -> &str {
        &TEXT[span_of(TEXT, key).unwrap()]
    }

    #[test]
    fn values_items_and_tables_are_found() {
        assert_eq!(found("grid.times.1"), "\"25:00\"");
        assert_eq!(found("weather.foggy.visibility_m"), "-1");
        assert_eq!(found("weather.foggy"), "foggy");
    }

    #[test]
    fn for_a_key_that_is_not_there_the_table_around_it_is_shown() {
        assert_eq!(found("weather.foggy.clouds"), "foggy");
        assert_eq!(span_of(TEXT, "start.dtd_nm"), None);
    }
}
