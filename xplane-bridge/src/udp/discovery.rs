//! Finding simulators by the beacon that X-Plane sends once a second.
//!
//! Input: how long to listen. Output: which simulators announced themselves, and their addresses. The beacon is multicast: it does
//! not cross routers, and some networks drop it; then the address must be given. We join the group on the default interface and on
//! loopback, where a simulator on this computer is heard.
//!
//! A computer with several networks may be heard under several addresses, some of them unreachable. Equal beacons may also come from two
//! computers, since X-Plane 12 may send no name. So each of their addresses is asked for the simulator's running time: a simulator's
//! running time is the same at all its addresses.

use std::collections::BTreeMap;
use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::time::Duration;

use socket2::{Domain, Protocol, Socket, Type};
use tokio::net::UdpSocket;
use tokio::time::{Instant, timeout_at};

use crate::error::BridgeError;
use crate::packet::{BEACON_GROUP, BEACON_PORT, Beacon, FromSimulator};
use crate::simulator::running_since;
use crate::udp::simulator_address::is_answer;
use crate::udp::socket::LocalUdp;

/// Time to listen: three beacons; two may be lost.
pub const DISCOVERY_TIMEOUT: Duration = Duration::from_secs(3);
/// [`Beacon::host`] of X-Plane; 2 is PlaneMaker.
const HOST_X_PLANE: i32 = 1;
/// [`Beacon::role`] of flying simulators; the others only display.
const ROLE_MASTER: u32 = 1;
/// Timeout per address of a simulator that is heard under several.
const ANSWER_WITHIN: Duration = Duration::from_secs(1);
/// Addresses that are taken from beacons. Anyone on the network can send them, and each address may be asked.
const MAX_ADDRESSES: usize = 64;
/// Maximum difference of a simulator's start, computed from answers at two addresses: X-Plane hangs while it loads.
const SAME_START: Duration = Duration::from_secs(2);

/// A simulator that announced itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Announced {
    /// UDP address: the sender's address, the beacon's port.
    pub address: SocketAddr,
    /// Beacon content.
    pub beacon: Beacon,
}

/// All simulators that announce themselves within `time`, or until the one at this address does, under each of their addresses.
///
/// # Errors
/// This computer cannot listen to the beacon.
pub async fn announced(
    time: Duration,
    wanted: Option<SocketAddr>,
) -> Result<Vec<Announced>, BridgeError> {
    let socket = listen(BEACON_PORT)?;
    let until = Instant::now() + time;
    let mut found = BTreeMap::new();
    let mut buffer = [0; 2048];
    while let Ok(received) = timeout_at(until, socket.recv_from(&mut buffer)).await {
        let (length, from) = received.map_err(|error| no_multicast(&error))?;
        match FromSimulator::decode(&buffer[..length]) {
            Ok(FromSimulator::Beacon(beacon)) => {
                let address = SocketAddr::new(from.ip(), beacon.port);
                note(&mut found, address, beacon);
                if wanted.is_some_and(|wanted| is_same(wanted, address)) {
                    break;
                }
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

/// True if an announced address is the simulator's: on its port, and at its address or, as a computer has several, also of this computer.
pub(crate) fn is_same(wanted: SocketAddr, announced: SocketAddr) -> bool {
    let is_here = |address: SocketAddr| std::net::UdpSocket::bind((address.ip(), 0)).is_ok();
    wanted.port() == announced.port()
        && (is_answer(wanted, announced) || is_here(wanted) && is_here(announced))
}

/// Takes a beacon, unless as many addresses are known already.
fn note(found: &mut BTreeMap<SocketAddr, Beacon>, address: SocketAddr, beacon: Beacon) {
    if found.len() < MAX_ADDRESSES || found.contains_key(&address) {
        found.insert(address, beacon);
    }
}

/// The one simulator that announces itself within `time`, at an address where it answers.
///
/// # Errors
/// No simulator announced itself, or several did ([`BridgeError::SeveralAnnounced`]), or this computer cannot listen to the beacon.
pub async fn the_announced(time: Duration, local: &LocalUdp) -> Result<Announced, BridgeError> {
    choose(announced(time, None).await?, time, local).await
}

/// Chooses the flying simulator among all heard, at an address where it answers. If none answers, an address of this computer, or the
/// first.
pub(crate) async fn choose(
    heard: Vec<Announced>,
    waited: Duration,
    local: &LocalUdp,
) -> Result<Announced, BridgeError> {
    let flying = flying(heard);
    let [first, others @ ..] = &flying[..] else {
        return Err(BridgeError::Failed(format!(
            "no simulator announced itself within {:.1} s. The beacon is multicast, which firewalls and other networks drop: \
             give the address, --sim HOST:PORT, e.g. --sim 127.0.0.1:49000. Without X-Plane, use the bundled simulator: --sim mock",
            waited.as_secs_f64()
        )));
    };
    if others.is_empty() {
        return Ok(first.clone());
    }
    let several = |different: &[&Announced]| BridgeError::SeveralAnnounced {
        addresses: different.iter().map(|one| one.address).collect(),
    };
    if others.iter().any(|other| other.beacon != first.beacon) {
        return Err(several(&flying.iter().collect::<Vec<_>>()));
    }
    let mut answering = Vec::new();
    for one in &flying {
        if let Some(since) = running_since(one.address, ANSWER_WITHIN, local).await {
            answering.push((one, since));
        }
    }
    let different = different(&answering);
    match different[..] {
        [] => Ok(first.clone()),
        [one] => Ok(one.clone()),
        _ => Err(several(&different)),
    }
}

/// Flying simulators, addresses of this computer first.
fn flying(mut heard: Vec<Announced>) -> Vec<Announced> {
    heard.retain(|one| one.beacon.host == HOST_X_PLANE && one.beacon.role == ROLE_MASTER);
    heard.sort_by_key(|one| !one.address.ip().is_loopback());
    heard
}

/// The first address of each simulator, recognised by its start.
fn different<'a>(answering: &[(&'a Announced, Instant)]) -> Vec<&'a Announced> {
    let mut found: Vec<(&Announced, Instant)> = Vec::new();
    for &(one, since) in answering {
        let is_known = found.iter().any(|(_, known)| {
            let apart = since.saturating_duration_since(*known);
            apart.max(known.saturating_duration_since(since)) < SAME_START
        });
        if !is_known {
            found.push((one, since));
        }
    }
    found.into_iter().map(|(one, _)| one).collect()
}

