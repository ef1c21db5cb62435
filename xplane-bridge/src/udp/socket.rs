//! A client's UDP socket, shared by its readers.
//!
//! The socket is not connected: answers do not come from the port that takes the requests ([`simulator_address`]). A task receives them and
//! hands each value to the reader that claimed its number. A value that no reader claimed is late, or belongs to a client that was killed
//! and whose port this one took over ([`PortNote`]): its subscription is ended by its number.
//!
//! A system reports only to connected sockets that a port is closed. So a second socket, which is connected and on which no answer is
//! expected, finds out if any program listens there.
//!
//! [`simulator_address`]: crate::udp::simulator_address

mod local_udp;
mod readers;

use std::io;
use std::net::SocketAddr;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::net::UdpSocket;
use tokio::sync::{OnceCell, mpsc};
use tokio::task::JoinSet;
use tokio::time::{Instant, sleep, timeout};

use crate::error::BridgeError;
use crate::packet::{
    DatarefValue, DatarefValues, FromSimulator, Position, SubscribeDataref, SubscribePosition,
    ToSimulator,
};
use crate::udp::simulator_address::{is_answer, local_address, reachable};
pub use local_udp::{LocalUdp, PortNote};
use readers::Readers;

/// Time to wait for a refusal, which a computer of the same network sends at once.
const REFUSAL_WAIT: Duration = Duration::from_millis(50);
/// Time to listen on exit, repeated while unwanted values arrive, up to [`MAX_LEAVE`].
const LEAVE_PAUSE: Duration = Duration::from_millis(60);
const MAX_LEAVE: Duration = Duration::from_millis(600);
/// Time during which values for a killed client may arrive before its port is used.
const TAKE_OVER_PAUSE: Duration = Duration::from_millis(300);
/// Maximum time for which a port of our own that is being closed stays taken.
const PORT_PATIENCE: Duration = Duration::from_secs(1);
/// Positions that arrive this soon after their end were on the way.
const POSITIONS_ON_THE_WAY: Duration = Duration::from_millis(250);
/// Maximum ports of killed clients to take over; the rest are left to the next client.
const MAX_TAKEN_OVER: usize = 16;

/// A client's socket. Dropping it closes it.
#[derive(Debug)]
pub(crate) struct SimulatorSocket {
    shared: Arc<Shared>,
    _receiving: JoinSet<()>,
    notes: Mutex<Vec<PortNote>>,
    refusals: OnceCell<UdpSocket>,
}

/// State used by the receiving task.
#[derive(Debug)]
struct Shared {
    socket: UdpSocket,
    simulator: SocketAddr,
    readers: Mutex<Readers>,
    /// True if the simulator has ever sent anything.
    has_heard: AtomicBool,
    /// Number of unwanted values and positions, of this socket and of those taken over.
    unwanted: Arc<AtomicU64>,
    positions_ended: Mutex<Option<Instant>>,
}

impl SimulatorSocket {
    /// Opens a socket for the simulator at `address`. Sends no packet, unless it takes over the port of a client that was killed: then that
    /// client's subscriptions are ended first.
    pub(crate) async fn open(
        address: SocketAddr,
        local: &LocalUdp,
    ) -> Result<Arc<Self>, BridgeError> {
        let simulator = reachable(address);
        let mut notes = Vec::new();
        let mut taken_over = Vec::new();
        for note in local.notes(simulator).into_iter().take(MAX_TAKEN_OVER) {
            // A port that cannot be bound belongs to a running client.
            if Some(note.port()) != local.port
                && let Ok(socket) = UdpSocket::bind(local_address(simulator, note.port())).await
            {
                taken_over.push(socket);
                notes.push(note);
            }
        }
        let killed = taken_over.len();
        let socket = match (local.port, taken_over.pop()) {
            (None, Some(socket)) => socket,
            (Some(port), unused) => {
                taken_over.extend(unused);
                bind_fixed(local_address(simulator, port)).await?
            }
            (None, None) => UdpSocket::bind(local_address(simulator, 0))
                .await
                .map_err(|error| failed(simulator, &error))?,
        };
        if let Ok(own) = socket.local_addr()
            && notes.iter().all(|note| note.port() != own.port())
        {
            notes.extend(local.note(simulator, own.port()));
        }
        let unwanted = Arc::new(AtomicU64::new(0));
        let mut receiving = JoinSet::new();
        for socket in taken_over {
            let shared = Shared::new(socket, simulator, unwanted.clone());
            receiving.spawn(receive(Arc::new(shared)));
        }
        let shared = Arc::new(Shared::new(socket, simulator, unwanted));
        receiving.spawn(receive(shared.clone()));
        if killed > 0 {
            tracing::info!(%simulator, killed, "took over the ports of clients that were killed");
            sleep(TAKE_OVER_PAUSE).await;
        }
        Ok(Arc::new(Self {
            shared,
            _receiving: receiving,
            notes: Mutex::new(notes),
            refusals: OnceCell::new(),
        }))
    }

