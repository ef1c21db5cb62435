//! Constants of the tape: topics, encodings, metadata.
//!
//! | topic | encoding | one message is |
//! |---|---|---|
//! | `/udp/N/to_simulator`, `/udp/N/from_simulator` | `xplane-udp` | a datagram of client N |
//! | `/link/N/to_simulator`, `/link/N/from_simulator` | `dtd-link` | a message of link connection N, with lengths, header, payload |

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// Profile in the header of the MCAP file.
pub const PROFILE: &str = "dtd-tape";
/// Name of the metadata record.
pub(crate) const METADATA_NAME: &str = "dtd-tape";
/// Metadata key of link channels: the version spoken by both sides.
pub(super) const LINK_VERSION_KEY: &str = "link_version";
/// Version of this format. A change that an older reader would misread raises it.
const FORMAT: &str = "1";

/// Message direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Direction {
    /// Sent by a client.
    ToSimulator,
    /// Sent to a client.
    FromSimulator,
}

impl Direction {
    fn word(self) -> &'static str {
        match self {
            Self::ToSimulator => "to_simulator",
            Self::FromSimulator => "from_simulator",
        }
    }
}

/// A channel of the tape.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Channel {
    /// A client's datagrams.
    Udp {
        /// The client, counted from 1 in the order of appearance.
        client: u32,
        /// Message direction.
        direction: Direction,
    },
    /// Messages on a capture link connection.
    Link {
        /// The connection, counted from 1.
        connection: u32,
        /// Message direction.
        direction: Direction,
    },
}

impl Channel {
    /// Message direction.
    pub fn direction(&self) -> Direction {
        match self {
            Self::Udp { direction, .. } | Self::Link { direction, .. } => *direction,
        }
    }

    /// MCAP topic.
    pub fn topic(&self) -> String {
        match self {
            Self::Udp { client, direction } => format!("/udp/{client}/{}", direction.word()),
            Self::Link {
                connection,
                direction,
            } => format!("/link/{connection}/{}", direction.word()),
        }
    }

    /// MCAP message encoding.
    pub fn encoding(&self) -> &'static str {
        match self {
            Self::Udp { .. } => "xplane-udp",
            Self::Link { .. } => "dtd-link",
        }
    }

    /// The channel for a topic; `None` if it is not ours.
    pub(crate) fn of_topic(topic: &str) -> Option<Self> {
        let mut words = topic.strip_prefix('/')?.split('/');
        let (kind, number) = (words.next()?, words.next()?.parse().ok()?);
        let direction = match words.next()? {
            "to_simulator" => Direction::ToSimulator,
            "from_simulator" => Direction::FromSimulator,
            _ => return None,
        };
        match (kind, words.next()) {
            ("udp", None) => Some(Self::Udp {
                client: number,
                direction,
            }),
            ("link", None) => Some(Self::Link {
                connection: number,
                direction,
            }),
            _ => None,
        }
    }
}

/// Tape description, in a metadata record before everything else.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct TapeInfo {
    /// Version of the format.
    pub format: String,
    /// Version of the program that recorded.
    pub dtd: String,
    /// Address at which the simulator received UDP packets.
    pub simulator: String,
    /// Start of the recording, RFC 3339 in UTC.
    pub began: String,
}

impl TapeInfo {
    /// About a recording of this version.
    pub fn new(simulator: String, began: String) -> Self {
        Self {
            format: FORMAT.into(),
            dtd: env!("CARGO_PKG_VERSION").into(),
            simulator,
            began,
        }
    }

    pub(super) fn to_metadata(&self) -> BTreeMap<String, String> {
        let pairs = [
            ("format", &self.format),
            ("dtd", &self.dtd),
            ("simulator", &self.simulator),
            ("began", &self.began),
        ];
        pairs
            .map(|(key, value)| (key.to_owned(), value.clone()))
            .into()
    }

    /// Parses the metadata; the error names what is missing or has an unexpected version.
    pub(super) fn of_metadata(metadata: &BTreeMap<String, String>) -> Result<Self, String> {
        let take = |key: &str| {
            let value = metadata.get(key).cloned();
            value.ok_or_else(|| format!("its metadata {METADATA_NAME} has no {key:?}"))
        };
        let info = Self {
            format: take("format")?,
            dtd: take("dtd")?,
            simulator: take("simulator")?,
            began: take("began")?,
        };
        if info.format == FORMAT {
            Ok(info)
        } else {
            Err(format!(
                "it is of format {}, written by dtd {}; expected format {FORMAT}",
                info.format, info.dtd
            ))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_channel_is_found_by_its_topic_and_foreign_ones_are_not() {
        use Direction::{FromSimulator, ToSimulator};
        let channels = [
            Channel::Udp {
                client: 12,
                direction: ToSimulator,
            },
            Channel::Link {
                connection: 1,
                direction: FromSimulator,
            },
        ];
        for channel in channels {
            assert_eq!(Channel::of_topic(&channel.topic()), Some(channel));
        }
        for foreign in [
            "",
            "/udp",
            "/udp/x/to_simulator",
            "/udp/1/to",
            "/udp/1/to_simulator/reference",
            "/odometry/1/to_simulator",
        ] {
            assert_eq!(Channel::of_topic(foreign), None, "{foreign}");
        }
    }

    #[test]
    fn a_tape_of_another_format_is_refused_with_both_versions() {
        let mut metadata =
            TapeInfo::new("127.0.0.1:49000".into(), "2026-01-01T00:00:00Z".into()).to_metadata();
        assert!(TapeInfo::of_metadata(&metadata).is_ok());
        metadata.insert("format".into(), "9".into());
        let error = TapeInfo::of_metadata(&metadata).unwrap_err();
        assert!(
            error.contains("format 9") && error.contains("expected format 1"),
            "{error}"
        );
    }
}
