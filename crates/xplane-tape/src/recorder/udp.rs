//! The UDP proxy. Each client gets a separate socket towards the simulator, which distinguishes clients by their address.

use std::collections::{BTreeSet, HashMap};
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use rustix::process::{Resource, getrlimit};
use tokio::net::UdpSocket;
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio::time::timeout;

use super::Route;
use crate::error::TapeError;
use crate::format::{Channel, Direction, Traffic};
use xplane_bridge::PortNote;
use xplane_bridge::datarefs::CAPTURE_PORT;
use xplane_bridge::packet::ToSimulator;
use xplane_bridge::udp::simulator_address::{is_answer, local_address};

/// A client without traffic for this long is forgotten. If it comes back, it is a new one.
const FORGET_AFTER: Duration = Duration::from_secs(600);
/// Maximum clients, each with a socket: a few programs of a single user. If few descriptors are allowed, at most a quarter of them: the
/// capture link needs two for each of its clients, and would find none while clients that sent a single datagram are remembered.
const MAX_CLIENTS: usize = 256;
/// Maximum queued datagrams per client; more are lost, as is usual with UDP.
const WAITING: usize = 1_000;
/// Largest datagram.
const DATAGRAM_BYTES: usize = 65_536;
/// Bytes before the values in an `RREF` reply, and bytes per value.
const REPLY_HEAD: usize = 5;
const VALUE: usize = 8;

/// Serves until dropped.
pub(super) async fn run(ours: Arc<UdpSocket>, route: Arc<Route>) -> Result<(), TapeError> {
    let descriptors = getrlimit(Resource::Nofile).current;
    let most_clients = descriptors.map_or(MAX_CLIENTS, |most| MAX_CLIENTS.min(most as usize / 4));
    let mut clients: HashMap<SocketAddr, mpsc::Sender<Vec<u8>>> = HashMap::new();
    let mut tasks = JoinSet::new();
    let mut count = 0;
    let mut said_full = false;
    let mut buffer = vec![0; DATAGRAM_BYTES];
    loop {
        let (length, from) = match ours.recv_from(&mut buffer).await {
            Ok(received) => received,
            // Some systems report here that an earlier datagram met a closed port.
            Err(error) if error.kind() == std::io::ErrorKind::ConnectionReset => continue,
            Err(error) => {
                let text = format!("the recorder's UDP socket failed: {error}");
                return Err(TapeError::Failed(text));
            }
        };
        while tasks.try_join_next().is_some() {}
        clients.retain(|_, client| !client.is_closed());
        let client = match clients.get(&from) {
            Some(known) => known,
            None if clients.len() >= most_clients => {
                if !std::mem::replace(&mut said_full, true) {
                    tracing::warn!(%from, "datagrams ignored: {most_clients} clients are here already");
                }
                continue;
            }
            None => {
                let client = Client::open(count + 1, from, ours.clone(), route.clone()).await;
                let client = match client {
                    Ok(client) => client,
                    Err(error) => {
                        if !std::mem::replace(&mut said_full, true) {
                            tracing::warn!(%from, %error, "datagrams ignored: no socket for another client");
                        }
                        continue;
                    }
                };
                count += 1;
                let (sender, datagrams) = mpsc::channel(WAITING);
                tasks.spawn(client.serve(datagrams));
                clients.entry(from).or_insert(sender)
            }
        };
        if client.try_send(buffer[..length].to_vec()).is_err() {
            tracing::warn!(%from, "datagram lost: the tape cannot follow");
        }
    }
}

struct Client {
    number: u32,
    address: SocketAddr,
    ours: Arc<UdpSocket>,
    towards_simulator: UdpSocket,
    route: Arc<Route>,
    /// Indices with which this client has requested the capture link's port.
    link_port_indices: BTreeSet<i32>,
    subscriptions: Subscriptions,
    /// The note of the port towards the simulator, from the first subscription on.
    note: Option<PortNote>,
}

/// Active subscriptions.
#[derive(Debug, Default)]
struct Subscriptions {
    indices: BTreeSet<i32>,
    positions: bool,
}

impl Subscriptions {
    fn follow(&mut self, packet: &ToSimulator) {
        match packet {
            ToSimulator::SubscribeDataref(request) if request.is_end() => {
                self.indices.remove(&request.index);
            }
            ToSimulator::SubscribeDataref(request) => {
                self.indices.insert(request.index);
            }
            ToSimulator::SubscribePosition(request) => self.positions = request.frequency_hz > 0,
            _ => {}
        }
    }

    fn are_ended(&self) -> bool {
        self.indices.is_empty() && !self.positions
    }
}

/// Runs when the recorder ends as well: the next client gets the note of a port to which the simulator goes on sending.
impl Drop for Client {
    fn drop(&mut self) {
        if let Some(note) = self.note.take()
            && self.subscriptions.are_ended()
        {
            note.remove();
        }
    }
}

