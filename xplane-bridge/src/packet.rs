//! X-Plane's UDP packets, `bytes <-> packet`, in both directions.
//!
//! In: a datagram, or a packet to say. Out: the packet, or the datagram. Nothing here knows a socket and nothing here
//! panics: a datagram comes from anybody. The layouts are those of Laminar's "Exchanging data with X-Plane" (a
//! four-character tag, one more byte that is ignored, a packed little-endian body); the tolerances are those that real
//! clients were seen to need: the fifth byte is anything, commands come padded or unterminated, beacons vary in length.

mod beacon;
mod body;
mod command;
mod dataref;
mod place;
mod position;
mod subscription;

use serde::{Deserialize, Serialize};

pub use beacon::{BEACON_GROUP, BEACON_PORT, Beacon};
pub use command::Command;
pub use dataref::WriteDataref;
pub use place::{PlaceAircraft, PlaceAtStart};
pub use position::{Position, SubscribePosition};
pub use subscription::{DatarefValue, DatarefValues, MAX_VALUES_PER_REPLY, SubscribeDataref};

/// Why a datagram is no packet, or a packet no datagram.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PacketError {
    /// Fewer bytes than a tag.
    #[error("a datagram of {found} bytes is too short for a tag of 4 characters")]
    NoTag {
        /// Bytes there were.
        found: usize,
    },
    /// A tag that this direction does not know.
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
        /// Which packet.
        tag: &'static str,
        /// Which field.
        field: &'static str,
        /// Bytes the packet would need up to and with the field.
        needed: usize,
        /// Bytes there were.
        found: usize,
    },
    /// A text that is not one.
    #[error("{tag} packet: {field} is {found}, expected {expected}")]
    BadField {
        /// Which packet.
        tag: &'static str,
        /// Which field.
        field: &'static str,
        /// What may stand there.
        expected: &'static str,
        /// What stood there.
        found: String,
    },
}

/// A packet on its way to the simulator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ToSimulator {
    /// `RREF`: send me this dataref so often.
    SubscribeDataref(SubscribeDataref),
    /// `DREF`: set a dataref.
    WriteDataref(WriteDataref),
    /// `CMND`: do a command once.
    Command(Command),
    /// `RPOS`: send me the aircraft's position so often.
    SubscribePosition(SubscribePosition),
    /// `VEHX` or `VEHS`: put the aircraft there.
    PlaceAircraft(PlaceAircraft),
    /// `PREL`: begin a flight there.
    PlaceAtStart(PlaceAtStart),
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
            b"VEHX" | b"VEHS" => PlaceAircraft::decode(datagram).map(Self::PlaceAircraft),
            b"PREL" => PlaceAtStart::decode(datagram).map(Self::PlaceAtStart),
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
            Self::PlaceAircraft(packet) => Ok(packet.encode()),
            Self::PlaceAtStart(packet) => packet.encode(),
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

    /// The datagram to send. Fails if there are more values than a packet holds, or a name holds a NUL.
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

