//! Frame rates in human notation: `30`, `"30"`, `"1/2"`, `"30000/1001"`.

use std::fmt;

use schemars::{Schema, SchemaGenerator, json_schema};
use serde::de::{Error, Unexpected, Visitor};
use serde::{Deserializer, Serialize, Serializer};

use super::FrameRate;
use crate::numbers::limits::FRAME_RATE_HZ;

const EXPECTED: &str = "frames per second above zero, as a whole number (30) or a fraction in quotes (\"30000/1001\", \"1/2\")";

/// No simulator draws faster.
const MAX_HZ: u32 = FRAME_RATE_HZ.most as u32;

/// The JSON Schema of the notation.
pub fn schema(_: &mut SchemaGenerator) -> Schema {
    json_schema!({
        "description": EXPECTED,
        "anyOf": [
            { "type": "integer", "minimum": 1, "maximum": MAX_HZ },
            { "type": "string", "pattern": "^ *[0-9]*[1-9][0-9]* *(/ *[0-9]*[1-9][0-9]* *)?$" },
        ],
    })
}

/// Reads a rate in this notation.
///
/// # Errors
/// It is none that cameras and videos support.
pub fn deserialize<'de, D: Deserializer<'de>>(input: D) -> Result<FrameRate, D::Error> {
    struct Rate;
    impl Visitor<'_> for Rate {
        type Value = FrameRate;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str(EXPECTED)
        }

        fn visit_i64<E: Error>(self, value: i64) -> Result<FrameRate, E> {
            let rate = u32::try_from(value)
                .map_err(|_| E::invalid_value(Unexpected::Signed(value), &self))?;
            FrameRate::new(rate, 1).map_err(E::custom)
        }

        fn visit_u64<E: Error>(self, value: u64) -> Result<FrameRate, E> {
            let rate = u32::try_from(value)
                .map_err(|_| E::invalid_value(Unexpected::Unsigned(value), &self))?;
            FrameRate::new(rate, 1).map_err(E::custom)
        }

        fn visit_str<E: Error>(self, value: &str) -> Result<FrameRate, E> {
            let (numerator, denominator) = value.split_once('/').unwrap_or((value, "1"));
            let term = |text: &str| {
                let parsed: Result<u32, _> = text.trim().parse();
                parsed.map_err(|_| E::invalid_value(Unexpected::Str(value), &self))
            };
            FrameRate::new(term(numerator)?, term(denominator)?).map_err(E::custom)
        }
    }
    input.deserialize_any(Rate)
}

/// Writes a rate in this notation.
///
/// # Errors
/// Errors of the output.
pub fn serialize<S: Serializer>(rate: &FrameRate, output: S) -> Result<S::Ok, S::Error> {
    rate.to_string().serialize(output)
}
