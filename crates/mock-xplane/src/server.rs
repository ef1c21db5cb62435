//! The stand-in's server: X-Plane's UDP protocol, its beacon, its Web API, and the capture link of our plugin.
//!
//! Input: an address to listen on. Output: none, until it is stopped. To a client it looks like X-Plane 12 with our plugin, including the
//! quirks that caused trouble for clients: 32-bit values, lost requests, silent refusals. [`Faults`] configures further failures.
//!
//! The sockets live as long as the server; everything else belongs to a session, which a restart replaces.

mod beacon;
mod capture_link;
mod engine;
mod faults;
mod plugin_host;
mod scenes;
mod seat;
mod subscriptions;
mod tape;
mod udp;
mod web_api;
mod world;

use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use doorway::Doorway;
use futures_util::future::BoxFuture;
use serde::{Deserialize, Serialize};
use tokio::net::{TcpListener, UdpSocket};
use tokio::task::JoinSet;
use tokio::time::sleep;
use xplane_bridge::WEATHER_SETTLE;
use xplane_bridge::datarefs::{self as names, Generation};
use xplane_bridge::link::LinkToken;
use xplane_bridge::packet::{BEACON_GROUP, BEACON_PORT, Beacon};
use xplane_tape::TapeError;

pub use engine::{BuiltIn, Engine, Instants, NotFlown, OtherAircraft, SceneRenderer, SceneSetting};
pub use faults::{
    AimChange, CameraFault, CameraFaultKind, CodeFaults, Faults, FaultsError, LifeFaults, Moment,
    Outage, OutageKind, Swing,
};
pub use plugin_host::{FramesDrawn, PluginOptions, SceneBehind, WindowCovers, WindowForm};
pub use seat::LinkPatience;

use crate::quirks::Quirks;
use crate::window::DisplayWindow;
pub use tape::serve_tape;

use faults::cameras::FaultyCameras;
use faults::outages::Outages;

/// X-Plane's UDP port.
pub(crate) const DEFAULT_PORT: u16 = 49_000;
/// The port of X-Plane 12's Web API.
pub(crate) const DEFAULT_WEB_PORT: u16 = 8086;
/// The capture link listens this much above the UDP port.
const CAPTURE_PORT_OFFSET: u16 = 10;

/// Interval at which the main menu is looked at.
const MENU_LOOK: Duration = Duration::from_millis(20);

/// Settings of the server.
#[derive(Debug, Clone)]
pub struct ServerOptions {
    /// Address of the network interface. Only loopback is safe: anyone who reaches the stand-in controls it.
    pub bind: IpAddr,
    /// UDP port; 0 takes any free one. The capture link listens 10 above it, or on any free one.
    pub port: u16,
    /// True to announce the stand-in by multicast, as X-Plane does.
    pub beacon: bool,
    /// The computer's name in the beacon. X-Plane 12 may send none, and some clients need one.
    pub beacon_name: Option<String>,
    /// The X-Plane to imitate: 11.55 or 12.4.0.
    pub generation: Generation,
    /// TCP port of X-Plane 12's Web API; 0 takes any free one. `None` is X-Plane's own port, or any free one if `port` is 0.
    pub web_port: Option<u16>,
    /// True if a flight is loaded at the start, false if the main menu is open.
    pub flight_loaded: bool,
    /// True if "Accept incoming connections" is on in X-Plane's network settings. A fresh X-Plane 12 has it off.
    pub incoming: bool,
    /// Faults to simulate.
    pub faults: Faults,
    /// Awkward habits of a live X-Plane to imitate.
    pub quirks: Quirks,
    /// Speed of the simulator's clock relative to real time, 1 or more.
    pub clock_rate: f64,
    /// The token that a client of the capture link must send. Required if the address is not a loopback one.
    pub token: Option<LinkToken>,
    /// Timeouts of the capture link.
    pub patience: LinkPatience,
    /// The window that shows the drawn images, if there is one.
    pub stage: Option<Arc<dyn DisplayWindow>>,
    /// The server of the capture link.
    pub link: LinkServer,
}

