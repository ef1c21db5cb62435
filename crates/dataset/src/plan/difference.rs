//! Differences between two plans for one corpus.

use std::collections::{BTreeMap, BTreeSet};

use super::{Plan, PlannedScenario};
use serde::Serialize;
use serde_json::Value;

/// Maximum number of differences to report.
const MAX_SHOWN: usize = 3;

/// Scenarios that a plan adds to, changes in and removes from an earlier one.
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
    /// Identifier of the scenario.
    pub id: String,
    /// The first value that differs, before and after.
    pub what: String,
}

impl Difference {
    /// Differences between an earlier plan and a new one.
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
                        .or_else(|| other_seed(earlier, scenario))
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

    /// Reason why a corpus of the earlier plan cannot be finished with the new one; `None` if scenarios are only added.
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
        let shown = all[..MAX_SHOWN.min(all.len())].join("; ");
        match all.len().saturating_sub(MAX_SHOWN) {
            0 => Some(shown),
            more => Some(format!("{shown}; and {more} more")),
        }
    }
}

/// A different seed changes every value that is drawn: it is the cause, they are the effect.
fn other_seed(before: &PlannedScenario, after: &PlannedScenario) -> Option<String> {
    (before.seed != after.seed).then(|| {
        format!(
            "its seed was {}, now {}: `seed` of [corpus] is another",
            before.seed, after.seed
        )
    })
}

fn first_difference_of(before: &impl Serialize, after: &impl Serialize) -> Option<String> {
    let before = serde_json::to_value(before).unwrap_or_default();
    let after = serde_json::to_value(after).unwrap_or_default();
    first_difference(&[], &before, &after)
}

/// The first value that differs between two JSON documents, ignoring hashes, in words.
fn first_difference(keys: &[String], before: &Value, after: &Value) -> Option<String> {
    let below = |key: &str| [keys, &[key.to_owned()]].concat();
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
            .find_map(|(i, (x, y))| first_difference(&below(&(i + 1).to_string()), x, y)),
        _ => (before != after).then(|| {
            let value = |value: &Value| match value {
                Value::Array(list) => format!("a list of {}", list.len()),
                value => value.to_string(),
            };
            let key = keys.join(".");
            format!("{key} was {}, now {}", value(before), value(after))
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_change_is_said_with_its_key_and_both_values() {
        let said = |before: Value, after: Value| first_difference(&[], &before, &after);
        let weather = |visibility_m: f64| json!({"weather": {"visibility_m": visibility_m}});
        assert_eq!(
            said(weather(30_000.0), weather(20_000.0)).unwrap(),
            "weather.visibility_m was 30000.0, now 20000.0"
        );
        let cameras =
            |pitch_deg: Option<f64>| json!({"cameras": [{"id": "left", "pitch_deg": pitch_deg}]});
        assert_eq!(
            said(cameras(Some(1.6)), cameras(None)).unwrap(),
            "cameras.1.pitch_deg was 1.6, now null"
        );
        assert_eq!(
            said(json!({"clouds": [1, 2]}), json!({"clouds": [1]})).unwrap(),
            "clouds was a list of 2, now a list of 1"
        );
        assert_eq!(said(weather(1.0), weather(1.0)), None);
    }
}
