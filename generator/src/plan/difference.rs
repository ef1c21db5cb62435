//! How two plans for one corpus differ.

use std::collections::BTreeMap;

use serde_json::Value;

use super::{Plan, PlannedScenario};

/// So many differences say enough.
const MOST_SHOWN: usize = 3;

/// Why `new` cannot take the place of `frozen`; `None` if every scenario of `frozen` is in it unchanged.
pub(super) fn conflict(new: &Plan, frozen: &Plan) -> Option<String> {
    let by_id: BTreeMap<&str, &PlannedScenario> =
        new.scenarios.iter().map(|s| (s.id.as_str(), s)).collect();
    let differences: Vec<String> = frozen
        .scenarios
        .iter()
        .filter_map(|old| match by_id.get(old.id.as_str()) {
            None => Some(format!("scenario {} is no longer in the sweep", old.id)),
            Some(now) if now.config_hash != old.config_hash => Some(changed(old, now)),
            Some(_) => None,
        })
        .collect();
    if differences.is_empty() {
        return None;
    }
    let more = differences.len().saturating_sub(MOST_SHOWN);
    let mut text = differences
        .into_iter()
        .take(MOST_SHOWN)
        .collect::<Vec<_>>()
        .join("; ");
    if more > 0 {
        text += &format!("; and {more} more");
    }
    Some(text)
}

fn changed(old: &PlannedScenario, now: &PlannedScenario) -> String {
    let [before, after] = [old, now].map(|s| serde_json::to_value(s).unwrap_or_default());
    let what = first_difference("", &before, &after).unwrap_or_else(|| "its hash differs".into());
    format!("scenario {}: {what}", old.id)
}

/// The first value that differs between two JSON documents, hashes left aside.
fn first_difference(path: &str, before: &Value, after: &Value) -> Option<String> {
    let below = |key: &str| {
        if path.is_empty() {
            key.to_owned()
        } else {
            format!("{path}.{key}")
        }
    };
    match (before, after) {
        (Value::Object(a), Value::Object(b)) => a
            .keys()
            .chain(b.keys().filter(|key| !a.contains_key(*key)))
            .filter(|key| *key != "config_hash")
            .find_map(|key| {
                let [x, y] = [a, b].map(|object| object.get(key).unwrap_or(&Value::Null));
                first_difference(&below(key), x, y)
            }),
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => a
            .iter()
            .zip(b)
            .enumerate()
            .find_map(|(i, (x, y))| first_difference(&below(&i.to_string()), x, y)),
        _ => (before != after).then(|| format!("{path} was {before}, now is {after}")),
    }
}