/// The server of the capture link.
#[derive(Debug, Clone, Default)]
pub enum LinkServer {
    /// The stand-in itself.
    #[default]
    BuiltIn,
    /// Our plugin's own Python.
    Plugin(PluginOptions),
    /// No server: an X-Plane without our plugin.
    Nobody,
}

impl Default for ServerOptions {
    /// X-Plane's port on the loopback interface, with beacon.
    fn default() -> Self {
        Self {
            bind: Ipv4Addr::LOCALHOST.into(),
            port: DEFAULT_PORT,
            beacon: true,
            beacon_name: Some("dtd-mock-xplane".into()),
            generation: Generation::XPlane12,
            web_port: None,
            flight_loaded: true,
            incoming: true,
            faults: Faults::default(),
            quirks: Quirks::NONE,
            clock_rate: 1.0,
            token: None,
            patience: LinkPatience::default(),
            stage: None,
            link: LinkServer::default(),
        }
    }
}

impl ServerOptions {
    /// Refuses to listen for other machines without a secret.
    fn check_token(&self) -> Result<(), MockError> {
        match &self.token {
            None if !self.bind.is_loopback() => Err(MockError::NoToken { address: self.bind }),
            _ => Ok(()),
        }
    }
}

/// The stand-in's addresses; as JSON, the line that `dtd mock-xplane` prints.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Addresses {
    /// X-Plane's UDP protocol.
    pub udp: SocketAddr,
    /// The capture link, TCP; not open under [`LinkServer::Nobody`]. Port 0: the one that the plugin takes and publishes.
    pub capture_link: SocketAddr,
    /// X-Plane 12's Web API, TCP on this computer only; X-Plane 11 has none.
    pub web_api: Option<SocketAddr>,
    /// Multicast group and port of the beacon.
    pub beacon: SocketAddr,
}

/// Reason why the stand-in cannot run.
#[derive(Debug, thiserror::Error)]
pub enum MockError {
    /// An address is not available.
    #[error(
        "cannot listen on {address} ({what}): {source}. Does X-Plane or another stand-in run there? --port 0 takes any free port"
    )]
    Bind {
        /// Requested address.
        address: SocketAddr,
        /// Purpose.
        what: &'static str,
        /// Underlying error.
        r#source: io::Error,
    },
    /// Open to other machines without a secret.
    #[error(
        "the capture link would listen on {address} for everybody: set DTD_LINK_TOKEN to a secret of your choice, which is not empty, here \
         and where the client runs, or listen on 127.0.0.1"
    )]
    NoToken {
        /// The address.
        address: IpAddr,
    },
    /// The plugin's Python does not run.
    #[error("the plugin in {} does not run: {what}", folder.display())]
    Plugin {
        /// Folder of the plugin.
        folder: PathBuf,
        /// Symptom.
        what: String,
    },
    /// The file of an unclean end cannot be written.
    #[error("--faults asks={}: cannot write the file that marks a run: {source}", file.display())]
    NoMark {
        /// The file.
        file: PathBuf,
        /// Underlying error.
        r#source: io::Error,
    },
    /// A socket failed while running.
    #[error("{what} failed: {source}")]
    Socket {
        /// Name of the socket.
        what: &'static str,
        /// Underlying error.
        r#source: io::Error,
    },
    /// The tape cannot be read.
    #[error(transparent)]
    Tape(#[from] TapeError),
    /// A part of the server ended unexpectedly, which is a bug.
    #[error("a part of the stand-in stopped: {0}")]
    Stopped(String),
}

/// Runs the stand-in with its built-in flight model and renderer until it is told to quit or the future is dropped; calls `ready` once it
/// listens.
///
/// # Errors
/// [`MockError::Bind`] if a port is taken, [`MockError::NoToken`] if it would be open to everybody, [`MockError::Socket`] if a
/// socket fails later.
pub async fn serve(options: ServerOptions, ready: impl FnOnce(Addresses)) -> Result<(), MockError> {
    serve_with(options, Arc::new(BuiltIn), ready).await
}

