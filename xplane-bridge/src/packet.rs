//! X-Plane's UDP packets, `bytes <-> packet`, in both directions.
//!
//! Input: a datagram, or a packet. Output: the packet, or the datagram. This module uses no sockets and never panics: datagrams are
//! untrusted. The layouts follow Laminar's "Exchanging data with X-Plane" (a four-character tag, one more byte that is ignored, a packed
//! little-endian body); the tolerances are the ones that real clients were seen to need: the fifth byte is anything, commands come padded
//! or unterminated, beacons vary in length.

mod aircraft_file;
mod beacon;
mod body;
mod command;
mod dataref;
mod place_at_start;
mod position;
mod subscription;

use serde::{Deserialize, Serialize};

pub use aircraft_file::LoadAircraft;
pub use beacon::{BEACON_GROUP, BEACON_PORT, Beacon};
pub use command::Command;
pub use dataref::WriteDataref;
pub use place_at_start::PlaceAtStart;
pub use position::{Position, SubscribePosition};
pub use subscription::{DatarefValue, DatarefValues, MAX_VALUES_PER_REPLY, SubscribeDataref};

/// Reason why a datagram cannot be decoded, or a packet not encoded.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PacketError {
    /// The datagram is shorter than a tag.
    #[error("a datagram of {found} bytes is too short for a tag of 4 characters")]
    NoTag {
        /// Bytes there were.
        found: usize,
    },
    /// An unknown tag for this direction.
    #[error("unknown tag {tag:?} in a packet {direction}")]
    UnknownTag {
        /// The tag, escaped.
        tag: String,
        /// `to the simulator` or `from the simulator`.
        direction: &'static str,
    },
    /// The body ends before a field does.
    #[error("{tag} packet ends inside {field}: {needed} bytes needed, {found} found")]
    TooShort {
        /// Tag of the packet.
        tag: &'static str,
        /// Name of the field.
        field: &'static str,
        /// Bytes the packet would need up to and with the field.
        needed: usize,
        /// Bytes there were.
        found: usize,
    },
    /// An invalid text.
    #[error("{tag} packet: {field} is {found}, expected {expected}")]
    BadField {
        /// Tag of the packet.
        tag: &'static str,
        /// Name of the field.
        field: &'static str,
        /// The allowed values.
        expected: &'static str,
        /// Content of the field.
        found: String,
    },
}

/// A packet on its way to the simulator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ToSimulator {
    /// `RREF`: send me this dataref at this rate.
    SubscribeDataref(SubscribeDataref),
    /// `DREF`: set a dataref.
    WriteDataref(WriteDataref),
    /// `CMND`: run a command once.
    Command(Command),
    /// `RPOS`: send me the aircraft's position at this rate.
    SubscribePosition(SubscribePosition),
    /// `PREL`: start a flight there.
    PlaceAtStart(PlaceAtStart),
    /// `ACFN`: load an aircraft.
    LoadAircraft(LoadAircraft),
}

/// A packet on its way from the simulator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FromSimulator {
    /// `RREF`: values of subscribed datarefs.
    DatarefValues(DatarefValues),
    /// `RPOS`: where the aircraft is.
    Position(Position),
    /// `BECN`: here I am.
    Beacon(Beacon),
}

impl ToSimulator {
    /// Reads a datagram that a client sent.
    pub fn decode(datagram: &[u8]) -> Result<Self, PacketError> {
        match &tag_of(datagram)? {
            b"RREF" => SubscribeDataref::decode(datagram).map(Self::SubscribeDataref),
            b"DREF" => WriteDataref::decode(datagram).map(Self::WriteDataref),
            b"CMND" => Command::decode(datagram).map(Self::Command),
            b"RPOS" => SubscribePosition::decode(datagram).map(Self::SubscribePosition),
            b"PREL" => PlaceAtStart::decode(datagram).map(Self::PlaceAtStart),
            b"ACFN" => LoadAircraft::decode(datagram).map(Self::LoadAircraft),
            tag => Err(unknown(tag, "to the simulator")),
        }
    }

