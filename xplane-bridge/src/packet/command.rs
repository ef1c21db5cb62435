//! `CMND`: a command, as if its key had been pressed once. There is no answer.

use serde::{Deserialize, Serialize};

use super::body::{Fields, push_text, start, text};
use super::{PacketError, bad_field};

const TAG: &str = "CMND";

/// `CMND` to the simulator.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Command {
    /// Name, e.g. `sim/operation/pause_on`.
    pub path: String,
}

impl Command {
    pub(super) fn decode(datagram: &[u8]) -> Result<Self, PacketError> {
        let path = text(TAG, "path", Fields::new(TAG, datagram).rest())?;
        if path.is_empty() {
            return Err(bad_field(TAG, "path", "the name of a command", "empty"));
        }
        Ok(Self { path })
    }

    pub(super) fn encode(&self) -> Result<Vec<u8>, PacketError> {
        let width = self.path.len() + 1;
        let mut datagram = start(b"CMND", width);
        push_text(&mut datagram, TAG, "path", &self.path, width)?;
        Ok(datagram)
    }
}