/// [`serve`] with any flight model and renderer.
///
/// # Errors
/// As [`serve`].
pub async fn serve_with(
    options: ServerOptions,
    engine: Arc<dyn Engine>,
    ready: impl FnOnce(Addresses),
) -> Result<(), MockError> {
    options.check_token()?;
    let mut ports = Ports::take(options.bind, options.port).await?;
    if !matches!(options.link, LinkServer::BuiltIn) {
        ports.leave_capture_link(&options).await?;
    }
    let web_port = options.web_port.unwrap_or(match options.port {
        0 => 0,
        _ => DEFAULT_WEB_PORT,
    });
    // Like X-Plane's, it serves this computer only, whatever the others are bound to.
    let web_address = SocketAddr::from((Ipv4Addr::LOCALHOST, web_port));
    let web_api = match options.generation {
        Generation::XPlane11 => None,
        Generation::XPlane12 => Some(listen(web_address, "Web API").await?),
    };
    let addresses = ports.addresses(web_api.as_ref().map(|(address, _)| *address));
    let server = Server {
        outages: Arc::new(Outages::new(options.faults.outages.clone())),
        options,
        addresses,
        udp: ports.udp,
        capture_link: ports.capture_link,
        web_api: web_api.map(|(_, listener)| listener),
        engine,
    };
    ready(addresses);
    server.boxed().await
}

/// The ports that clients look for: X-Plane's UDP, and the capture link above it.
struct Ports {
    udp: UdpSockets,
    udp_address: SocketAddr,
    capture_link: Arc<TcpListener>,
    link_address: SocketAddr,
}

impl Ports {
    async fn take(bind: IpAddr, port: u16) -> Result<Self, MockError> {
        let udp_address = SocketAddr::new(bind, port);
        let udp = UdpSocket::bind(udp_address)
            .await
            .and_then(|socket| Ok((socket.local_addr()?, socket)));
        let (udp_address, udp) = udp.map_err(|source| MockError::Bind {
            address: udp_address,
            what: "UDP",
            source,
        })?;
        let udp = UdpSockets::answering(udp, udp_address, port).await?;
        let link_port = match port {
            0 => 0,
            port => port.checked_add(CAPTURE_PORT_OFFSET).unwrap_or(0),
        };
        let link_address = SocketAddr::new(bind, link_port);
        let (link_address, capture_link) = listen(link_address, "capture link").await?;
        Ok(Self {
            udp,
            udp_address,
            capture_link,
            link_address,
        })
    }

    /// Moves the built-in link to a different port, on which no clients are accepted: a plugin opens its own port in its place. If any free
    /// port will do, the plugin takes one when it starts: one that is chosen now may be another program's by then.
    async fn leave_capture_link(&mut self, options: &ServerOptions) -> Result<(), MockError> {
        let aside = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        (_, self.capture_link) = listen(aside, "capture link").await?;
        if options.port == 0 && matches!(options.link, LinkServer::Plugin(_)) {
            self.link_address.set_port(0);
        }
        Ok(())
    }

    fn addresses(&self, web_api: Option<SocketAddr>) -> Addresses {
        Addresses {
            udp: self.udp_address,
            capture_link: self.link_address,
            web_api,
            beacon: (BEACON_GROUP, BEACON_PORT).into(),
        }
    }
}

/// The sockets of X-Plane's UDP protocol. Answers do not come from the port that takes packets: X-Plane sends from 49001 ("Port we send
/// from (legacy)").
#[derive(Debug, Clone)]
struct UdpSockets {
    listening: Arc<UdpSocket>,
    answering: Arc<UdpSocket>,
}

