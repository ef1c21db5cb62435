//! `DATA`: rows of X-Plane's data output, in both directions.
//!
//! A row is a number of the output table and eight values, whose meaning the table defines. X-Plane sends the tag as `DATA*`; clients send
//! it with any fifth byte.

use serde::{Deserialize, Serialize};

use super::PacketError;
use super::body::{Fields, HEADER_BYTES, start};

/// A value that the simulator leaves as it is.
pub const LEAVE_ALONE: f32 = -999.0;
/// Rows that fit a datagram, whose length has 16 bits.
pub(crate) const MAX_DATA_ROWS: usize = 1_819;

const TAG: &str = "DATA";
const VALUES: usize = 8;
const ROW_BYTES: usize = 4 + 4 * VALUES;

/// One row of the table.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DataRow {
    /// Number in the table, e.g. 20 for latitude, longitude and altitude.
    pub index: i32,
    /// The row's values; towards the simulator, [`LEAVE_ALONE`] keeps one as it is.
    pub values: [f32; VALUES],
}

/// `DATA`, in either direction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DataRows {
    /// At most [`MAX_DATA_ROWS`] of them.
    pub rows: Vec<DataRow>,
}

impl DataRows {
    pub(super) fn decode(datagram: &[u8]) -> Result<Self, PacketError> {
        let mut fields = Fields::new(TAG, datagram);
        let count = datagram
            .len()
            .saturating_sub(HEADER_BYTES)
            .div_ceil(ROW_BYTES);
        let mut rows = Vec::with_capacity(count);
        for _ in 0..count {
            let index = fields.i32("index of a row")?;
            let mut values = [0.0; VALUES];
            for value in &mut values {
                *value = fields.f32("value of a row")?;
            }
            rows.push(DataRow { index, values });
        }
        Ok(Self { rows })
    }

    /// The datagram that a client sends.
    pub(super) fn encode_to_simulator(&self) -> Result<Vec<u8>, PacketError> {
        self.encode(0)
    }

    /// The datagram that X-Plane 11 and 12 send.
    pub(super) fn encode_from_simulator(&self) -> Result<Vec<u8>, PacketError> {
        self.encode(b'*')
    }

    fn encode(&self, fifth_byte: u8) -> Result<Vec<u8>, PacketError> {
        if self.rows.len() > MAX_DATA_ROWS {
            return Err(PacketError::BadField {
                tag: TAG,
                field: "rows",
                expected: "at most 1819 rows in a datagram",
                found: format!("{} rows", self.rows.len()),
            });
        }
        let mut datagram = start(b"DATA", ROW_BYTES * self.rows.len());
        datagram[4] = fifth_byte;
        for DataRow { index, values } in &self.rows {
            datagram.extend(index.to_le_bytes());
            datagram.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        }
        Ok(datagram)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_takes_36_bytes_and_the_tag_says_who_sent_it() {
        let rows = DataRows {
            rows: vec![
                DataRow {
                    index: 20,
                    values: [LEAVE_ALONE; VALUES]
                };
                2
            ],
        };
        let [to, from] =
            [rows.encode_to_simulator(), rows.encode_from_simulator()].map(Result::unwrap);
        assert_eq!((to.len(), &to[..5]), (5 + 2 * 36, &b"DATA\0"[..]));
        assert_eq!(&from[..5], b"DATA*");
        assert_eq!(DataRows::decode(&to), Ok(rows.clone()));
        assert_eq!(DataRows::decode(&from), Ok(rows));
    }

    #[test]
    fn half_a_row_and_rows_beyond_a_datagram_are_refused() {
        let error = DataRows::decode(&[b"DATA*".as_slice(), &[0; 40]].concat()).unwrap_err();
        assert!(error.to_string().contains("ends inside"), "{error}");
        let row = DataRow {
            index: 0,
            values: [0.0; VALUES],
        };
        let longest = DataRows {
            rows: vec![row; MAX_DATA_ROWS],
        };
        // The most that UDP over IPv4 carries.
        assert!(longest.encode_to_simulator().unwrap().len() <= 65_507);
        let longer = DataRows {
            rows: vec![row; MAX_DATA_ROWS + 1],
        };
        assert!(longer.encode_to_simulator().is_err());
    }
}
