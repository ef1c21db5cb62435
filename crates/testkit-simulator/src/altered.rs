//! A UDP relay in front of a stand-in that alters values of datarefs on their way to clients: a simulator that reports weather that differs
//! from what was written. The capture link does not pass it.

use std::collections::HashMap;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex};

use tokio::net::UdpSocket;
use xplane_bridge::packet::{
    DatarefValue, DatarefValues, DatarefValuesView, FromSimulator, ToSimulator,
};

/// Maps a dataref's value to the reported one.
type Change = dyn Fn(&str, f32) -> f32 + Send + Sync;

/// A client of the relay.
struct Client {
    /// The socket towards the simulator.
    socket: UdpSocket,
    /// The dataref of each index that it subscribed to.
    paths: Mutex<HashMap<i32, String>>,
}

/// Starts a relay; returns its address. It ends with the test's runtime.
pub async fn altered(
    simulator: SocketAddr,
    change: impl Fn(&str, f32) -> f32 + Send + Sync + 'static,
) -> SocketAddr {
    let relay = Arc::new(UdpSocket::bind("127.0.0.1:0").await.expect("a free port"));
    let address = relay.local_addr().expect("it is bound");
    tokio::spawn(run(relay, simulator, Arc::new(change)));
    address
}

async fn run(relay: Arc<UdpSocket>, simulator: SocketAddr, change: Arc<Change>) {
    let mut clients: HashMap<SocketAddr, Arc<Client>> = HashMap::new();
    let mut buffer = vec![0; 65_536];
    // Reports the port of a client that has gone.
    loop {
        let Ok((length, from)) = relay.recv_from(&mut buffer).await else {
            continue;
        };
        let client = match clients.get(&from) {
            Some(client) => client.clone(),
            None => {
                let socket = UdpSocket::bind("127.0.0.1:0").await.expect("a free port");
                let paths = Mutex::default();
                let client = Arc::new(Client { socket, paths });
                clients.insert(from, client.clone());
                tokio::spawn(answers(relay.clone(), client.clone(), from, change.clone()));
                client
            }
        };
        let datagram = &buffer[..length];
        if let Ok(ToSimulator::SubscribeDataref(request)) = ToSimulator::decode(datagram)
            && !request.is_end()
        {
            let mut paths = client.paths.lock().expect("nobody panics with it");
            paths.insert(request.index, request.path);
        }
        let _ = client.socket.send_to(datagram, simulator).await;
    }
}

/// Passes the simulator's datagrams on to a client.
async fn answers(relay: Arc<UdpSocket>, client: Arc<Client>, to: SocketAddr, change: Arc<Change>) {
    let mut buffer = vec![0; 65_536];
    loop {
        let Ok(length) = client.socket.recv(&mut buffer).await else {
            continue;
        };
        let mut datagram = buffer[..length].to_vec();
        if let Ok(values) = DatarefValuesView::new(&buffer[..length]) {
            let paths = client.paths.lock().expect("nobody panics with it").clone();
            let altered = values
                .iter()
                .map(|DatarefValue { index, value }| DatarefValue {
                    index,
                    value: paths.get(&index).map_or(value, |path| change(path, value)),
                });
            let altered = DatarefValues {
                values: altered.collect(),
            };
            let altered = FromSimulator::DatarefValues(altered);
            datagram = altered.encode().expect("it was as long before");
        }
        let _ = relay.send_to(&datagram, to).await;
    }
}