impl UdpSockets {
    /// Answers from the next port, or any free one: unlike X-Plane, which complains, several stand-ins run on one computer.
    async fn answering(
        listening: UdpSocket,
        address: SocketAddr,
        port: u16,
    ) -> Result<Self, MockError> {
        let any = SocketAddr::new(address.ip(), 0);
        let next = match port {
            0 => any,
            port => SocketAddr::new(address.ip(), port.checked_add(1).unwrap_or(0)),
        };
        let answering = match UdpSocket::bind(next).await {
            Ok(socket) => Ok(socket),
            Err(_) => UdpSocket::bind(any).await,
        };
        let answering = answering.map_err(|source| MockError::Bind {
            address: any,
            what: "UDP answers",
            source,
        })?;
        Ok(Self {
            listening: Arc::new(listening),
            answering: Arc::new(answering),
        })
    }
}

/// Listens on an address; returns the actual one.
async fn listen(
    address: SocketAddr,
    what: &'static str,
) -> Result<(SocketAddr, Arc<TcpListener>), MockError> {
    let bound = TcpListener::bind(address)
        .await
        .and_then(|listener| Ok((listener.local_addr()?, Arc::new(listener))));
    bound.map_err(|source| MockError::Bind {
        address,
        what,
        source,
    })
}

/// State that survives restarts.
struct Server {
    options: ServerOptions,
    addresses: Addresses,
    udp: UdpSockets,
    capture_link: Arc<TcpListener>,
    web_api: Option<Arc<TcpListener>>,
    engine: Arc<dyn Engine>,
    outages: Arc<Outages>,
}

