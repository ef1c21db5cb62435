//! `BECN`: the simulator announces itself once a second by multicast.
//!
//! The name is variable in length and X-Plane 12 may send none: never assume a fixed size.

use std::net::Ipv4Addr;

use serde::{Deserialize, Serialize};

use super::PacketError;
use super::body::{Fields, start};

/// Multicast group of the beacon.
pub const BEACON_GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 1, 1);
/// UDP port of the beacon.
pub const BEACON_PORT: u16 = 49_707;

const TAG: &str = "BECN";

/// `BECN` from the simulator.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Beacon {
    /// Major version of the beacon.
    pub major: u8,
    /// Minor version of the beacon.
    pub minor: u8,
    /// Program: 1 is X-Plane.
    pub host: i32,
    /// Version of the program, 124009 for 12.4.0.
    pub version: i32,
    /// Role: 1 is the master in a network of simulators.
    pub role: u32,
    /// The port that takes our packets.
    pub port: u16,
    /// Computer name in the system's encoding; bytes that are not UTF-8 become U+FFFD.
    pub name: Option<String>,
    /// Port of the newer protocol, if the packet is long enough to contain it.
    pub raknet_port: Option<u16>,
}

impl Default for Beacon {
    /// X-Plane 12.4.0, master, on its usual port.
    fn default() -> Self {
        Self {
            major: 1,
            minor: 2,
            host: 1,
            version: 124_009,
            role: 1,
            port: 49_000,
            name: None,
            raknet_port: None,
        }
    }
}

impl Beacon {
    pub(super) fn decode(datagram: &[u8]) -> Result<Self, PacketError> {
        let mut fields = Fields::new(TAG, datagram);
        let (major, minor) = (fields.u8("major version")?, fields.u8("minor version")?);
        let (host, version) = (fields.i32("host")?, fields.i32("version")?);
        let (role, port) = (fields.u32("role")?, fields.u16("port")?);
        let (name, raknet) = match fields.rest() {
            // Two bytes are the port after an omitted name, unless they form a single-character name, since no port below 256 is free for
            // this.
            rest @ [_, 1..=u8::MAX] => (&rest[..0], rest),
            rest => {
                let end = rest
                    .iter()
                    .position(|&byte| byte == 0)
                    .unwrap_or(rest.len());
                (&rest[..end], rest.get(end + 1..).unwrap_or_default())
            }
        };
        let name = String::from_utf8_lossy(name).into_owned();
        Ok(Self {
            major,
            minor,
            host,
            version,
            role,
            port,
            name: (!name.is_empty()).then_some(name),
            raknet_port: raknet.first_chunk().copied().map(u16::from_le_bytes),
        })
    }

    pub(super) fn encode(&self) -> Result<Vec<u8>, PacketError> {
        let name = self.name.as_deref().unwrap_or_default();
        let mut datagram = start(b"BECN", 19 + name.len());
        datagram.extend([self.major, self.minor]);
        datagram.extend(self.host.to_le_bytes());
        datagram.extend(self.version.to_le_bytes());
        datagram.extend(self.role.to_le_bytes());
        datagram.extend(self.port.to_le_bytes());
        super::body::push_text(&mut datagram, TAG, "name", name, name.len() + 1)?;
        if let Some(port) = self.raknet_port {
            datagram.extend(port.to_le_bytes());
        }
        Ok(datagram)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_beacon_may_end_anywhere_behind_its_port_and_have_a_name_in_any_encoding() {
        let named = |name: &str, raknet_port| Beacon {
            name: (!name.is_empty()).then(|| name.into()),
            raknet_port,
            ..Beacon::default()
        };
        let bare = Beacon::default().encode().unwrap();
        for (rest, expected) in [
            (&b"\x72\xbf"[..], named("", Some(0xbf72))),
            // "TÜRM" in Windows' encoding.
            (b"T\xdcRM\0", named("T\u{fffd}RM", None)),
            (b"x\0", named("x", None)),
        ] {
            let bytes = [&bare[..21], rest].concat();
            assert_eq!(Beacon::decode(&bytes), Ok(expected), "{rest:?}");
        }
        assert!(Beacon::decode(&bare[..20]).is_err());
    }
}
