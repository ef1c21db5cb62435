//! A template filled with values.
//!
//! A template puts `{{ style }}` into its `<style>`. Text is escaped; charts are inserted as they are ([`drawn`]).

use minijinja::value::Serde;
use minijinja::{Environment, UndefinedBehavior, Value};
use serde::Serialize;

use crate::error::{Error, Result};

/// Fills a template.
///
/// # Errors
/// The template is wrong, or lacks a value.
pub fn render(template: &'static str, values: Value) -> Result<String> {
    let mut environment = Environment::new();
    environment.set_undefined_behavior(UndefinedBehavior::SemiStrict);
    environment.add_global("style", Value::from_safe_string(STYLE.into()));
    // The ending of the name is what turns escaping on.
    const NAME: &str = "report.html";
    environment
        .add_template(NAME, template)
        .and_then(|()| environment.get_template(NAME)?.render(values))
        .map_err(Error::Page)
}

/// A value for a template.
pub fn value(value: impl Serialize) -> Value {
    Value::from(Serde(value))
}

/// HTML that is inserted as it is.
pub fn drawn(html: String) -> Value {
    Value::from_safe_string(html)
}

/// The look of all pages.
pub const STYLE: &str = include_str!("style.css");

#[cfg(test)]
mod tests {
    use super::*;
    use minijinja::context;

    #[test]
    fn text_is_escaped_charts_are_not_and_a_missing_value_is_an_error() {
        let values = || context! { name => value("<b>"), chart => drawn("<svg></svg>".into()) };
        let page = render("{{ name }}{{ chart }}{{ style }}", values()).unwrap();
        assert!(page.starts_with("&lt;b&gt;<svg></svg>"), "{page}");
        assert!(page.contains("max-width"), "{page}");
        let error = render("{{ absent }}", values()).unwrap_err().to_string();
        assert!(error.contains("cannot draw the page"), "{error}");
    }
}
