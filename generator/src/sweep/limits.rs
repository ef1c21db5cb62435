//! Between which values a number of a sweep has to lie: said once, for the check and for the schema.

use schemars::Schema;
use schemars::transform::Transform;
use serde_json::Value;

use super::fault::{Checked, fault};
use crate::spread::Spread;

/// The least and the greatest value of a number, and what the number is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits {
    least: f64,
    most: f64,
    what: &'static str,
}

impl Limits {
    pub(crate) const fn new(least: f64, most: f64, what: &'static str) -> Self {
        Self { least, most, what }
    }

    /// Refuses a number outside; NaN is in no range.
    pub(super) fn check(self, key: impl Into<String>, value: f64) -> Checked<()> {
        let Self { least, most, what } = self;
        if (least..=most).contains(&value) {
            Ok(())
        } else {
            fault(
                key,
                format!("{value} is out of range; expected {what} from {least} to {most}"),
            )
        }
    }

    /// Refuses a spread from which a number outside could be drawn.
    pub(super) fn check_spread(self, key: impl Into<String>, spread: &Spread) -> Checked<()> {
        let (lowest, highest) = spread.range();
        let Self { least, most, what } = self;
        if lowest == highest {
            return self.check(key, lowest);
        }
        if least <= lowest && highest <= most {
            return Ok(());
        }
        fault(
            key,
            format!(
                "{spread} can give {lowest} to {highest}, which is out of range; expected {what} from {least} to {most}"
            ),
        )
    }

    /// What writes the limits into the schema of a number or of a spread.
    pub(super) fn in_schema(self) -> impl Transform {
        self
    }

    fn limit(self, schema: &mut Schema) {
        if is_number(schema.get("type")) {
            schema.insert("minimum".into(), self.least.into());
            schema.insert("maximum".into(), self.most.into());
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

impl Transform for Limits {
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
