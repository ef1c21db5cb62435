//! Differences between two JSON values.

use std::collections::BTreeSet;

use serde_json::{Map, Value};

/// Maximum number of differences that are named.
const MAX_NAMED: usize = 8;

/// Differences as path, value here and value there.
pub(crate) fn json_differences(here: &Value, there: &Value) -> Vec<String> {
    let mut found = Vec::new();
    collect("", here, there, &mut found);
    named(found)
}

pub(crate) fn collect(path: &str, here: &Value, there: &Value, found: &mut Vec<String>) {
    match (here, there) {
        (Value::Object(a), Value::Object(b)) => {
            let keys: BTreeSet<&String> = a.keys().chain(b.keys()).collect();
            for key in keys {
                let of = |object: &Map<String, Value>| object.get(key).cloned();
                let [here, there] = [of(a), of(b)].map(Option::unwrap_or_default);
                let path = match path {
                    "" => key.clone(),
                    path => format!("{path}.{key}"),
                };
                collect(&path, &here, &there, found);
            }
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            for (index, (here, there)) in a.iter().zip(b).enumerate() {
                collect(&format!("{path}[{index}]"), here, there, found);
            }
        }
        _ if here != there => found.push(format!("{path} {here} and {there}")),
        _ => {}
    }
}

/// The first differences, and the number left out.
pub(crate) fn named(mut differences: Vec<String>) -> Vec<String> {
    let more = differences.len().saturating_sub(MAX_NAMED);
    differences.truncate(MAX_NAMED);
    if more > 0 {
        differences.push(format!("and {more} more"));
    }
    differences
}
