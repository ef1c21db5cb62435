//! The shell of a page and its contents: a template filled with values.
//!
//! A template is the content below the heading. It may use the macros of `macros.html`: `chart`, `legend`, `table` and `crop`. Text is
//! escaped; charts are inserted as they are ([`drawn`]).

use minijinja::value::Serde;
use minijinja::{Environment, UndefinedBehavior, Value, context};
use serde::Serialize;

use crate::error::{Error, Result};

const SHELL: &str = include_str!("page.html");
const MACROS: &str = include_str!("macros.html");
/// Style sheet of all pages.
pub const STYLE: &str = include_str!("style.css");

/// A page with this heading, which is also its title.
///
/// # Errors
/// The template is wrong, or lacks a value.
pub fn page(heading: &str, template: &str, values: Value) -> Result<String> {
    page_titled(heading, heading, template, values)
}

/// A page whose heading differs from its title.
///
/// # Errors
/// The template is wrong, or lacks a value.
pub fn page_titled(title: &str, heading: &str, template: &str, values: Value) -> Result<String> {
    let body = fill(&format!("{MACROS}{template}"), values)?;
    let style = drawn(STYLE.into());
    fill(
        SHELL,
        context! { title, heading, style, body => drawn(body) },
    )
}

fn fill(template: &str, values: Value) -> Result<String> {
    let mut environment = Environment::new();
    environment.set_undefined_behavior(UndefinedBehavior::SemiStrict);
    // The ending of the name turns escaping on.
    let filled = environment.render_named_str("page.html", template, values);
    filled.map_err(Error::Page)
}

/// A value for a template.
pub fn value(value: impl Serialize) -> Value {
    Value::from(Serde(value))
}

/// HTML that is inserted as it is.
pub fn drawn(html: String) -> Value {
    Value::from_safe_string(html)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::Table;

    #[test]
    fn text_is_escaped_charts_are_not_and_a_missing_value_is_an_error() {
        let values = || context! { name => value("<b>"), svg => drawn("<svg></svg>".into()) };
        let shown = page("A & B", "{{ name }}{{ chart(svg) }}", values()).unwrap();
        for text in [
            "<h1>A &amp; B</h1>",
            "&lt;b&gt;<div",
            "<svg></svg>",
            "max-width",
        ] {
            assert!(shown.contains(text), "{text}: {shown}");
        }
        let error = page("A", "{{ absent }}", values()).unwrap_err().to_string();
        assert!(error.contains("cannot draw the page"), "{error}");
    }

    #[test]
    fn a_table_has_its_groups_in_a_row_above_its_columns() {
        let mut table = Table::new("Numbers")
            .words(["Name"])
            .numbers("both", ["a", "b"]);
        table.row(["x < y", "1", "2"]).class = "best";
        let shown = page("T", "{{ table(rows) }}", context! { rows => value(table) }).unwrap();
        for text in [
            "aria-label=\"Numbers\"",
            "<tr><th class=\"word\" rowspan=\"2\">Name</th><th class=\"group\" colspan=\"2\">both</th></tr>",
            "<tr><th class=\"first\">a</th><th>b</th></tr>",
            "<tr class=\"best\"><td class=\"word\">x &lt; y</td><td class=\"first\">1</td><td>2</td></tr>",
        ] {
            assert!(shown.contains(text), "{text}: {shown}");
        }
    }
}
