//! Local times as a sweep lists them: by the clock, by the sun, or as a range with a step.

mod local_day;
mod sun_passing;

use std::fmt;

use dataset::numbers::limits;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{Error, MapAccess, Visitor, value::MapAccessDeserializer};
use serde::{Deserialize, Deserializer};

use crate::sweep::check::fault::{Checked, Fault, fault};
use crate::sweep::check::limits::check_number;
use crate::time_of_day::TimeOfDay;

pub(in crate::sweep) use local_day::LocalDay;
use sun_passing::{Half, SunPassing};

const PATTERN: &str = "^(([01][0-9]|2[0-3]):[0-5][0-9]|(dawn|sunrise|sunset|dusk)([+-]([01][0-9]|2[0-3]):[0-5][0-9])?)$";
const EXPECTED: &str = "a time \"HH:MM\", \"dusk\" or \"sunset-00:20\", an elevation of the sun { sun_elevation_deg = -4, in = \"evening\" }, or a \
                        range { from = \"06:00\", to = \"18:00\", every_min = 60 }";
const MINUTES_PER_DAY: u32 = 24 * 60;

#[derive(Debug, Clone, PartialEq)]
pub(crate) enum TimeEntry {
    At(String),
    /// `{ sun_elevation_deg = -4, in = "evening" }`: the centre of the sun, without refraction.
    Sun(SunPassing),
    /// `{ from = "06:00", to = "18:00", every_min = 60 }`: both ends are included, if the step reaches the second.
    Every {
        from: String,
        to: String,
        every_min: u32,
    },
}

/// The keys of both tables.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TimeTable {
    sun_elevation_deg: Option<f64>,
    r#in: Option<Half>,
    from: Option<String>,
    to: Option<String>,
    every_min: Option<u32>,
}

impl TimeTable {
    fn entry<E: Error>(self) -> Result<TimeEntry, E> {
        let missing = E::missing_field;
        match self {
            Self {
                sun_elevation_deg: Some(elevation_deg),
                r#in,
                from: None,
                to: None,
                every_min: None,
            } => Ok(TimeEntry::Sun(SunPassing {
                elevation_deg,
                half: r#in.ok_or_else(|| missing("in"))?,
            })),
            Self {
                sun_elevation_deg: None,
                r#in: None,
                from,
                to,
                every_min,
            } => Ok(TimeEntry::Every {
                from: from.ok_or_else(|| missing("from"))?,
                to: to.ok_or_else(|| missing("to"))?,
                every_min: every_min.ok_or_else(|| missing("every_min"))?,
            }),
            _ => Err(E::custom(format!(
                "keys of two kinds of times; expected {EXPECTED}"
            ))),
        }
    }
}

/// Reads a time of day: `HH:MM`, or a name such as `dusk` with an offset.
pub(crate) fn parse(key: &str, text: &str, day: &LocalDay) -> Checked<TimeOfDay> {
    if let Some(time) = TimeOfDay::parse(text) {
        return Ok(time);
    }
    let (name, offset) = match text.find(['+', '-']) {
        Some(at) => (&text[..at], &text[at..]),
        None => (text, ""),
    };
    let later_min = match offset.split_at_checked(1) {
        None => Some(0),
        Some((sign, time)) => TimeOfDay::parse(time).map(|time| match sign {
            "-" => MINUTES_PER_DAY - time.minutes(),
            _ => time.minutes(),
        }),
    };
    match (SunPassing::named(name), later_min) {
        (Some(passing), Some(later_min)) => {
            let time = on_day(passing, key, day)?;
            Ok(TimeOfDay::from_minutes(time.minutes() + later_min))
        }
        _ => fault(
            key,
            format!(
                "{text:?} is not a time of day; expected HH:MM from 00:00 to 23:59, or dawn, sunrise, sunset or dusk, also with a \
                 difference: sunset-00:20"
            ),
        ),
    }
}

fn on_day(passing: SunPassing, key: &str, day: &LocalDay) -> Checked<TimeOfDay> {
    passing.on(day).map_err(|[lowest, highest]| Fault {
        key: key.to_owned(),
        message: format!(
            "the sun does not pass {} degrees in the {} of day {}: it is between {lowest:.1} and {highest:.1} degrees then",
            passing.elevation_deg,
            match passing.half {
                Half::Morning => "morning",
                Half::Evening => "evening",
            },
            day.day_of_year
        ),
    })
}

impl TimeEntry {
    /// The times that it stands for; never empty.
    pub(crate) fn times(&self, key: &str, day: &LocalDay) -> Checked<Vec<TimeOfDay>> {
        let (from, to, every_min) = match self {
            Self::At(text) => return Ok(vec![parse(key, text, day)?]),
            Self::Sun(passing) => {
                let elevation_key = format!("{key}.sun_elevation_deg");
                check_number(
                    elevation_key,
                    passing.elevation_deg,
                    limits::SUN_ELEVATION_DEG,
                )?;
                return Ok(vec![on_day(*passing, key, day)?]);
            }
            Self::Every {
                from,
                to,
                every_min,
            } => (from, to, every_min),
        };
        let first = parse(&format!("{key}.from"), from, day)?.minutes();
        let last = parse(&format!("{key}.to"), to, day)?.minutes();
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
                TimeTable::deserialize(MapAccessDeserializer::new(map))?.entry()
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
                        "sun_elevation_deg": {
                            "type": "number",
                            "minimum": limits::SUN_ELEVATION_DEG.least,
                            "maximum": limits::SUN_ELEVATION_DEG.most,
                        },
                        "in": { "enum": ["morning", "evening"] },
                    },
                    "required": ["sun_elevation_deg", "in"],
                    "additionalProperties": false,
                },
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
