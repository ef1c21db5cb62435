//! Local times as a sweep lists them: one by one, or as a range with a step.

use std::fmt;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{Error, MapAccess, Visitor, value::MapAccessDeserializer};
use serde::{Deserialize, Deserializer};

use super::fault::{Checked, fault};
use crate::time_of_day::TimeOfDay;

const PATTERN: &str = "^([01][0-9]|2[0-3]):[0-5][0-9]$";
const EXPECTED: &str =
    "a time \"HH:MM\" or a range { from = \"06:00\", to = \"18:00\", every_min = 60 }";
const MINUTES_PER_DAY: u32 = 24 * 60;

/// An entry of a list of times.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum TimeEntry {
    At(String),
    Every(TimeRange),
}

/// `{ from = "06:00", to = "18:00", every_min = 60 }`: both ends are included, if the step reaches the second.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TimeRange {
    from: String,
    to: String,
    every_min: u32,
}

/// Reads a time of day.
pub(super) fn parse(key: &str, text: &str) -> Checked<TimeOfDay> {
    match TimeOfDay::parse(text) {
        Some(time) => Ok(time),
        None => fault(
            key,
            format!("{text:?} is not a time of day; expected HH:MM from 00:00 to 23:59"),
        ),
    }
}

impl TimeEntry {
    /// The times that it stands for; never empty.
    pub(super) fn times(&self, key: &str) -> Checked<Vec<TimeOfDay>> {
        let TimeRange {
            from,
            to,
            every_min,
        } = match self {
            Self::At(text) => return Ok(vec![parse(key, text)?]),
            Self::Every(range) => range,
        };
        let first = parse(&format!("{key}.from"), from)?.minutes();
        let last = parse(&format!("{key}.to"), to)?.minutes();
        if last < first {
            return fault(
                format!("{key}.to"),
                format!("{to} is before {from}; for a range over midnight write two ranges"),
            );
        }
        if !(1..MINUTES_PER_DAY).contains(every_min) {
            return fault(
                format!("{key}.every_min"),
                format!(
                    "{every_min} is not a step; expected 1 to {} minutes",
                    MINUTES_PER_DAY - 1
                ),
            );
        }
        Ok((first..=last)
            .step_by(*every_min as usize)
            .map(TimeOfDay::from_minutes)
            .collect())
    }
}

impl<'de> Deserialize<'de> for TimeEntry {
    fn deserialize<D: Deserializer<'de>>(input: D) -> Result<Self, D::Error> {
        struct Entry;
        impl<'de> Visitor<'de> for Entry {
            type Value = TimeEntry;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(EXPECTED)
            }

            fn visit_str<E: Error>(self, text: &str) -> Result<TimeEntry, E> {
                Ok(TimeEntry::At(text.to_owned()))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<TimeEntry, A::Error> {
                TimeRange::deserialize(MapAccessDeserializer::new(map)).map(TimeEntry::Every)
            }
        }
        input.deserialize_any(Entry)
    }
}

impl JsonSchema for TimeEntry {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "TimeEntry".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        let time = || json_schema!({ "type": "string", "pattern": PATTERN });
        json_schema!({
            "description": EXPECTED,
            "anyOf": [
                time(),
                {
                    "type": "object",
                    "properties": {
                        "from": time(),
                        "to": time(),
                        "every_min": {
                            "type": "integer",
                            "minimum": 1,
                            "maximum": MINUTES_PER_DAY - 1,
                        },
                    },
                    "required": ["from", "to", "every_min"],
                    "additionalProperties": false,
                },
            ],
        })
    }
}
