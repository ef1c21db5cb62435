//! How two plans for one corpus differ.

use std::collections::{BTreeMap, BTreeSet};

use dataset::plan::{Plan, PlannedScenario};
use serde::Serialize;
use serde_json::Value;

/// Maximum number of differences to report.
const MOST_SHOWN: usize = 3;

/// What a plan adds to, changes in and removes from an earlier one.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Difference {
    /// Scenarios that only the new plan has.
    pub added: Vec<String>,
    /// Scenarios that both have, but with different parameters.
    pub changed: Vec<Change>,
    /// Scenarios that only the earlier plan has.
    pub removed: Vec<String>,
}

/// A scenario that changed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Change {
    /// Its identifier.
    pub id: String,
    /// The first value that differs, before and after.
    pub what: String,
}

impl Difference {
    /// What differs between an earlier plan and a new one.
    pub fn between(old: &Plan, new: &Plan) -> Self {
        let before: BTreeMap<&str, &PlannedScenario> =
            old.scenarios.iter().map(|s| (s.id.as_str(), s)).collect();
        let after: BTreeSet<&str> = new.scenarios.iter().map(|s| s.id.as_str()).collect();
        let common = first_difference_of(&old.common, &new.common);
        let mut difference = Self::default();
        for scenario in &new.scenarios {
            match before.get(scenario.id.as_str()) {
                None => difference.added.push(scenario.id.clone()),
                Some(earlier) if earlier.config_hash != scenario.config_hash => {
                    let what = common
                        .clone()
                        .or_else(|| first_difference_of(*earlier, scenario));
                    difference.changed.push(Change {
                        id: scenario.id.clone(),
                        what: what.unwrap_or_else(|| "its hash differs".into()),
                    });
                }
                Some(_) => {}
            }
        }
        let removed = old.scenarios.iter().map(|s| &s.id);
        difference.removed = removed
            .filter(|id| !after.contains(id.as_str()))
            .cloned()
            .collect();
        difference
    }

    /// Why a corpus of the earlier plan cannot be finished with the new one; `None` if scenarios are only added.
    pub fn conflict(&self) -> Option<String> {
        let removed = self.removed.iter();
        let changed = self.changed.iter();
        let all: Vec<String> = removed
            .map(|id| format!("scenario {id} is no longer in the sweep"))
            .chain(changed.map(|change| format!("scenario {}: {}", change.id, change.what)))
            .collect();
        if all.is_empty() {
            return None;
        }
        let shown = all[..MOST_SHOWN.min(all.len())].join("; ");
        match all.len().saturating_sub(MOST_SHOWN) {
            0 => Some(shown),
            more => Some(format!("{shown}; and {more} more")),
        }
    }
}

fn first_difference_of(before: &impl Serialize, after: &impl Serialize) -> Option<String> {
    let before = serde_json::to_value(before).unwrap_or_default();
    let after = serde_json::to_value(after).unwrap_or_default();
    first_difference("", &before, &after)
}

/// The first value that differs between two JSON documents, ignoring hashes.
fn first_difference(path: &str, before: &Value, after: &Value) -> Option<String> {
    let below = |key: &str| {
        if path.is_empty() || path == "parameters" {
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
