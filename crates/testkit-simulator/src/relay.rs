//! A UDP relay in front of a simulator. It answers from a different port than it listens on, as X-Plane does, or alters the values of
//! datarefs on their way to clients. The capture link does not pass it.
//!
//! Each client gets a separate socket towards the simulator. Whatever the simulator itself does, a client that only accepts answers
//! from the port that it sends to gets none of a relay with two ports.

use std::collections::HashMap;
use std::fmt;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use xplane_bridge::packet::{DatarefValues, FromSimulator, ToSimulator};

/// Interval at which threads check whether to end.
const POLL: Duration = Duration::from_millis(50);

/// Maps a dataref's value to the reported one.
type Change = dyn Fn(&str, f32) -> f32 + Send + Sync;

/// Runs while this value lives.
#[derive(Debug)]
pub struct Relay {
    address: SocketAddr,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

struct Shared {
    simulator: SocketAddr,
    answering: UdpSocket,
    change: Option<Box<Change>>,
    /// The subscribed datarefs, by client and index.
    paths: Mutex<HashMap<(SocketAddr, i32), String>>,
    answers: AtomicU64,
    ended: AtomicBool,
}

impl fmt::Debug for Shared {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Shared").field(&self.simulator).finish()
    }
}

impl Relay {
    /// Starts a relay with two ports for the simulator at this address.
    pub fn start(simulator: SocketAddr) -> Self {
        Self::start_with(simulator, socket(), socket(), None)
    }

    fn start_with(
        simulator: SocketAddr,
        listening: UdpSocket,
        answering: UdpSocket,
        change: Option<Box<Change>>,
    ) -> Self {
        let address = listening.local_addr().unwrap();
        let shared = Arc::new(Shared {
            simulator,
            answering,
            change,
            paths: Mutex::default(),
            answers: AtomicU64::new(0),
            ended: AtomicBool::new(false),
        });
        let thread = thread::spawn({
            let shared = shared.clone();
            move || serve(&listening, &shared)
        });
        Self {
            address,
            shared,
            thread: Some(thread),
        }
    }

    /// Address for clients.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Number of datagrams that the simulator has sent to all clients.
    pub fn answers(&self) -> u64 {
        self.shared.answers.load(Ordering::Relaxed)
    }
}

/// Starts a relay that reports changed values of datarefs until the test program ends; returns its address.
pub fn altered(
    simulator: SocketAddr,
    change: impl Fn(&str, f32) -> f32 + Send + Sync + 'static,
) -> SocketAddr {
    let listening = socket();
    let answering = listening.try_clone().unwrap();
    let relay = Relay::start_with(simulator, listening, answering, Some(Box::new(change)));
    let address = relay.address();
    std::mem::forget(relay);
    address
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.shared.ended.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn socket() -> UdpSocket {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    socket.set_read_timeout(Some(POLL)).unwrap();
    socket
}

fn serve(listening: &UdpSocket, shared: &Arc<Shared>) {
    let mut clients: HashMap<SocketAddr, Arc<UdpSocket>> = HashMap::new();
    let mut threads = Vec::new();
    let mut buffer = [0; 2048];
    while !shared.ended.load(Ordering::Relaxed) {
        let Ok((length, client)) = listening.recv_from(&mut buffer) else {
            continue;
        };
        if let Ok(ToSimulator::SubscribeDataref(request)) = ToSimulator::decode(&buffer[..length])
            && !request.is_end()
        {
            let mut paths = shared.paths.lock().unwrap();
            paths.insert((client, request.index), request.path);
        }
        let towards_simulator = clients.entry(client).or_insert_with(|| {
            let towards_simulator = Arc::new(socket());
            let (shared, own) = (shared.clone(), towards_simulator.clone());
            threads.push(thread::spawn(move || answer(&shared, &own, client)));
            towards_simulator
        });
        let _ = towards_simulator.send_to(&buffer[..length], shared.simulator);
    }
    for thread in threads {
        let _ = thread.join();
    }
}

fn answer(shared: &Shared, from_simulator: &UdpSocket, client: SocketAddr) {
    let mut buffer = [0; 2048];
    while !shared.ended.load(Ordering::Relaxed) {
        if let Ok(length) = from_simulator.recv(&mut buffer) {
            shared.answers.fetch_add(1, Ordering::Relaxed);
            let datagram = shared.altered(&buffer[..length], client);
            let _ = shared.answering.send_to(&datagram, client);
        }
    }
}

impl Shared {
    /// The datagram that the client gets.
    fn altered(&self, datagram: &[u8], client: SocketAddr) -> Vec<u8> {
        let decoded = FromSimulator::decode(datagram);
        let (Some(change), Ok(FromSimulator::DatarefValues(DatarefValues { mut values }))) =
            (&self.change, decoded)
        else {
            return datagram.to_vec();
        };
        let paths = self.paths.lock().unwrap();
        for read in &mut values {
            if let Some(path) = paths.get(&(client, read.index)) {
                read.value = change(path, read.value);
            }
        }
        let altered = FromSimulator::DatarefValues(DatarefValues { values });
        altered.encode().expect("it was as long before")
    }
}
