//! Frame rates as people write them: `30`, `"30"`, `"1/2"`, `"30000/1001"`.

use std::fmt;

use dataset::frame_rate::FrameRate;
use schemars::{Schema, SchemaGenerator, json_schema};
use serde::de::{Error, Unexpected, Visitor};
use serde::{Deserializer, Serialize, Serializer};

const EXPECTED: &str = "frames per second above zero, as a whole number (30) or a fraction in quotes (\"30000/1001\", \"1/2\")";

/// No simulator draws faster.
pub(super) const HIGHEST_HZ: u32 = 240;

pub(super) fn schema(_: &mut SchemaGenerator) -> Schema {
    json_schema!({
        "description": EXPECTED,
        "anyOf": [
            { "type": "integer", "minimum": 1, "maximum": HIGHEST_HZ },
            { "type": "string", "pattern": "^ *[0-9]*[1-9][0-9]* *(/ *[0-9]*[1-9][0-9]* *)?$" },
        ],
    })
}

pub(super) fn deserialize<'de, D: Deserializer<'de>>(input: D) -> Result<FrameRate, D::Error> {
    struct Rate;
    impl Visitor<'_> for Rate {
        type Value = FrameRate;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str(EXPECTED)
        }

        fn visit_i64<E: Error>(self, value: i64) -> Result<FrameRate, E> {
            u32::try_from(value)
                .ok()
                .and_then(|rate| FrameRate::new(rate, 1))
                .ok_or_else(|| E::invalid_value(Unexpected::Signed(value), &self))
        }

        fn visit_u64<E: Error>(self, value: u64) -> Result<FrameRate, E> {
            let rate = u32::try_from(value)
                .ok()
                .and_then(|rate| FrameRate::new(rate, 1));
            rate.ok_or_else(|| E::invalid_value(Unexpected::Unsigned(value), &self))
        }

        fn visit_str<E: Error>(self, value: &str) -> Result<FrameRate, E> {
            let (numerator, denominator) = value.split_once('/').unwrap_or((value, "1"));
            let parsed = numerator
                .trim()
                .parse()
                .ok()
                .zip(denominator.trim().parse().ok());
            parsed
                .and_then(|(numerator, denominator)| FrameRate::new(numerator, denominator))
                .ok_or_else(|| E::invalid_value(Unexpected::Str(value), &self))
        }
    }
    input.deserialize_any(Rate)
}

pub(super) fn serialize<S: Serializer>(rate: &FrameRate, output: S) -> Result<S::Ok, S::Error> {
    rate.to_string().serialize(output)
}
