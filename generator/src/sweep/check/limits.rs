//! Numeric limits in a sweep ([`dataset::numbers::limits`]). Each is stated once, at its field: it becomes part of the schema, and
//! [`check`] enforces the schema's limits.

use dataset::numbers::limits::Limits;
use schemars::Schema;
use schemars::transform::Transform;
use serde::Deserialize;
use serde_json::{Map, Value, json};

use super::fault::{Checked, fault};
use crate::spread::Spread;

/// Schema key of [`Limits`]; the published schema lacks it.
pub(crate) const LIMITS: &str = "x-limits";

/// Rejects numbers outside their limits, and spreads that can give such numbers.
pub(crate) fn check(sweep: &toml::Value, schema: &'static Value) -> Checked<()> {
    check_value("", sweep, schema, schema)
}

fn check_value(
    key: &str,
    value: &toml::Value,
    schema: &'static Value,
    root: &'static Value,
) -> Checked<()> {
    if let Some(limits) = schema.get(LIMITS) {
        let end = |name: &str| limits[name].as_f64().unwrap_or(f64::NAN);
        let what = limits["what"].as_str().unwrap_or_default();
        // NaN is the one number that no spread accepts.
        let spread = Spread::deserialize(value.clone()).unwrap_or(Spread::Fixed(f64::NAN));
        return check_spread(key, &spread, Limits::new(end("least"), end("most"), what));
    }
    if let Some(name) = schema.get("$ref").and_then(Value::as_str) {
        let definition = root.pointer(name.trim_start_matches('#'));
        check_value(key, value, definition.unwrap_or(&Value::Null), root)?;
    }
    for keyword in ["allOf", "anyOf"] {
        let schemas = schema.get(keyword).and_then(Value::as_array);
        for schema in schemas.into_iter().flatten() {
            check_value(key, value, schema, root)?;
        }
    }
    let below = |name: &str| format!("{key}{}{name}", if key.is_empty() { "" } else { "." });
    match value {
        toml::Value::Table(table) => {
            let properties = schema.get("properties");
            for (name, value) in table {
                let named = properties.and_then(|properties| properties.get(name));
                if let Some(schema) = named.or_else(|| schema.get("additionalProperties")) {
                    check_value(&below(name), value, schema, root)?;
                }
            }
        }
        toml::Value::Array(values) => {
            if let Some(schema) = schema.get("items") {
                for (index, value) in values.iter().enumerate() {
                    check_value(&below(&index.to_string()), value, schema, root)?;
                }
            }
        }
        _ => {}
    }
    Ok(())
}

/// Rejects a number outside its limits; NaN is never within.
pub(crate) fn check_number(key: impl Into<String>, value: f64, limits: Limits) -> Checked<()> {
    limits
        .check(value)
        .or_else(|outside| fault(key, outside.to_string()))
}

/// Rejects a spread that can give numbers outside the limits.
pub(crate) fn check_spread(key: impl Into<String>, spread: &Spread, limits: Limits) -> Checked<()> {
    let (lowest, highest) = spread.range();
    let Limits { least, most, what } = limits;
    if lowest == highest || lowest.is_nan() {
        return check_number(key, lowest, limits);
    }
    if limits.hold(lowest) && limits.hold(highest) {
        return Ok(());
    }
    fault(
        key,
        format!(
            "{spread} can give {lowest} to {highest}, which is out of range; expected {what} from {least} to {most}"
        ),
    )
}

/// Schema transform: adds limits to a number or a spread.
pub(crate) fn in_schema(limits: Limits) -> impl Transform {
    move |schema: &mut Schema| {
        let Limits { least, most, what } = limits;
        limit(schema.ensure_object(), least, most);
        schema.insert(
            LIMITS.into(),
            json!({ "least": least, "most": most, "what": what }),
        );
    }
}

fn limit(schema: &mut Map<String, Value>, least: f64, most: f64) {
    if is_number(schema.get("type")) {
        schema.insert("minimum".into(), least.into());
        schema.insert("maximum".into(), most.into());
    }
    let limit_value = |value: &mut Value| {
        if let Value::Object(schema) = value {
            limit(schema, least, most);
        }
    };
    if let Some(Value::Array(alternatives)) = schema.get_mut("anyOf") {
        alternatives.iter_mut().for_each(limit_value);
    }
    if let Some(items) = schema.get_mut("items") {
        limit_value(items);
    }
    if let Some(Value::Object(properties)) = schema.get_mut("properties") {
        let properties = properties.iter_mut();
        let values = properties.filter(|(name, _)| *name != Spread::DEVIATION);
        values.for_each(|(_, value)| limit_value(value));
    }
}

fn is_number(types: Option<&Value>) -> bool {
    let number = |name: &Value| name == "number" || name == "integer";
    match types {
        Some(Value::Array(names)) => names.iter().any(number),
        Some(name) => number(name),
        None => false,
    }
}
