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

/// `RREF,` from the simulator, as a view into its datagram: values are read in place, without allocation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DatarefValuesView<'a> {
    values: &'a [[u8; VALUE_BYTES]],
}

impl<'a> DatarefValuesView<'a> {
    /// Parses a datagram.
    ///
    /// # Errors
    /// It is not an `RREF` or ends inside a value.
    pub fn new(datagram: &'a [u8]) -> Result<Self, PacketError> {
        match &super::tag_of(datagram)? {
            b"RREF" => Self::of_body(datagram),
            tag => Err(super::unknown(tag, "that should carry values")),
        }
    }

    fn of_body(datagram: &'a [u8]) -> Result<Self, PacketError> {
        let mut fields = Fields::new(TAG, datagram);
        match fields.rest().as_chunks() {
            (values, []) => Ok(Self { values }),
            (_, rest) => Err(PacketError::TooShort {
                tag: TAG,
                field: if rest.len() < 4 { "index" } else { "value" },
                needed: datagram.len() - rest.len() + if rest.len() < 4 { 4 } else { VALUE_BYTES },
                found: datagram.len(),
            }),
        }
    }

    /// Number of values.
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// True if there are no values.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// The values, in the order of the datagram.
    pub fn iter(self) -> impl ExactSizeIterator<Item = DatarefValue> + 'a {
        self.values
            .iter()
            .map(|&[a, b, c, d, e, f, g, h]| DatarefValue {
                index: i32::from_le_bytes([a, b, c, d]),
                value: f32::from_le_bytes([e, f, g, h]),
            })
    }
}

impl DatarefValues {
    pub(super) fn decode(datagram: &[u8]) -> Result<Self, PacketError> {
        let values = DatarefValuesView::of_body(datagram)?.iter().collect();
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
    fn a_view_refuses_other_packets() {
        assert!(DatarefValuesView::new(b"RPOS,").is_err());
        assert!(DatarefValuesView::new(b"RRE").is_err());
    }

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