fn unknown(tag: &[u8; 4], direction: &'static str) -> PacketError {
    PacketError::UnknownTag {
        tag: tag.escape_ascii().to_string(),
        direction,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one_of_each() -> (Vec<ToSimulator>, Vec<FromSimulator>) {
        let to = vec![
            ToSimulator::SubscribeDataref(SubscribeDataref {
                frequency_hz: 20,
                index: 7,
                path: "sim/time/zulu_time_sec".into(),
            }),
            ToSimulator::WriteDataref(WriteDataref {
                path: "sim/weather/region/cloud_base_msl_m[2]".into(),
                value: 1_234.5,
            }),
            ToSimulator::Command(Command {
                path: "sim/operation/regen_weather".into(),
            }),
            ToSimulator::SubscribePosition(SubscribePosition { frequency_hz: 30 }),
            ToSimulator::PlaceAircraft(PlaceAircraft {
                freeze: false,
                plane: 0,
                latitude_deg: 1.35,
                longitude_deg: 103.98,
                elevation_msl_m: 762.0,
                heading_true_deg: 23.0,
                pitch_deg: 2.5,
                roll_deg: -1.0,
            }),
            ToSimulator::PlaceAtStart(PlaceAtStart {
                start_type: 6,
                plane: 0,
                airport: "WSSS".into(),
                runway: 0,
                runway_end: 0,
                latitude_deg: 1.35,
                longitude_deg: 103.98,
                elevation_msl_m: 762.0,
                heading_true_deg: 23.0,
                speed_mps: 80.0,
            }),
        ];
        let from = vec![
            FromSimulator::DatarefValues(DatarefValues {
                values: vec![
                    DatarefValue {
                        index: 1,
                        value: 0.5,
                    },
                    DatarefValue {
                        index: -2,
                        value: 1e9,
                    },
                ],
            }),
            FromSimulator::Position(Position {
                longitude_deg: 103.98,
                latitude_deg: 1.35,
                elevation_msl_m: 762.0,
                height_agl_m: 755.0,
                pitch_deg: 2.5,
                heading_true_deg: 23.0,
                roll_deg: -1.0,
                velocity_east_mps: 30.0,
                velocity_up_mps: -4.0,
                velocity_south_mps: -70.0,
                roll_rate_rad_s: 0.01,
                pitch_rate_rad_s: 0.02,
                yaw_rate_rad_s: 0.03,
            }),
            FromSimulator::Beacon(Beacon {
                version: 120_400,
                port: 49_000,
                name: Some("host".into()),
                raknet_port: Some(49_010),
                ..Beacon::default()
            }),
        ];
        (to, from)
    }

    #[test]
    fn what_is_encoded_decodes_to_the_same() {
        let (to, from) = one_of_each();
        for packet in to {
            assert_eq!(
                ToSimulator::decode(&packet.encode().unwrap()),
                Ok(packet.clone())
            );
        }
        for packet in from {
            assert_eq!(
                FromSimulator::decode(&packet.encode().unwrap()),
                Ok(packet.clone())
            );
        }
    }

    #[test]
    fn the_fifth_byte_may_be_anything() {
        let (to, _) = one_of_each();
        for packet in to {
            let mut bytes = packet.encode().unwrap();
            for fifth in [0, b'0', b',', 0xff] {
                bytes[4] = fifth;
                assert_eq!(ToSimulator::decode(&bytes), Ok(packet.clone()));
            }
        }
    }

    #[test]
    fn no_truncation_of_any_packet_panics_and_every_tag_alone_is_refused() {
        let (to, from) = one_of_each();
        for packet in to {
            let bytes = packet.encode().unwrap();
            for length in 0..bytes.len() {
                let _ = ToSimulator::decode(&bytes[..length]);
            }
            assert!(ToSimulator::decode(&bytes[..4]).is_err(), "{packet:?}");
        }
        for packet in from {
            let bytes = packet.encode().unwrap();
            for length in 0..bytes.len() {
                let _ = FromSimulator::decode(&bytes[..length]);
            }
            assert!(FromSimulator::decode(&bytes[..9]).is_err(), "{packet:?}");
        }
    }

    #[test]
    fn no_garbage_behind_any_tag_panics() {
        // A linear congruential generator (Knuth's MMIX) is random enough to shake a parser and needs no crate.
        let mut state = 1_u64;
        let mut next = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as usize
        };
        let tags = [
            b"RREF", b"DREF", b"CMND", b"RPOS", b"VEHX", b"VEHS", b"PREL", b"BECN", b"DATA",
        ];
        let mut accepted = 0;
        for _ in 0..20_000 {
            let mut bytes = tags[next() % tags.len()].to_vec();
            let length = next() % 600;
            bytes.extend((0..length).map(|_| next() as u8));
            accepted += usize::from(ToSimulator::decode(&bytes).is_ok());
            let _ = FromSimulator::decode(&bytes);
        }
        assert!(accepted < 20_000);
    }

    #[test]
    fn an_unknown_tag_is_named() {
        let error = ToSimulator::decode(b"XYZ\xff\0").unwrap_err();
        assert_eq!(
            error.to_string(),
            r#"unknown tag "XYZ\\xff" in a packet to the simulator"#
        );
    }
}