impl Server {
    /// Boxed and compiled here: an `async fn` is compiled again by every program that awaits it, and this one takes half a minute.
    fn boxed(self) -> BoxFuture<'static, Result<(), MockError>> {
        Box::pin(async move { self.run().await })
    }

    async fn run(&self) -> Result<(), MockError> {
        let life = &self.options.faults.life;
        let begun = life.begin().map_err(|source| MockError::NoMark {
            file: life.asks.clone().unwrap_or_default(),
            source,
        });
        let (_running, was_unclean) = begun?;
        if was_unclean {
            tracing::warn!(
                "the last end was unclean: asks whether to start in safe mode, and waits"
            );
            return self.swallow().await;
        }
        self.swallow_for(life.cold).await?;
        for number in 1.. {
            let mut session = self.begin_session(number);
            let restart = tokio::select! {
                ended = session.join_next() => {
                    session.shutdown().await;
                    // A simulator that was told to quit.
                    self.swallow_for(life.held).await?;
                    return match ended {
                        Some(Ok(ended)) => ended,
                        Some(Err(panicked)) => Err(MockError::Stopped(panicked.to_string())),
                        None => Ok(()),
                    };
                }
                restart = self.outages.next_restart() => restart,
            };
            session.shutdown().await;
            tokio::select! {
                () = self.outages.pass(restart) => {}
                failed = self.swallow() => return failed,
            }
        }
        Ok(())
    }

    /// A freshly started simulator: its state, and the tasks that answer clients. Dropping the set ends them.
    fn begin_session(&self, number: u64) -> JoinSet<Result<(), MockError>> {
        let options = &self.options;
        let life = &options.faults.life;
        let flight_loaded = options.flight_loaded && !life.menu;
        let mut world = world::World::new(options.generation, flight_loaded, options.quirks);
        if matches!(options.link, LinkServer::BuiltIn) && !life.menu {
            let port = self.addresses.capture_link.port();
            world.set_own(names::CAPTURE_PORT, f64::from(port));
            let settle_s = WEATHER_SETTLE.as_secs_f64() * world.quirks.pace(options.clock_rate);
            world.set_own(names::WEATHER_SETTLE_S, settle_s);
        }
        let version = world.version();
        let world = Shared(Arc::new(Mutex::new(world)));
        let outages = || self.outages.clone();
        let mut session = JoinSet::new();
        session.spawn(udp::run(
            self.udp.clone(),
            world.clone(),
            options.clone(),
            outages(),
        ));
        match options.link.clone() {
            LinkServer::Plugin(plugin) => {
                let host = plugin_host::HostSettings {
                    bind: options.bind,
                    port: self.addresses.capture_link.port(),
                    token: options.token.clone(),
                    clock_rate: options.clock_rate,
                    faults: options.faults.clone(),
                };
                let hosted = plugin_host::run(
                    plugin,
                    host,
                    world.clone(),
                    self.engine.clone(),
                    outages(),
                    options.stage.clone(),
                );
                session.spawn(after_menu(world.clone(), hosted));
            }
            LinkServer::BuiltIn => {
                if life.menu {
                    let (published, port) = (world.clone(), self.addresses.capture_link.port());
                    session.spawn(after_menu(world.clone(), async move {
                        published
                            .lock()
                            .set_own(names::CAPTURE_PORT, f64::from(port));
                        std::future::pending().await
                    }));
                }
                session.spawn(capture_link::run(
                    self.capture_link.clone(),
                    world.clone(),
                    self.engine.clone(),
                    outages(),
                    capture_link::Admission {
                        token: options.token.clone(),
                        patience: options.patience,
                    },
                    options.stage.clone(),
                    FaultyCameras::new(&options.faults),
                ));
            }
            LinkServer::Nobody => {}
        }
        if let Some(listener) = &self.web_api {
            session.spawn(web_api::run(
                listener.clone(),
                world,
                options.incoming,
                number,
                outages(),
            ));
        }
        if options.beacon {
            let beacon = Beacon {
                version,
                port: self.addresses.udp.port(),
                name: options.beacon_name.clone(),
                raknet_port: Some(beacon::RAKNET_PORT),
                ..Beacon::default()
            };
            session.spawn(beacon::run(options.bind, beacon, outages()));
        }
        session
    }

    /// [`Self::swallow`] for some time.
    async fn swallow_for(&self, time: Duration) -> Result<(), MockError> {
        if time.is_zero() {
            // The shortest sleep lasts a millisecond, and a client that connects within it would be dropped.
            return Ok(());
        }
        tokio::select! {
            () = sleep(time) => Ok(()),
            failed = self.swallow() => failed,
        }
    }

    /// Handles input while no simulator runs. The ports stay ours, so that no other program takes them in the meantime.
    async fn swallow(&self) -> Result<(), MockError> {
        let failed = |what| move |source| MockError::Socket { what, source };
        let nobody = Doorway::new("a simulator that restarts", 2);
        let mut buffer = [0; 2048];
        loop {
            tokio::select! {
                _ = nobody.next(&self.capture_link) => {}
                Some(_) = accept(&nobody, self.web_api.as_deref()) => {}
                received = self.udp.listening.recv_from(&mut buffer) => match received {
                    Err(error) if error.kind() != io::ErrorKind::ConnectionReset => {
                        return Err(failed("the UDP server")(error));
                    }
                    _ => {}
                },
            }
        }
    }
}

/// A part of the simulator that begins with its first flight.
async fn after_menu(
    world: Shared,
    part: impl Future<Output = Result<(), MockError>>,
) -> Result<(), MockError> {
    while !world.lock().flight_loaded {
        sleep(MENU_LOOK).await;
    }
    part.await
}

/// The next connection, if there is a listener.
async fn accept(doorway: &Doorway, listener: Option<&TcpListener>) -> Option<()> {
    doorway.next(listener?).await;
    Some(())
}

/// The simulated world, shared by the UDP server and the capture link.
#[derive(Debug, Clone)]
struct Shared(Arc<Mutex<world::World>>);

impl Shared {
    /// The world. A panic elsewhere does not make it unusable: every change is a single assignment.
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
            web_api: Some(([127, 0, 0, 1], 8_086).into()),
            beacon: (BEACON_GROUP, BEACON_PORT).into(),
        };
        assert_eq!(
            serde_json::to_string(&addresses).unwrap(),
            r#"{"udp":"127.0.0.1:49000","capture_link":"127.0.0.1:49010","web_api":"127.0.0.1:8086","beacon":"239.255.1.1:49707"}"#
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