    /// The datagram to send. Fails if a name does not fit its field.
    pub fn encode(&self) -> Result<Vec<u8>, PacketError> {
        match self {
            Self::SubscribeDataref(packet) => packet.encode(),
            Self::WriteDataref(packet) => packet.encode(),
            Self::Command(packet) => packet.encode(),
            Self::SubscribePosition(packet) => Ok(packet.encode()),
            Self::PlaceAtStart(packet) => packet.encode(),
            Self::LoadAircraft(packet) => packet.encode(),
        }
    }
}

impl FromSimulator {
    /// Reads a datagram that the simulator sent.
    pub fn decode(datagram: &[u8]) -> Result<Self, PacketError> {
        match &tag_of(datagram)? {
            b"RREF" => DatarefValues::decode(datagram).map(Self::DatarefValues),
            b"RPOS" => Position::decode(datagram).map(Self::Position),
            b"BECN" => Beacon::decode(datagram).map(Self::Beacon),
            tag => Err(unknown(tag, "from the simulator")),
        }
    }

    /// The datagram to send. Fails if there is more than a packet holds, or a name holds a NUL.
    pub fn encode(&self) -> Result<Vec<u8>, PacketError> {
        match self {
            Self::DatarefValues(packet) => packet.encode(),
            Self::Position(packet) => Ok(packet.encode()),
            Self::Beacon(packet) => packet.encode(),
        }
    }
}

fn tag_of(datagram: &[u8]) -> Result<[u8; 4], PacketError> {
    datagram
        .first_chunk::<4>()
        .copied()
        .ok_or(PacketError::NoTag {
            found: datagram.len(),
        })
}

fn bad_field(
    tag: &'static str,
    field: &'static str,
    expected: &'static str,
    found: impl Into<String>,
) -> PacketError {
    PacketError::BadField {
        tag,
        field,
        expected,
        found: found.into(),
    }
}

fn unknown(tag: &[u8; 4], direction: &'static str) -> PacketError {
    PacketError::UnknownTag {
        tag: tag.escape_ascii().to_string(),
        direction,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bare_tag_is_refused_unless_its_body_may_be_empty() {
        for tag in [b"RREF", b"DREF", b"CMND", b"RPOS", b"PREL", b"ACFN"] {
            assert!(ToSimulator::decode(tag).is_err(), "{}", tag.escape_ascii());
        }
        for tag in [b"RPOS", b"BECN"] {
            assert!(
                FromSimulator::decode(tag).is_err(),
                "{}",
                tag.escape_ascii()
            );
        }
        let nothing = FromSimulator::DatarefValues(DatarefValues { values: vec![] });
        assert_eq!(FromSimulator::decode(b"RREF"), Ok(nothing));
    }

    #[test]
    fn what_a_packet_cannot_be_is_refused_with_the_reason() {
        for (datagram, reason) in [
            (
                &b"XYZ\xff\0"[..],
                r#"unknown tag "XYZ\\xff" in a packet to the simulator"#,
            ),
            (b"CMND\0\0\0", "path is empty"),
            (b"RPOS\0ten\0", "a whole number"),
            (b"RPOS\0", "a whole number"),
        ] {
            let error = ToSimulator::decode(datagram).unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
        }
        let error = FromSimulator::decode(b"RREF,123456789012").unwrap_err();
        assert_eq!(
            error.to_string(),
            "RREF packet ends inside value: 21 bytes needed, 17 found"
        );
        let load = LoadAircraft {
            plane: 0,
            path: "a".repeat(150),
            livery: 0,
        };
        let write = WriteDataref {
            path: "a".repeat(500),
            value: 0.0,
        };
        for (packet, reason) in [
            (ToSimulator::LoadAircraft(load), "150 bytes"),
            (ToSimulator::WriteDataref(write), "500 bytes"),
        ] {
            let error = packet.encode().unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
        }
        let value = DatarefValue {
            index: 0,
            value: 0.0,
        };
        let values = vec![value; MAX_VALUES_PER_REPLY + 1];
        let reply = FromSimulator::DatarefValues(DatarefValues { values });
        assert!(reply.encode().is_err());
    }
}