    /// The simulator's address.
    pub(crate) fn simulator(&self) -> SocketAddr {
        self.shared.simulator
    }

    /// Reserves numbers for `count` subscriptions.
    pub(crate) fn claim(self: &Arc<Self>, count: usize) -> Claim {
        let (first, values) = self.shared.readers().claim(count);
        Claim {
            socket: self.clone(),
            numbers: first..first + count as i32,
            values,
            has_ended: false,
        }
    }

    /// The positions that arrive from now on. An earlier reader gets no more.
    pub(crate) fn positions(&self) -> mpsc::Receiver<Position> {
        self.shared.readers().positions()
    }

    /// Sends a packet; its arrival is not confirmed.
    pub(crate) async fn send(&self, packet: &ToSimulator) -> Result<(), BridgeError> {
        if let ToSimulator::SubscribePosition(SubscribePosition { frequency_hz: 0 }) = packet {
            self.shared.note_end_of_positions();
        }
        self.shared.send(&packet.encode()?).await
    }

    /// Ends a subscription now, or not at all: for destructors.
    fn end_now(&self, index: i32) {
        if let Some(datagram) = end_datagram(index) {
            let Shared {
                socket, simulator, ..
            } = &*self.shared;
            let _ = socket.try_send_to(&datagram, *simulator);
        }
    }

    /// True if the simulator has never sent anything, and its computer reports that no program listens on the port.
    pub(crate) async fn is_refused(&self) -> bool {
        !self.shared.has_heard.load(Ordering::Relaxed)
            && matches!(self.ask_for_refusal().await, Err(error) if is_refusal(&error))
    }

    /// Sends a datagram without effect from a connected socket. Linux, macOS and Windows report a refusal when the socket is used next; on
    /// other systems, a closed port looks like a silent one.
    async fn ask_for_refusal(&self) -> io::Result<()> {
        let open = || async {
            let socket = UdpSocket::bind(local_address(self.simulator(), 0)).await?;
            socket.connect(self.simulator()).await?;
            Ok::<_, io::Error>(socket)
        };
        let socket = self.refusals.get_or_try_init(open).await?;
        let without_effect = end_datagram(1).unwrap_or_default();
        socket.send(&without_effect).await?;
        match timeout(REFUSAL_WAIT, socket.recv(&mut [0; 64])).await {
            Ok(received) => received.map(|_| ()),
            Err(_) => Ok(()),
        }
    }

    /// Listens until no unwanted values arrive, and then forgets the ports.
    pub(crate) async fn close(&self) {
        let until = Instant::now() + MAX_LEAVE;
        loop {
            let before = self.shared.unwanted.load(Ordering::Relaxed);
            sleep(LEAVE_PAUSE).await;
            let is_quiet = self.shared.unwanted.load(Ordering::Relaxed) == before;
            if is_quiet || Instant::now() >= until {
                break;
            }
        }
        let notes = std::mem::take(&mut *lock(&self.notes));
        notes.into_iter().for_each(PortNote::remove);
    }
}

/// Numbers that belong to one reader, until this is dropped: that ends their subscriptions, since a leaked one would be sent forever.
#[derive(Debug)]
pub(crate) struct Claim {
    socket: Arc<SimulatorSocket>,
    numbers: Range<i32>,
    values: mpsc::Receiver<Vec<DatarefValue>>,
    has_ended: bool,
}

impl Claim {
    /// The first of the numbers; the others follow.
    pub(crate) fn first(&self) -> i32 {
        self.numbers.start
    }

    /// Notes that all subscriptions were ended, so that dropping the claim sends nothing.
    pub(crate) fn was_ended(mut self) {
        self.has_ended = true;
    }

    /// The next values. Cancel safe.
    pub(crate) async fn values(&mut self) -> Vec<DatarefValue> {
        match self.values.recv().await {
            Some(values) => values,
            // The sender lives as long as the claim.
            None => std::future::pending().await,
        }
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        if !self.has_ended {
            for number in self.numbers.clone() {
                self.socket.end_now(number);
            }
        }
        self.socket.shared.readers().release(self.numbers.start);
    }
}

