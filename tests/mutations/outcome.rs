//! A verb's outcome: its answer and everything on disk afterwards, value by value, for comparison with another run.

use std::collections::BTreeMap;
use std::fs;
use std::process::Output;

use serde_json::Value;

use super::tiny::Tiny;

/// Values by location: a file's name and, within JSON, the path to the value.
pub(super) struct Outcome(BTreeMap<String, String>);

impl Outcome {
    pub(super) fn of(tiny: &Tiny, output: &Output) -> Self {
        let mut values = BTreeMap::new();
        let root = tiny.root().to_string_lossy().into_owned();
        let answer = String::from_utf8_lossy(&output.stdout).replace(&root, "{root}");
        add("the answer", answer.as_bytes(), &mut values);
        for name in tiny.files() {
            let path = tiny.path(&name);
            let is_plain = fs::symlink_metadata(&path)
                .is_ok_and(|about| about.is_file() && about.len() < 1 << 30);
            if is_plain {
                add(&name, &fs::read(path).unwrap(), &mut values);
            }
        }
        Self(values)
    }

    /// The outcome without differences between equal runs: mostly times.
    pub(super) fn steady_part(mut self, other: &Self) -> Self {
        self.0
            .retain(|place, value| other.0.get(place) == Some(value));
        self
    }

    /// The first value that differs from the other outcome, except those of one file and counts of bytes, which a damaged file
    /// changes legitimately.
    pub(super) fn difference(&self, other: &Self, besides: &str) -> Option<String> {
        self.0
            .iter()
            .filter(|(place, _)| {
                place.split('#').next() != Some(besides) && !place.contains("bytes")
            })
            .find_map(|(place, value)| match other.0.get(place) {
                None => Some(format!("{place} is not there, it was {value}")),
                Some(found) if found != value => {
                    Some(format!("{place} is {found}, it was {value}"))
                }
                Some(_) => None,
            })
    }
}

fn add(name: &str, bytes: &[u8], values: &mut BTreeMap<String, String>) {
    match serde_json::from_slice::<Value>(bytes) {
        Ok(document) => leaves(name.to_owned() + "#", &document, values),
        Err(_) => {
            values.insert(name.into(), blake3::hash(bytes).to_hex()[..16].to_owned());
        }
    }
}

fn leaves(place: String, value: &Value, values: &mut BTreeMap<String, String>) {
    match value {
        Value::Object(object) => {
            for (key, value) in object {
                leaves(format!("{place}/{key}"), value, values);
            }
        }
        Value::Array(array) => {
            values.insert(format!("{place}/length"), array.len().to_string());
            for (index, value) in array.iter().enumerate() {
                leaves(format!("{place}/{index}"), value, values);
            }
        }
        _ => {
            values.insert(place, value.to_string());
        }
    }
}
