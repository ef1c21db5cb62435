//! The stand-in as a process: X-Plane's UDP protocol, its beacon, and the capture link of our plugin.
//!
//! In: an address to listen on. Out: nothing, until it is stopped. A client finds here what it would find at X-Plane 12 with
//! our plugin, up to the quirks that have bitten clients: 32-bit values, lost requests, silent refusals.

mod beacon;
mod capture_link;
mod engine;
mod scenes;
mod subscriptions;
mod udp;
mod world;

use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serde::{Deserialize, Serialize};
use tokio::net::{TcpListener, UdpSocket};
use tokio::task::JoinSet;
use xplane_bridge::packet::{BEACON_GROUP, BEACON_PORT};

pub use engine::{BuiltIn, Engine, Picture};

/// The version that the stand-in says it is: 12.4.0.
pub const VERSION: i32 = 120_400;
/// The port that X-Plane takes UDP packets on.
pub const DEFAULT_PORT: u16 = 49_000;
/// The capture link listens so much above the UDP port.
const CAPTURE_PORT_OFFSET: u16 = 10;

/// Where to listen.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServerOptions {
    /// Address of the network interface. Only the loopback one is safe: whoever reaches the stand-in commands it.
    pub bind: IpAddr,
    /// UDP port; 0 takes any free one. The capture link listens 10 above it, or on any free one.
    pub port: u16,
    /// Whether to announce the stand-in by multicast, as X-Plane does.
    pub beacon: bool,
}

impl Default for ServerOptions {
    /// X-Plane's port on the loopback interface, with beacon.
    fn default() -> Self {
        Self {
            bind: Ipv4Addr::LOCALHOST.into(),
            port: DEFAULT_PORT,
            beacon: true,
        }
    }
}

/// Where the stand-in listens; as JSON, the line that `dtd mock-xplane` prints.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Addresses {
    /// X-Plane's UDP protocol.
    pub udp: SocketAddr,
    /// The capture link, TCP.
    pub capture_link: SocketAddr,
    /// Multicast group and port of the beacon.
    pub beacon: SocketAddr,
}

/// Why the stand-in cannot run.
#[derive(Debug, thiserror::Error)]
pub enum MockError {
    /// An address cannot be had.
    #[error(
        "cannot listen on {address} ({what}): {source}. Does X-Plane or another stand-in run there? --port 0 takes any free port"
    )]
    Bind {
        /// Which.
        address: SocketAddr,
        /// For what.
        what: &'static str,
        /// Why not.
        source: io::Error,
    },
    /// A socket failed while running.
    #[error("{what} failed: {source}")]
    Socket {
        /// Which.
        what: &'static str,
        /// How.
        source: io::Error,
    },
    /// A part of the server ended by itself, which is a mistake in it.
    #[error("a part of the stand-in stopped: {0}")]
    Stopped(String),
}

/// Runs the stand-in with its built-in flight model and renderer until the future is dropped; calls `ready` once it listens.
///
/// # Errors
/// [`MockError::Bind`] if a port is taken, [`MockError::Socket`] if one fails later.
pub async fn serve(options: ServerOptions, ready: impl FnOnce(Addresses)) -> Result<(), MockError> {
    serve_with(options, Arc::new(BuiltIn), ready).await
}

/// [`serve`] with another flight model and renderer.
///
/// # Errors
/// As [`serve`].
pub async fn serve_with(
    options: ServerOptions,
    engine: Arc<dyn Engine>,
    ready: impl FnOnce(Addresses),
) -> Result<(), MockError> {
    let udp_address = SocketAddr::new(options.bind, options.port);
    let udp = UdpSocket::bind(udp_address)
        .await
        .and_then(|socket| Ok((socket.local_addr()?, socket)));
    let (udp_address, udp) = udp.map_err(|source| MockError::Bind {
        address: udp_address,
        what: "UDP",
        source,
    })?;
    let link_port = match options.port {
        0 => 0,
        port => port.checked_add(CAPTURE_PORT_OFFSET).unwrap_or(0),
    };
    let link_address = SocketAddr::new(options.bind, link_port);
    let listener = TcpListener::bind(link_address)
        .await
        .and_then(|listener| Ok((listener.local_addr()?, listener)));
    let (link_address, listener) = listener.map_err(|source| MockError::Bind {
        address: link_address,
        what: "capture link",
        source,
    })?;

    let world = Shared::default();
    world.lock().publish_capture_port(link_address.port());
    let addresses = Addresses {
        udp: udp_address,
        capture_link: link_address,
        beacon: (BEACON_GROUP, BEACON_PORT).into(),
    };
    // Dropping the set, with this future, ends its tasks.
    let mut tasks = JoinSet::new();
    tasks.spawn(udp::run(udp, world.clone()));
    tasks.spawn(capture_link::run(listener, world, engine));
    if options.beacon {
        tasks.spawn(beacon::run(options.bind, udp_address.port()));
    }
    ready(addresses);
    match tasks.join_next().await {
        Some(Ok(ended)) => ended,
        Some(Err(panicked)) => Err(MockError::Stopped(panicked.to_string())),
        None => Ok(()),
    }
}

/// The simulated world, shared by the UDP server and the capture link.
#[derive(Debug, Clone, Default)]
struct Shared(Arc<Mutex<world::World>>);

impl Shared {
    /// The world. A panic elsewhere does not make it unusable: every change of it is one assignment.
    fn lock(&self) -> MutexGuard<'_, world::World> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_one_line_of_json() {
        let addresses = Addresses {
            udp: ([127, 0, 0, 1], 49_000).into(),
            capture_link: ([127, 0, 0, 1], 49_010).into(),
            beacon: (BEACON_GROUP, BEACON_PORT).into(),
        };
        assert_eq!(
            serde_json::to_string(&addresses).unwrap(),
            r#"{"udp":"127.0.0.1:49000","capture_link":"127.0.0.1:49010","beacon":"239.255.1.1:49707"}"#
        );
    }

    #[tokio::test]
    async fn a_taken_port_is_named() {
        let taken = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        let port = taken.local_addr().unwrap().port();
        let options = ServerOptions {
            port,
            ..ServerOptions::default()
        };
        let error = serve(options, |_| panic!("ready on a taken port"))
            .await
            .unwrap_err();
        assert!(error.to_string().contains(&port.to_string()), "{error}");
        assert!(error.to_string().contains("--port 0"), "{error}");
    }
}
