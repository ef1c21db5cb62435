//! `ACFN`: loads an aircraft.

use serde::{Deserialize, Serialize};

use super::PacketError;
use super::body::{Fields, push_text, start, text};

const TAG: &str = "ACFN";
const PATH_BYTES: usize = 150;
/// X-Plane's own struct has them behind a path of 150 characters, to bring the next number to a multiple of four.
const PADDING: [u8; 2] = [0; 2];

/// `ACFN` to the simulator. May not work on X-Plane 12.1 and newer: there the Web API starts a flight with its aircraft.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LoadAircraft {
    /// Index of the aircraft; 0 is the user's.
    pub plane: i32,
    /// Path of the `.acf` file below X-Plane's folder.
    pub path: String,
    /// Livery index, from 0.
    pub livery: i32,
}

impl LoadAircraft {
    pub(super) fn decode(datagram: &[u8]) -> Result<Self, PacketError> {
        let mut fields = Fields::new(TAG, datagram);
        let plane = fields.i32("plane")?;
        let path = text(TAG, "path", &fields.array::<PATH_BYTES>("path")?)?;
        fields.array::<{ PADDING.len() }>("padding")?;
        let livery = fields.i32("livery")?;
        Ok(Self {
            plane,
            path,
            livery,
        })
    }

    pub(super) fn encode(&self) -> Result<Vec<u8>, PacketError> {
        let mut datagram = start(b"ACFN", 160);
        datagram.extend(self.plane.to_le_bytes());
        push_text(&mut datagram, TAG, "path", &self.path, PATH_BYTES)?;
        datagram.extend(PADDING);
        datagram.extend(self.livery.to_le_bytes());
        Ok(datagram)
    }
}
