//! `DREF`: writing a dataref. There is no answer; read it back to confirm.

use serde::{Deserialize, Serialize};

use super::PacketError;
use super::body::{Fields, push_text, start, text};

const TAG: &str = "DREF";
const PATH_BYTES: usize = 500;

/// `DREF` to the simulator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WriteDataref {
    /// Dataref; array elements as `name[3]`.
    pub path: String,
    /// The value in X-Plane's unit.
    pub value: f32,
}

impl WriteDataref {
    pub(super) fn decode(datagram: &[u8]) -> Result<Self, PacketError> {
        let mut fields = Fields::new(TAG, datagram);
        let value = fields.f32("value")?;
        Ok(Self {
            path: text(TAG, "path", fields.rest())?,
            value,
        })
    }

    pub(super) fn encode(&self) -> Result<Vec<u8>, PacketError> {
        let mut datagram = start(b"DREF", 4 + PATH_BYTES);
        datagram.extend(self.value.to_le_bytes());
        push_text(&mut datagram, TAG, "path", &self.path, PATH_BYTES)?;
        Ok(datagram)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_may_be_padded_with_spaces_alone() {
        let write = WriteDataref {
            path: "sim/a".into(),
            value: 2.0,
        };
        let mut bytes = write.encode().unwrap();
        bytes[14..].fill(b' ');
        assert_eq!(WriteDataref::decode(&bytes).unwrap(), write);
    }
}
