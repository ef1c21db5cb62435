//! Enforcement of the limits of [`dataset::numbers::limits`] in a sweep, where a number may be a spread; they are also part of the
//! schema.

use dataset::numbers::limits::Limits;
use schemars::Schema;
use schemars::transform::Transform;
use serde_json::Value;

use super::fault::{Checked, fault};
use crate::spread::Spread;

/// Limits as the tables of a sweep enforce them.
pub(crate) trait Enforce {
    /// Rejects a number outside; NaN is never in range.
    fn check_key(self, key: impl Into<String>, value: f64) -> Checked<()>;
    /// Rejects a spread from which a number outside could be drawn.
    fn check_spread(self, key: impl Into<String>, spread: &Spread) -> Checked<()>;
    /// Writes the limits into the schema of a number or of a spread.
    fn in_schema(self) -> InSchema;
}

impl Enforce for Limits {
    fn check_key(self, key: impl Into<String>, value: f64) -> Checked<()> {
        self.check(value)
            .or_else(|outside| fault(key, outside.to_string()))
    }

    fn check_spread(self, key: impl Into<String>, spread: &Spread) -> Checked<()> {
        let (lowest, highest) = spread.range();
        let Self { least, most, what } = self;
        if lowest == highest {
            return self.check_key(key, lowest);
        }
        if self.hold(lowest) && self.hold(highest) {
            return Ok(());
        }
        fault(
            key,
            format!(
                "{spread} can give {lowest} to {highest}, which is out of range; expected {what} from {least} to {most}"
            ),
        )
    }

    fn in_schema(self) -> InSchema {
        InSchema(self)
    }
}

/// Limits that go into a schema.
pub(crate) struct InSchema(Limits);

impl InSchema {
    fn limit(&self, schema: &mut Schema) {
        if is_number(schema.get("type")) {
            schema.insert("minimum".into(), self.0.least.into());
            schema.insert("maximum".into(), self.0.most.into());
        }
        let limit_value = |value: &mut Value| {
            if let Ok(schema) = value.try_into() {
                self.limit(schema);
            }
        };
        if let Some(Value::Array(alternatives)) = schema.get_mut("anyOf") {
            alternatives.iter_mut().for_each(limit_value);
        }
        if let Some(items) = schema.get_mut("items") {
            limit_value(items);
        }
        if let Some(Value::Object(properties)) = schema.get_mut("properties") {
            for (name, property) in properties {
                if name != Spread::DEVIATION {
                    limit_value(property);
                }
            }
        }
    }
}

impl Transform for InSchema {
    fn transform(&mut self, schema: &mut Schema) {
        self.limit(schema);
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
