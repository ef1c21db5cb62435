//! Announces the stand-in once a second, as X-Plane does. If the network does not support multicast, this is logged and everything
//! else continues.

use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

use tokio::net::UdpSocket;
use tokio::time::interval;
use xplane_bridge::packet::{BEACON_GROUP, BEACON_PORT, Beacon, FromSimulator};

use super::MockError;
use super::faults::outages::Outages;

/// X-Plane's value here. No server listens there; but one client takes its first byte, `r`, for the end of the name.
pub(super) const RAKNET_PORT: u16 = 49_010;

/// Sends the beacon forever.
pub(super) async fn run(
    bind: IpAddr,
    beacon: Beacon,
    outages: Arc<Outages>,
) -> Result<(), MockError> {
    let datagram = FromSimulator::Beacon(beacon)
        .encode()
        .map_err(|error| MockError::Stopped(error.to_string()))?;
    // From the address that we listen on: clients take the simulator's address from the sender.
    let socket = UdpSocket::bind((bind, 0))
        .await
        .map_err(|source| MockError::Socket {
            what: "the beacon",
            source,
        })?;
    let group = SocketAddr::from((BEACON_GROUP, BEACON_PORT));
    let mut warned = false;
    let mut every_second = interval(Duration::from_secs(1));
    loop {
        every_second.tick().await;
        outages.over().await;
        match socket.send_to(&datagram, group).await {
            Ok(_) => warned = false,
            Err(error) if !warned => {
                tracing::warn!(%error, "cannot send the beacon; clients must be told the address");
                warned = true;
            }
            Err(_) => {}
        }
    }
}
