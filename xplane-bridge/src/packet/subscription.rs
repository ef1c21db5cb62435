//! `RREF`: subscribing to datarefs by index, and the values that come back.
//!
//! A subscription is keyed by (client address, index). Frequency 0 ends it; some clients end it with an empty path instead.

use serde::{Deserialize, Serialize};

use super::body::{Fields, push_text, start, text};
use super::{PacketError, bad_field};

/// Maximum values in one reply: more would not fit an Ethernet frame.
pub const MAX_VALUES_PER_REPLY: usize = 183;

const TAG: &str = "RREF";
const PATH_BYTES: usize = 400;
const VALUE_BYTES: usize = 8;

/// `RREF` to the simulator.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SubscribeDataref {
    /// Rate in 1/s; 0 or less ends the subscription.
    pub frequency_hz: i32,
    /// The client's own number for it, which comes back with every value.
    pub index: i32,
    /// Dataref, e.g. `sim/time/zulu_time_sec`, or `name[3]` for array elements. Empty ends the subscription.
    pub path: String,
}

impl SubscribeDataref {
    /// True if this ends a subscription.
    pub fn is_end(&self) -> bool {
        self.frequency_hz <= 0 || self.path.is_empty()
    }

    pub(super) fn decode(datagram: &[u8]) -> Result<Self, PacketError> {
        let mut fields = Fields::new(TAG, datagram);
        Ok(Self {
            frequency_hz: fields.i32("frequency")?,
            index: fields.i32("index")?,
            path: text(TAG, "path", fields.rest())?,
        })
    }

    pub(super) fn encode(&self) -> Result<Vec<u8>, PacketError> {
        let mut datagram = start(b"RREF", 8 + PATH_BYTES);
        datagram.extend(self.frequency_hz.to_le_bytes());
        datagram.extend(self.index.to_le_bytes());
        push_text(&mut datagram, TAG, "path", &self.path, PATH_BYTES)?;
        Ok(datagram)
    }
}

/// A value in a reply.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DatarefValue {
    /// The client's number for the dataref.
    pub index: i32,
    /// The value, in X-Plane's unit. 32 bits: a longitude is rounded to about a metre.
    pub value: f32,
}

/// `RREF,` from the simulator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DatarefValues {
    /// At most [`MAX_VALUES_PER_REPLY`] values.
    pub values: Vec<DatarefValue>,
}

impl DatarefValues {
    pub(super) fn decode(datagram: &[u8]) -> Result<Self, PacketError> {
        let mut fields = Fields::new(TAG, datagram);
        let mut values = Vec::new();
        while !fields.are_read() {
            values.push(DatarefValue {
                index: fields.i32("index")?,
                value: fields.f32("value")?,
            });
        }
        Ok(Self { values })
    }

    pub(super) fn encode(&self) -> Result<Vec<u8>, PacketError> {
        if self.values.len() > MAX_VALUES_PER_REPLY {
            let found = format!("{} values", self.values.len());
            let expected = "at most 183 values in a reply";
            return Err(bad_field(TAG, "values", expected, found));
        }
        let mut datagram = start(b"RREF", VALUE_BYTES * self.values.len());
        // The one fifth byte that matters: clients were seen to demand exactly `RREF,`.
        datagram[4] = b',';
        for DatarefValue { index, value } in &self.values {
            datagram.extend(index.to_le_bytes());
            datagram.extend(value.to_le_bytes());
        }
        Ok(datagram)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_path_or_frequency_zero_ends_a_subscription() {
        let mut bytes = b"RREF\0".to_vec();
        bytes.extend(5_i32.to_le_bytes());
        bytes.extend(9_i32.to_le_bytes());
        assert!(SubscribeDataref::decode(&bytes).unwrap().is_end());
        let zero = SubscribeDataref {
            frequency_hz: 0,
            index: 9,
            path: "a".into(),
        };
        assert!(zero.is_end());
        assert!(
            !SubscribeDataref {
                frequency_hz: 1,
                ..zero
            }
            .is_end()
        );
    }
}