impl Shared {
    fn new(socket: UdpSocket, simulator: SocketAddr, unwanted: Arc<AtomicU64>) -> Self {
        Self {
            socket,
            simulator,
            readers: Mutex::new(Readers::new()),
            has_heard: AtomicBool::new(false),
            unwanted,
            positions_ended: Mutex::new(None),
        }
    }

    fn readers(&self) -> MutexGuard<'_, Readers> {
        lock(&self.readers)
    }

    fn note_end_of_positions(&self) {
        *lock(&self.positions_ended) = Some(Instant::now());
    }

    async fn send(&self, datagram: &[u8]) -> Result<(), BridgeError> {
        match self.socket.send_to(datagram, self.simulator).await {
            Ok(_) => Ok(()),
            // The answer to an earlier datagram, on systems that give it to unconnected sockets.
            Err(error) if is_refusal(&error) => Ok(()),
            Err(error) => Err(failed(self.simulator, &error)),
        }
    }

    /// Hands out a datagram's values, and ends unwanted subscriptions.
    async fn take(&self, datagram: &[u8]) {
        self.has_heard.store(true, Ordering::Relaxed);
        match FromSimulator::decode(datagram) {
            Ok(FromSimulator::DatarefValues(DatarefValues { values })) => {
                let unwanted = self.readers().hand_out(values);
                for index in unwanted {
                    self.unwanted.fetch_add(1, Ordering::Relaxed);
                    if let Some(datagram) = end_datagram(index) {
                        let _ = self.send(&datagram).await;
                    }
                }
            }
            Ok(FromSimulator::Position(position)) => {
                if !self.readers().hand_out_position(position) {
                    self.end_positions().await;
                }
            }
            Ok(other) => tracing::debug!(simulator = %self.simulator, ?other, "packet ignored"),
            Err(error) => {
                tracing::debug!(simulator = %self.simulator, %error, "datagram ignored");
            }
        }
    }

    /// X-Plane ends the positions of other clients of this computer as well, so it is asked only if they go on.
    async fn end_positions(&self) {
        let was_ended =
            lock(&self.positions_ended).is_some_and(|at| at.elapsed() < POSITIONS_ON_THE_WAY);
        if was_ended {
            return;
        }
        self.unwanted.fetch_add(1, Ordering::Relaxed);
        self.note_end_of_positions();
        let end = ToSimulator::SubscribePosition(SubscribePosition { frequency_hz: 0 });
        if let Ok(datagram) = end.encode() {
            let _ = self.send(&datagram).await;
        }
    }
}

/// Receives until it is aborted.
async fn receive(shared: Arc<Shared>) {
    /// After an error, so that a broken socket does not take a whole core.
    const PAUSE: Duration = Duration::from_millis(50);
    let mut buffer = [0; 2048];
    loop {
        match shared.socket.recv_from(&mut buffer).await {
            Ok((length, from)) if is_answer(shared.simulator, from) => {
                shared.take(&buffer[..length]).await;
            }
            Ok((_, from)) => tracing::debug!(%from, "datagram of another computer ignored"),
            Err(error) => {
                if !is_refusal(&error) {
                    tracing::warn!(simulator = %shared.simulator, %error, "cannot receive");
                }
                sleep(PAUSE).await;
            }
        }
    }
}

/// Binds a port that the user chose. An earlier connection of this process may be about to close it.
async fn bind_fixed(local: SocketAddr) -> Result<UdpSocket, BridgeError> {
    let until = Instant::now() + PORT_PATIENCE;
    loop {
        match UdpSocket::bind(local).await {
            Ok(socket) => return Ok(socket),
            Err(error) if error.kind() == io::ErrorKind::AddrInUse && Instant::now() < until => {
                sleep(Duration::from_millis(20)).await;
            }
            Err(source) => {
                return Err(BridgeError::LocalPort {
                    port: local.port(),
                    source,
                });
            }
        }
    }
}

/// The request that ends a subscription by its number alone.
fn end_datagram(index: i32) -> Option<Vec<u8>> {
    let end = SubscribeDataref {
        frequency_hz: 0,
        index,
        path: String::new(),
    };
    ToSimulator::SubscribeDataref(end).encode().ok()
}

fn failed(simulator: SocketAddr, error: &io::Error) -> BridgeError {
    BridgeError::Failed(format!("cannot use UDP towards {simulator}: {error}"))
}

/// True if an error only means that no program took an earlier datagram.
fn is_refusal(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        io::ErrorKind::ConnectionRefused | io::ErrorKind::ConnectionReset
    )
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests;