impl Client {
    async fn open(
        number: u32,
        address: SocketAddr,
        ours: Arc<UdpSocket>,
        route: Arc<Route>,
    ) -> std::io::Result<Self> {
        let towards_simulator = bind(&route).await?;
        for direction in [Direction::ToSimulator, Direction::FromSimulator] {
            let about = [("client", address.to_string())];
            let channel = channel(number, direction);
            route.tape_thread.add_channel(channel, &about).await;
        }
        tracing::info!(%address, number, "client");
        Ok(Self {
            number,
            address,
            ours,
            towards_simulator,
            route,
            link_port_indices: BTreeSet::new(),
            subscriptions: Subscriptions::default(),
            note: None,
        })
    }

    async fn serve(mut self, mut datagrams: mpsc::Receiver<Vec<u8>>) {
        let mut buffer = vec![0; DATAGRAM_BYTES];
        loop {
            let next = async {
                tokio::select! {
                    // Causal order: data that the simulator has sent is older than data that it has not yet received.
                    biased;
                    received = self.towards_simulator.recv_from(&mut buffer) => Some(Err(received)),
                    datagram = datagrams.recv() => datagram.map(Ok),
                }
            };
            match timeout(FORGET_AFTER, next).await {
                Ok(Some(Ok(datagram))) => self.pass_to_simulator(&datagram).await,
                Ok(Some(Err(Ok((length, from))))) if is_answer(self.route.simulator, from) => {
                    self.pass_to_client(&mut buffer[..length]).await;
                }
                // A stranger's datagram, or a notice that the port is not open, perhaps only not yet.
                Ok(Some(Err(_))) => {}
                Ok(None) | Err(_) => return,
            }
        }
    }

    async fn pass_to_simulator(&mut self, datagram: &[u8]) {
        self.route
            .tape_thread
            .write(channel(self.number, Direction::ToSimulator), datagram)
            .await;
        let packet = ToSimulator::decode(datagram);
        if let Ok(packet) = &packet {
            self.subscriptions.follow(packet);
            self.note_port();
        }
        if let Ok(ToSimulator::SubscribeDataref(request)) = packet {
            // Values may still arrive after a subscription ended, so only reuse of the index counts.
            if request.path.trim_end_matches("[0]") == CAPTURE_PORT {
                self.link_port_indices.insert(request.index);
            } else if !request.is_end() {
                self.link_port_indices.remove(&request.index);
            }
        }
        if let Err(error) = self
            .towards_simulator
            .send_to(datagram, self.route.simulator)
            .await
        {
            tracing::warn!(%error, "cannot send to the simulator");
        }
    }

    /// Notes the port once something is subscribed to.
    fn note_port(&mut self) {
        if self.note.is_none()
            && !self.subscriptions.are_ended()
            && let Ok(local) = self.towards_simulator.local_addr()
        {
            let Route {
                local_udp,
                simulator,
                ..
            } = &*self.route;
            self.note = local_udp.note(*simulator, local.port());
        }
    }

    async fn pass_to_client(&mut self, datagram: &mut [u8]) {
        self.route
            .tape_thread
            .write(channel(self.number, Direction::FromSimulator), datagram)
            .await;
        if datagram.starts_with(b"RREF") && !self.link_port_indices.is_empty() {
            let head = REPLY_HEAD.min(datagram.len());
            for pair in datagram[head..].as_chunks_mut::<VALUE>().0 {
                self.redirect(pair);
            }
        }
        if let Err(error) = self.ours.send_to(datagram, self.address).await {
            tracing::debug!(%error, address = %self.address, "cannot send to the client");
        }
    }

    /// Replaces the simulator's link port by the recorder's own.
    fn redirect(&self, [i0, i1, i2, i3, value @ ..]: &mut [u8; VALUE]) {
        let index = i32::from_le_bytes([*i0, *i1, *i2, *i3]);
        let port = f32::from_le_bytes(*value);
        if self.link_port_indices.contains(&index) && (1.0..=f32::from(u16::MAX)).contains(&port) {
            self.route
                .simulators_link_port
                .store(port as u16, Ordering::Relaxed);
            *value = f32::from(self.route.our_link_port).to_le_bytes();
        }
    }
}

/// A socket towards the simulator: on any free port, or on the first free one of those that the user chose.
async fn bind(route: &Route) -> std::io::Result<UdpSocket> {
    let Some(first) = route.local_udp.port else {
        return UdpSocket::bind(local_address(route.simulator, 0)).await;
    };
    let last = first.saturating_add(MAX_CLIENTS as u16 - 1);
    let mut failed = None;
    for port in first..=last {
        match UdpSocket::bind(local_address(route.simulator, port)).await {
            Ok(socket) => return Ok(socket),
            Err(error) => failed = Some(error),
        }
    }
    Err(failed.unwrap_or_else(|| std::io::ErrorKind::AddrInUse.into()))
}

fn channel(number: u32, direction: Direction) -> Channel {
    Channel {
        traffic: Traffic::Udp,
        number,
        direction,
    }
}