/// A socket on the beacon's port, shared with other listeners.
fn listen(port: u16) -> Result<UdpSocket, BridgeError> {
    let socket = bind(port).map_err(|error| {
        BridgeError::Failed(format!(
            "cannot listen for beacons on UDP port {port} of this computer: {error}. Another program uses it alone, or the system reserves \
             it (Windows, for Hyper-V: `netsh interface ipv4 show excludedportrange protocol=udp`). Give the simulator's address: --sim \
             HOST:PORT"
        ))
    })?;
    let joined = [Ipv4Addr::UNSPECIFIED, Ipv4Addr::LOCALHOST]
        .map(|interface| socket.join_multicast_v4(&BEACON_GROUP, &interface));
    // One of the two is enough: a computer without a network has only the loopback interface.
    match joined {
        [Err(error), Err(_)] => Err(error),
        _ => UdpSocket::from_std(socket.into()),
    }
    .map_err(|error| no_multicast(&error))
}

fn no_multicast(error: &io::Error) -> BridgeError {
    BridgeError::Failed(format!(
        "cannot listen to the beacon (multicast {BEACON_GROUP}:{BEACON_PORT}): {error}. Give the address: --sim HOST:PORT"
    ))
}

fn bind(port: u16) -> io::Result<Socket> {
    let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
    socket.set_reuse_address(true)?;
    #[cfg(unix)]
    socket.set_reuse_port(true)?;
    socket.set_nonblocking(true)?;
    socket.bind(&SocketAddr::from((Ipv4Addr::UNSPECIFIED, port)).into())?;
    Ok(socket)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::packet::{DatarefValue, DatarefValues, ToSimulator};

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

    /// A simulator at this address that has run for some seconds, or does not answer.
    async fn answering(ip: &str, running_s: Option<f32>) -> SocketAddr {
        let socket = UdpSocket::bind((ip.parse::<Ipv4Addr>().unwrap(), 0))
            .await
            .unwrap();
        let address = socket.local_addr().unwrap();
        tokio::spawn(async move {
            let mut buffer = [0; 2048];
            loop {
                let (length, from) = socket.recv_from(&mut buffer).await.unwrap();
                if let Ok(ToSimulator::SubscribeDataref(request)) =
                    ToSimulator::decode(&buffer[..length])
                    && let (Some(value), false) = (running_s, request.is_end())
                {
                    let index = request.index;
                    let values = vec![DatarefValue { index, value }];
                    let reply = FromSimulator::DatarefValues(DatarefValues { values });
                    socket
                        .send_to(&reply.encode().unwrap(), from)
                        .await
                        .unwrap();
                }
            }
        });
        address
    }

    async fn chosen(heard: Vec<Announced>) -> Result<Announced, BridgeError> {
        choose(heard, DISCOVERY_TIMEOUT, &LocalUdp::default()).await
    }

    /// A beacon heard under several addresses.
    fn under(addresses: &[SocketAddr]) -> Vec<Announced> {
        let one = |address: &SocketAddr| heard(&address.to_string(), |beacon| beacon.port = 49_000);
        addresses.iter().map(one).collect()
    }

    #[test]
    fn beacons_of_sixty_four_addresses_are_taken_and_known_ones_go_on() {
        let mut found = BTreeMap::new();
        let address = |port: u16| SocketAddr::from(([10, 0, 0, 5], port));
        for port in 0..1_000 {
            note(&mut found, address(port), Beacon::default());
        }
        assert_eq!(found.len(), 64);
        let named = Beacon {
            name: Some("tower".into()),
            ..Beacon::default()
        };
        note(&mut found, address(63), named.clone());
        assert_eq!(found[&address(63)], named);
        assert!(!found.contains_key(&address(64)));
    }

    #[test]
    fn the_beacon_of_another_computer_is_not_the_one_of_a_simulator_at_the_same_port() {
        let is_same = |wanted: &str, announced: &str| {
            is_same(wanted.parse().unwrap(), announced.parse().unwrap())
        };
        // Documentation addresses (RFC 5737), which no computer has.
        for (wanted, announced, expected) in [
            ("127.0.0.1:49000", "127.0.0.1:49000", true),
            ("192.0.2.1:49000", "192.0.2.1:49000", true),
            ("127.0.0.1:49000", "127.0.0.1:49010", false),
            ("127.0.0.1:49000", "192.0.2.1:49000", false),
            ("192.0.2.1:49000", "192.0.2.2:49000", false),
            ("192.0.2.1:49000", "127.0.0.1:49000", false),
        ] {
            assert_eq!(is_same(wanted, announced), expected, "{wanted} {announced}");
        }
    }

    #[tokio::test]
    async fn the_one_that_flies_is_chosen() {
        let all = vec![
            heard("10.0.0.5:49000", |_| ()),
            heard("10.0.0.6:49000", |beacon| beacon.role = 2),
            heard("10.0.0.7:49001", |beacon| beacon.host = 2),
        ];
        let one = chosen(all).await.unwrap();
        assert_eq!(one.address.to_string(), "10.0.0.5:49000");
    }

    #[tokio::test]
    async fn one_that_is_heard_under_several_addresses_is_one_at_the_address_that_answers() {
        // Linux answers on all loopback addresses, other systems only on the first.
        if !cfg!(target_os = "linux") {
            return;
        }
        let silent = answering("127.0.0.1", None).await;
        let first = answering("127.0.0.2", Some(500.0)).await;
        let second = answering("127.0.0.3", Some(500.5)).await;
        let one = chosen(under(&[silent, first, second])).await.unwrap();
        assert_eq!(one.address, first);
        let one = chosen(under(&[silent])).await.unwrap();
        assert_eq!(one.address, silent);
    }

    #[tokio::test]
    async fn equal_beacons_of_two_simulators_are_several_by_their_running_times() {
        if !cfg!(target_os = "linux") {
            return;
        }
        let first = answering("127.0.0.2", Some(500.0)).await;
        let second = answering("127.0.0.3", Some(40.0)).await;
        let error = chosen(under(&[first, second])).await.unwrap_err();
        let BridgeError::SeveralAnnounced { addresses } = error else {
            panic!("{error}");
        };
        assert_eq!(addresses, [first, second]);
    }

    #[tokio::test]
    async fn nobody_and_several_are_errors_that_say_what_to_do() {
        let none = chosen(vec![]).await.unwrap_err().to_string();
        assert!(none.contains("--sim HOST:PORT"), "{none}");
        let two = vec![
            heard("10.0.0.5:49000", |_| ()),
            heard("10.0.0.6:49000", |beacon| {
                beacon.name = Some("radar".into());
            }),
        ];
        let two = chosen(two).await.unwrap_err().to_string();
        assert!(two.contains("10.0.0.5:49000, 10.0.0.6:49000"), "{two}");
    }

    #[tokio::test]
    async fn a_beacon_port_that_is_reserved_is_named_with_what_to_do() {
        let reserved = std::net::UdpSocket::bind("0.0.0.0:0").unwrap();
        let port = reserved.local_addr().unwrap().port();
        let said = listen(port).unwrap_err().to_string();
        for words in [&port.to_string(), "excludedportrange", "--sim HOST:PORT"] {
            assert!(said.contains(words), "{said}");
        }
    }
}
