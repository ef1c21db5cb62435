//! A UDP relay in front of a simulator that, like X-Plane, answers from a different port than it listens on.
//!
//! Each client gets a separate socket towards the simulator. Whatever the simulator itself does, a client that only accepts answers from
//! the port that it sends to gets none.

use std::collections::HashMap;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

/// Interval at which threads check whether to end.
const POLL: Duration = Duration::from_millis(50);

/// Runs while this value lives.
#[derive(Debug)]
pub struct Relay {
    address: SocketAddr,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug)]
struct Shared {
    simulator: SocketAddr,
    answering: UdpSocket,
    answers: AtomicU64,
    ended: AtomicBool,
}

impl Relay {
    /// Starts a relay for the simulator at this address.
    pub fn start(simulator: SocketAddr) -> Self {
        let listening = socket();
        let address = listening.local_addr().unwrap();
        let shared = Arc::new(Shared {
            simulator,
            answering: socket(),
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
            let _ = shared.answering.send_to(&buffer[..length], client);
        }
    }
}
