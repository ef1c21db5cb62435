//! The recorder: a proxy that looks like the simulator to clients.
//!
//! ```text
//! client 1 --UDP--> | recorder | --UDP, a socket per client--> simulator
//! client 2 --TCP--> |          | --TCP-----------------------> its capture link
//!                        \--> a thread that writes the tape
//! ```
//!
//! Every message is handed to the tape before it is forwarded, so the tape has a request before its answer. One thing is changed on
//! the way to clients: the value of the dataref with the port of the capture link, which becomes the recorder's own (the tape has
//! the simulator's). X-Plane's Web API is not recorded.

mod link;
mod tape_thread;
mod udp;

use std::future::Future;
use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU16, Ordering};

use chrono::{SecondsFormat, Utc};
use serde::{Deserialize, Serialize};
use tokio::net::{TcpListener, UdpSocket};

use xplane_bridge::LocalUdp;
use xplane_bridge::link::LinkToken;
use xplane_bridge::udp::simulator_address::reachable;

use super::error::TapeError;
use super::writer::{TapeSummary, TapeWriter};
use tape_thread::TapeThread;

/// The recorder's capture link listens this much above its UDP port, as the stand-in's does.
const LINK_PORT_OFFSET: u16 = 10;

/// Recording settings.
#[derive(Debug, Clone)]
pub struct RecordOptions {
    /// The simulator's UDP address.
    pub simulator: SocketAddr,
    /// Address to listen on. Only loopback is safe: anyone who reaches the recorder controls the simulator.
    pub bind: IpAddr,
    /// UDP port to listen on; 0 takes any free one. The capture link is 10 above it, or any free one.
    pub port: u16,
    /// The tape.
    pub out: PathBuf,
    /// The token that a client of the capture link must send. Required if the address is not a loopback one.
    pub token: Option<LinkToken>,
    /// The local side towards the simulator: its port is the first client's, and each further client takes the next free one.
    pub local_udp: LocalUdp,
}

impl RecordOptions {
    /// Settings for recording this simulator, on any free port of this machine.
    pub fn new(simulator: SocketAddr, out: PathBuf) -> Self {
        Self {
            simulator,
            bind: Ipv4Addr::LOCALHOST.into(),
            port: 0,
            out,
            token: None,
            local_udp: LocalUdp::default(),
        }
    }
}

/// The recorder's addresses; as JSON, the line that `dtd tape` prints.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecorderAddresses {
    /// X-Plane's UDP protocol.
    pub udp: SocketAddr,
    /// The capture link, TCP.
    pub capture_link: SocketAddr,
}

/// Records until `stop` resolves; calls `ready` once clients may connect.
///
/// # Errors
/// A port or the tape is unavailable, or the tape cannot be written: what is not on the tape is not forwarded.
pub async fn record(
    options: RecordOptions,
    ready: impl FnOnce(RecorderAddresses),
    stop: impl Future<Output = ()>,
) -> Result<TapeSummary, TapeError> {
    if options.token.is_none() && !options.bind.is_loopback() {
        return Err(TapeError::BadInput(format!(
            "the recorder would listen on {} for everybody: set DTD_LINK_TOKEN to a secret of your choice, which is not empty, here and \
             where the client runs, or listen on 127.0.0.1",
            options.bind
        )));
    }
    let address = SocketAddr::new(options.bind, options.port);
    let udp = UdpSocket::bind(address)
        .await
        .and_then(|socket| Ok((socket.local_addr()?, socket)));
    let (udp_address, udp) = udp.map_err(|error| cannot_listen(address, "UDP", &error))?;
    let link_port = match options.port {
        0 => 0,
        port => port.checked_add(LINK_PORT_OFFSET).unwrap_or(0),
    };
    let address = SocketAddr::new(options.bind, link_port);
    let link = TcpListener::bind(address)
        .await
        .and_then(|listener| Ok((listener.local_addr()?, listener)));
    let (link_address, listener) =
        link.map_err(|error| cannot_listen(address, "capture link", &error))?;
    let began = Utc::now().to_rfc3339_opts(SecondsFormat::Secs, true);
    let tape = TapeWriter::create(&options.out, &options.simulator.to_string(), &began)?;
    let (tape_thread, mut writing) = TapeThread::start(tape);
    let route = Arc::new(Route {
        simulator: reachable(options.simulator),
        local_udp: options.local_udp,
        our_link_port: link_address.port(),
        simulators_link_port: AtomicU16::new(0),
        token: options.token,
        tape_thread,
    });
    ready(RecorderAddresses {
        udp: udp_address,
        capture_link: link_address,
    });
    let ended = tokio::select! {
        () = stop => Ok(()),
        ended = udp::run(Arc::new(udp), route.clone()) => ended,
        never = link::run(listener, route.clone()) => match never {},
        // Early only if the tape cannot be written.
        summary = &mut writing => return tape_thread::ended(summary),
    };
    // Clients' tasks have ended with the futures above; their queued messages are still written.
    route.tape_thread.stop().await;
    let summary = tape_thread::ended(writing.await)?;
    ended.map(|()| summary)
}

/// Shared by the proxies.
struct Route {
    simulator: SocketAddr,
    local_udp: LocalUdp,
    our_link_port: u16,
    /// The simulator's last value; 0 before.
    simulators_link_port: AtomicU16,
    token: Option<LinkToken>,
    tape_thread: TapeThread,
}

impl Route {
    /// Address of the simulator's capture link, if it has reported it.
    fn simulators_link(&self) -> Option<SocketAddr> {
        match self.simulators_link_port.load(Ordering::Relaxed) {
            0 => None,
            port => Some(SocketAddr::new(self.simulator.ip(), port)),
        }
    }
}

fn cannot_listen(address: SocketAddr, what: &str, error: &io::Error) -> TapeError {
    TapeError::Failed(format!(
        "cannot listen on {address} ({what}): {error}. Does X-Plane run there? --port 0 takes any free port"
    ))
}
