//! Finding simulators by the beacon that X-Plane sends once a second.
//!
//! Input: how long to listen. Output: which simulators announced themselves, and their addresses. The beacon is multicast: it does
//! not cross routers, and some networks drop it; then the address must be given. We join the group on the default interface and on
//! loopback, where a simulator on this computer is heard.

use std::collections::BTreeMap;
use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::time::Duration;

use socket2::{Domain, Protocol, Socket, Type};
use tokio::net::UdpSocket;
use tokio::time::{Instant, timeout_at};

use crate::error::BridgeError;
use crate::packet::{BEACON_GROUP, BEACON_PORT, Beacon, FromSimulator};

/// How long to listen: three beacons, of which two may be lost.
pub const DISCOVERY_TIMEOUT: Duration = Duration::from_secs(3);
/// [`Beacon::host`] of X-Plane; 2 is PlaneMaker.
const HOST_X_PLANE: i32 = 1;
/// [`Beacon::role`] of a simulator that flies; the others only display.
const ROLE_MASTER: u32 = 1;

/// A simulator that announced itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Announced {
    /// Its UDP address: the sender's address, the beacon's port.
    pub address: SocketAddr,
    /// The content of its beacon.
    pub beacon: Beacon,
}

/// All simulators that announce themselves within `time`.
///
/// # Errors
/// [`BridgeError::NoMulticast`] if this computer cannot listen to the beacon.
pub async fn announced(time: Duration) -> Result<Vec<Announced>, BridgeError> {
    let socket = listen().map_err(|source| BridgeError::NoMulticast { source })?;
    let until = Instant::now() + time;
    let mut found = BTreeMap::new();
    let mut buffer = [0; 2048];
    while let Ok(received) = timeout_at(until, socket.recv_from(&mut buffer)).await {
        let (length, from) = received.map_err(|source| BridgeError::NoMulticast { source })?;
        match FromSimulator::decode(&buffer[..length]) {
            Ok(FromSimulator::Beacon(beacon)) => {
                found.insert(SocketAddr::new(from.ip(), beacon.port), beacon);
            }
            Ok(_) => {}
            Err(error) => tracing::debug!(%from, %error, "no beacon"),
        }
    }
    Ok(found
        .into_iter()
        .map(|(address, beacon)| Announced { address, beacon })
        .collect())
}

/// The one simulator that announces itself within `time`.
///
/// # Errors
/// [`BridgeError::NobodyAnnounced`] or [`BridgeError::SeveralAnnounced`], which say what to do;
/// [`BridgeError::NoMulticast`] if this computer cannot listen to the beacon.
pub async fn the_announced(time: Duration) -> Result<Announced, BridgeError> {
    choose(announced(time).await?, time)
}

/// Of all that were heard, the one that flies. A simulator on this computer may be heard under two of its addresses, each
/// with the same port and name; the loopback one is preferred.
pub(crate) fn choose(
    mut heard: Vec<Announced>,
    waited: Duration,
) -> Result<Announced, BridgeError> {
    heard.retain(|one| one.beacon.host == HOST_X_PLANE && one.beacon.role == ROLE_MASTER);
    heard.sort_by_key(|one| !one.address.ip().is_loopback());
    let mut different: Vec<Announced> = Vec::new();
    for one in heard {
        let twin = different
            .iter()
            .any(|other| other.beacon == one.beacon && other.address.ip().is_loopback());
        if !twin {
            different.push(one);
        }
    }
    match <[Announced; 1]>::try_from(different) {
        Ok([one]) => Ok(one),
        Err(none) if none.is_empty() => Err(BridgeError::NobodyAnnounced { waited }),
        Err(several) => Err(BridgeError::SeveralAnnounced {
            addresses: several.iter().map(|one| one.address).collect(),
        }),
    }
}

/// A socket on the beacon's port, shared with other listeners.
fn listen() -> io::Result<UdpSocket> {
    let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
    socket.set_reuse_address(true)?;
    #[cfg(unix)]
    socket.set_reuse_port(true)?;
    socket.set_nonblocking(true)?;
    socket.bind(&SocketAddr::from((Ipv4Addr::UNSPECIFIED, BEACON_PORT)).into())?;
    let joined = [Ipv4Addr::UNSPECIFIED, Ipv4Addr::LOCALHOST]
        .map(|interface| socket.join_multicast_v4(&BEACON_GROUP, &interface));
    // One of the two is enough: a computer without a network has only the loopback interface.
    match joined {
        [Err(error), Err(_)] => Err(error),
        _ => UdpSocket::from_std(socket.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heard(address: &str, change: impl FnOnce(&mut Beacon)) -> Announced {
        let address: SocketAddr = address.parse().unwrap();
        let mut beacon = Beacon {
            port: address.port(),
            name: Some("tower".into()),
            ..Beacon::default()
        };
        change(&mut beacon);
        Announced { address, beacon }
    }

    #[test]
    fn the_one_that_flies_is_chosen_and_its_other_address_is_no_second_simulator() {
        let all = vec![
            heard("10.0.0.5:49000", |_| ()),
            heard("127.0.0.1:49000", |_| ()),
            heard("10.0.0.6:49000", |beacon| beacon.role = 2),
            heard("10.0.0.7:49001", |beacon| beacon.host = 2),
        ];
        let chosen = choose(all, DISCOVERY_TIMEOUT).unwrap();
        assert_eq!(chosen.address.to_string(), "127.0.0.1:49000");
    }

    #[test]
    fn nobody_and_several_are_errors_that_say_what_to_do() {
        let none = choose(vec![], DISCOVERY_TIMEOUT).unwrap_err().to_string();
        assert!(none.contains("--sim HOST:PORT"), "{none}");
        let two = vec![
            heard("10.0.0.5:49000", |_| ()),
            heard("10.0.0.6:49000", |beacon| {
                beacon.name = Some("radar".into());
            }),
        ];
        let two = choose(two, DISCOVERY_TIMEOUT).unwrap_err().to_string();
        assert!(two.contains("10.0.0.5:49000, 10.0.0.6:49000"), "{two}");
    }
}
