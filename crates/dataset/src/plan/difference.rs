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
        _ => (before != after).then(|| in_words(keys, before, after)),
    }
}

/// Keys that only group others.
const GROUPS: [&str; 5] = ["parameters", "conditions", "clock", "flight", "live"];
/// Endings of keys and what stands for them after a value; a longer ending comes before the one that it ends in.
const UNITS: [(&str, &str); 12] = [
    ("_msl_m", " m above sea level"),
    ("_true_deg", "° true"),
    ("_magnetic_deg", "° magnetic"),
    ("_deg", "°"),
    ("_mps", " m/s"),
    ("_mhz", " MHz"),
    ("_px", " px"),
    ("_hpa", " hPa"),
    ("_ratio", ""),
    ("_c", " °C"),
    ("_m", " m"),
    ("_s", " s"),
];

fn in_words(keys: &[String], before: &Value, after: &Value) -> String {
    let last = keys.last().map_or("", String::as_str);
    if last == "blake3" {
        return "the recording's content changed".into();
    }
    let unit = UNITS.iter().find(|(ending, _)| last.ends_with(ending));
    let (ending, unit) = unit.copied().unwrap_or_default();
    let mut words: Vec<&str> = keys.iter().map(String::as_str).collect();
    let last = words.pop();
    words.retain(|word| !GROUPS.contains(word));
    words.extend(last);
    let what = words.join(" ").replace('_', " ");
    let what = &what[..what.len() - ending.len()];
    let rounded = |value: &Value| value.as_f64().map(rounded);
    // Values that only differ in later digits are shown with all digits.
    let is_told_apart = rounded(before) != rounded(after);
    let value = |value: &Value| match (value, value.as_f64()) {
        (Value::Number(whole), Some(_)) if !whole.is_f64() => format!("{whole}{unit}"),
        (_, Some(number)) if is_told_apart => format!("{}{unit}", self::rounded(number)),
        (_, Some(number)) => format!("{number}{unit}"),
        (Value::Null, _) => "none".into(),
        (Value::Array(list), _) => list.len().to_string(),
        _ => value.to_string(),
    };
    if before.is_array() && after.is_array() {
        return format!(
            "the number of {what} was {}, now {}",
            value(before),
            value(after)
        );
    }
    format!("{what} was {}, now {}", value(before), value(after))
}

/// A number to four significant digits, but never without its ones.
fn rounded(number: f64) -> f64 {
    let digits_before_point = number.abs().max(f64::MIN_POSITIVE).log10().floor() as i32 + 1;
    let factor = 10_f64.powi((4 - digits_before_point).clamp(0, 15));
    (number * factor).round() / factor
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn figures_are_rounded_unless_that_hides_the_change() {
        let said = |before: f64, after: f64| {
            let document = |value: f64| json!({"cross_track_m": value});
            first_difference(&[], &document(before), &document(after)).unwrap()
        };
        assert_eq!(
            said(-5.570_341_329_923_742_5, -44.118_075_239_217_55),
            "cross track was -5.57 m, now -44.12 m"
        );
        assert_eq!(
            said(17_093.37, 0.000_123_456),
            "cross track was 17093 m, now 0.0001235 m"
        );
        assert_eq!(
            said(118.751, 118.752),
            "cross track was 118.751 m, now 118.752 m"
        );
    }

    #[test]
    fn a_change_is_said_in_words_with_units() {
        let said = |before: Value, after: Value| first_difference(&[], &before, &after);
        let weather = |visibility_m: f64| json!({"parameters": {"conditions": {"weather": {"visibility_m": visibility_m}}}});
        assert_eq!(
            said(weather(30_000.0), weather(20_000.0)).unwrap(),
            "weather visibility was 30000 m, now 20000 m"
        );
        let cameras =
            |pitch_deg: Option<f64>| json!({"cameras": [{"id": "left", "pitch_deg": pitch_deg}]});
        assert_eq!(
            said(cameras(Some(1.6)), cameras(None)).unwrap(),
            "cameras 1 pitch was 1.6°, now none"
        );
        assert_eq!(
            said(json!({"rig": "wide"}), json!({"rig": "narrow"})).unwrap(),
            r#"rig was "wide", now "narrow""#
        );
        assert_eq!(
            said(json!({"flight": "a.csv"}), json!({"flight": "b.csv"})).unwrap(),
            r#"flight was "a.csv", now "b.csv""#
        );
        let recording = |blake3: &str| json!({"flight": {"blake3": blake3}});
        assert_eq!(
            said(recording("5b"), recording("5c")).unwrap(),
            "the recording's content changed"
        );
        assert_eq!(said(recording("5b"), recording("5b")), None);
    }
}
