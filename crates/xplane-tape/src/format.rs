//! Constants of the tape: topics, encodings, metadata.
//!
//! | topic | encoding | one message is |
//! |---|---|---|
//! | `/udp/N/to_simulator`, `/udp/N/from_simulator` | `xplane-udp` | a datagram of client N |
//! | `/link/N/to_simulator`, `/link/N/from_simulator` | `dtd-link` | a message of link connection N, with lengths, header, payload |

use std::collections::BTreeMap;

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

/// Traffic on a channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Traffic {
    /// Datagrams of a client.
    Udp,
    /// Messages on a connection of the capture link.
    Link,
}

impl Traffic {
    fn word(self) -> &'static str {
        match self {
            Self::Udp => "udp",
            Self::Link => "link",
        }
    }
}

/// A channel of the tape.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Channel {
    /// Traffic on the channel.
    pub traffic: Traffic,
    /// The client or connection, counted from 1 in the order of appearance.
    pub number: u32,
    /// Message direction.
    pub direction: Direction,
}

impl Channel {
    /// MCAP topic.
    pub fn topic(&self) -> String {
        let (traffic, direction) = (self.traffic.word(), self.direction.word());
        format!("/{traffic}/{}/{direction}", self.number)
    }

    /// MCAP message encoding.
    pub(crate) fn encoding(&self) -> &'static str {
        match self.traffic {
            Traffic::Udp => "xplane-udp",
            Traffic::Link => "dtd-link",
        }
    }

    /// The channel for a topic; `None` if it is not ours.
    pub(crate) fn of_topic(topic: &str) -> Option<Self> {
        let words: Vec<&str> = topic.split('/').collect();
        let ["", traffic, number, direction] = words[..] else {
            return None;
        };
        let traffics = [Traffic::Udp, Traffic::Link];
        let directions = [Direction::ToSimulator, Direction::FromSimulator];
        Some(Self {
            traffic: traffics.into_iter().find(|known| known.word() == traffic)?,
            number: number.parse().ok()?,
            direction: directions
                .into_iter()
                .find(|known| known.word() == direction)?,
        })
    }
}

/// Metadata of a tape, in a record before everything else: the versions of the format and of the program, the address at which the
/// simulator received UDP packets, and the start of the recording (RFC 3339 in UTC).
pub(crate) fn metadata(simulator: &str, began: &str) -> BTreeMap<String, String> {
    let pairs = [
        ("format", FORMAT),
        ("dtd", env!("CARGO_PKG_VERSION")),
        ("simulator", simulator),
        ("began", began),
    ];
    pairs
        .map(|(key, value)| (key.to_owned(), value.to_owned()))
        .into()
}

/// Rejects the metadata of another format; the error names what is missing or unexpected.
pub(crate) fn check_metadata(metadata: &BTreeMap<String, String>) -> Result<(), String> {
    let [format, dtd] = ["format", "dtd"].map(|key| {
        let value = metadata.get(key);
        value.ok_or_else(|| format!("its metadata {METADATA_NAME} has no {key:?}"))
    });
    match (format?, dtd?) {
        (format, _) if format == FORMAT => Ok(()),
        (format, dtd) => Err(format!(
            "it is of format {format}, written by dtd {dtd}; expected format {FORMAT}"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_channel_is_found_by_its_topic_and_foreign_ones_are_not() {
        use Direction::{FromSimulator, ToSimulator};
        let channels = [
            (Traffic::Udp, 12, ToSimulator),
            (Traffic::Link, 1, FromSimulator),
        ];
        for (traffic, number, direction) in channels {
            let channel = Channel {
                traffic,
                number,
                direction,
            };
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
        let mut metadata = metadata("127.0.0.1:49000", "2026-01-01T00:00:00Z");
        assert_eq!(check_metadata(&metadata), Ok(()));
        metadata.insert("format".into(), "9".into());
        let error = check_metadata(&metadata).unwrap_err();
        assert!(
            error.contains("format 9") && error.contains("expected format 1"),
            "{error}"
        );
    }
}
