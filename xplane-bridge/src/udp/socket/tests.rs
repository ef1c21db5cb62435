use std::net::Ipv4Addr;

use tokio::time::timeout_at;

use super::*;
use crate::packet::DatarefValues;

const SOON: Duration = Duration::from_secs(10);

/// A simulator that listens on one port and answers from a second.
struct Simulator {
    listening: UdpSocket,
    answering: UdpSocket,
}

impl Simulator {
    async fn start() -> Self {
        Self {
            listening: bound(Ipv4Addr::LOCALHOST).await,
            answering: bound(Ipv4Addr::LOCALHOST).await,
        }
    }

    fn address(&self) -> SocketAddr {
        self.listening.local_addr().unwrap()
    }

    /// The next dataref request, and its sender.
    async fn request(&self) -> (SubscribeDataref, SocketAddr) {
        let mut buffer = [0; 2048];
        loop {
            let received = timeout(SOON, self.listening.recv_from(&mut buffer)).await;
            let (length, from) = received.expect("no request").unwrap();
            if let Ok(ToSimulator::SubscribeDataref(request)) =
                ToSimulator::decode(&buffer[..length])
            {
                return (request, from);
            }
        }
    }

    async fn answer(&self, client: SocketAddr, index: i32, value: f32) {
        send_value(&self.answering, client, index, value).await;
    }
}

async fn bound(ip: Ipv4Addr) -> UdpSocket {
    UdpSocket::bind((ip, 0)).await.unwrap()
}

async fn send_value(socket: &UdpSocket, client: SocketAddr, index: i32, value: f32) {
    let values = vec![DatarefValue { index, value }];
    let reply = FromSimulator::DatarefValues(DatarefValues { values });
    socket
        .send_to(&reply.encode().unwrap(), client)
        .await
        .unwrap();
}

fn subscription(index: i32) -> ToSimulator {
    ToSimulator::SubscribeDataref(SubscribeDataref {
        frequency_hz: 5,
        index,
        path: "sim/test".into(),
    })
}

async fn open(address: SocketAddr) -> Arc<SimulatorSocket> {
    SimulatorSocket::open(address, &LocalUdp::default())
        .await
        .unwrap()
}

#[tokio::test]
async fn answers_from_another_port_are_taken_and_those_of_other_computers_are_not() {
    let simulator = Simulator::start().await;
    let socket = open(simulator.address()).await;
    let mut claim = socket.claim(1);
    socket.send(&subscription(claim.first())).await.unwrap();
    let (request, client) = simulator.request().await;
    simulator.answer(client, request.index, 7.0).await;
    let values = timeout(SOON, claim.values()).await.expect("no value");
    assert_eq!(values[0].value, 7.0);

    // For the client of a different simulator, this one is a stranger.
    let elsewhere = SocketAddr::from(([10, 0, 0, 5], 49_000));
    let own = bound(Ipv4Addr::LOCALHOST).await;
    let client = own.local_addr().unwrap();
    let other = Arc::new(Shared::new(own, elsewhere, Arc::default()));
    let receiving = tokio::spawn(receive(other.clone()));
    simulator.answer(client, 1, 7.0).await;
    sleep(Duration::from_millis(100)).await;
    assert!(!other.has_heard.load(Ordering::Relaxed));
    receiving.abort();
}

#[tokio::test]
async fn a_value_that_no_reader_wants_ends_its_subscription() {
    let simulator = Simulator::start().await;
    let socket = open(simulator.address()).await;
    let claim = socket.claim(1);
    let index = claim.first();
    socket.send(&subscription(index)).await.unwrap();
    let (_, client) = simulator.request().await;
    claim.was_ended();
    simulator.answer(client, index, 7.0).await;
    let (end, _) = simulator.request().await;
    assert!(end.is_end() && end.index == index, "{end:?}");
}

#[tokio::test]
async fn a_closed_port_is_told_from_a_silent_one() {
    let closed = bound(Ipv4Addr::LOCALHOST).await.local_addr().unwrap();
    assert!(open(closed).await.is_refused().await);
    let silent = Simulator::start().await;
    assert!(!open(silent.address()).await.is_refused().await);
}

#[tokio::test]
async fn a_fixed_port_is_used_again_at_once_and_a_taken_one_is_named() {
    let simulator = Simulator::start().await;
    let port = bound(Ipv4Addr::LOCALHOST)
        .await
        .local_addr()
        .unwrap()
        .port();
    let fixed = LocalUdp {
        port: Some(port),
        notes: None,
    };
    for _ in 0..3 {
        let socket = SimulatorSocket::open(simulator.address(), &fixed)
            .await
            .unwrap();
        socket.send(&subscription(1)).await.unwrap();
        assert_eq!(simulator.request().await.1.port(), port);
    }
    let taken = bound(Ipv4Addr::LOCALHOST).await;
    let port = taken.local_addr().unwrap().port();
    let fixed = LocalUdp {
        port: Some(port),
        notes: None,
    };
    let error = SimulatorSocket::open(simulator.address(), &fixed)
        .await
        .unwrap_err()
        .to_string();
    assert!(
        error.contains(&port.to_string()) && error.contains("--udp-port"),
        "{error}"
    );
}

#[tokio::test]
async fn the_next_client_ends_the_subscriptions_of_killed_ones_and_leaves_running_ones_alone() {
    let state = tempfile::tempdir().unwrap();
    let noted = LocalUdp {
        port: None,
        notes: Some(state.path().join("udp-ports")),
    };
    let simulator = Simulator::start().await;
    // Running, with a note; and two ports of clients that were killed.
    let running = SimulatorSocket::open(simulator.address(), &noted)
        .await
        .unwrap();
    let mut killed = Vec::new();
    for _ in 0..2 {
        let socket = bound(Ipv4Addr::LOCALHOST).await;
        let address = socket.local_addr().unwrap();
        noted.note(simulator.address(), address.port()).unwrap();
        killed.push(address);
    }
    let next = tokio::spawn({
        let (address, noted) = (simulator.address(), noted.clone());
        async move { SimulatorSocket::open(address, &noted).await.unwrap() }
    });
    // X-Plane goes on sending to both.
    let mut ended = std::collections::BTreeSet::new();
    let until = Instant::now() + SOON;
    while ended.len() < killed.len() {
        for client in &killed {
            simulator.answer(*client, 41, 1.0).await;
        }
        let soon = Instant::now() + Duration::from_millis(100);
        if let Ok((end, from)) = timeout_at(soon, simulator.request()).await {
            assert!(end.is_end() && end.index == 41, "{end:?}");
            ended.insert(from.port());
        }
        assert!(Instant::now() < until, "{ended:?} of {killed:?}");
    }
    let ports: std::collections::BTreeSet<u16> = killed.iter().map(SocketAddr::port).collect();
    assert_eq!(ended, ports);
    let next = next.await.unwrap();
    next.close().await;
    let left = noted.notes(simulator.address());
    assert_eq!(left.len(), 1, "only the running client's: {left:?}");
    running.close().await;
    assert!(noted.notes(simulator.address()).is_empty());
}
