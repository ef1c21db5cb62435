//! Announcing the stand-in once a second, as X-Plane does. Not every network takes multicast: then we say so and go on.

use std::net::IpAddr;
use std::time::Duration;

use tokio::net::UdpSocket;
use tokio::time::interval;
use xplane_bridge::packet::{BEACON_GROUP, BEACON_PORT, Beacon, FromSimulator};

use super::{MockError, VERSION};

/// Sends the beacon for ever.
pub(super) async fn run(bind: IpAddr, port: u16) -> Result<(), MockError> {
    let failed = |source| MockError::Socket {
        what: "the beacon",
        source,
    };
    // Clients demand a name, though X-Plane 12 may send none.
    let beacon = Beacon {
        version: VERSION,
        port,
        name: Some("dtd-mock-xplane".into()),
        raknet_port: Some(port),
        ..Beacon::default()
    };
    let datagram = FromSimulator::Beacon(beacon)
        .encode()
        .map_err(|error| MockError::Stopped(error.to_string()))?;
    // From the address that we listen on: clients take the simulator's address from the sender.
    let socket = UdpSocket::bind((bind, 0)).await.map_err(failed)?;
    let mut warned = false;
    let mut every_second = interval(Duration::from_secs(1));
    loop {
        every_second.tick().await;
        match socket.send_to(&datagram, (BEACON_GROUP, BEACON_PORT)).await {
            Ok(_) => warned = false,
            Err(error) if !warned => {
                tracing::warn!(%error, "cannot send the beacon; clients must be told the address");
                warned = true;
            }
            Err(_) => {}
        }
    }
}
