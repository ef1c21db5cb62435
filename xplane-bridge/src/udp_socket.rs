//! A UDP socket towards a simulator.

use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr};

use tokio::net::UdpSocket;

use crate::error::BridgeError;

/// Opens a socket that talks only to this address. Sends nothing yet.
pub(crate) async fn open(address: SocketAddr) -> Result<UdpSocket, BridgeError> {
    let any: SocketAddr = match address {
        SocketAddr::V4(_) => (Ipv4Addr::UNSPECIFIED, 0).into(),
        SocketAddr::V6(_) => (Ipv6Addr::UNSPECIFIED, 0).into(),
    };
    let open = async {
        let socket = UdpSocket::bind(any).await?;
        socket.connect(address).await?;
        Ok(socket)
    };
    open.await
        .map_err(|source| BridgeError::Udp { address, source })
}

/// Whether an error is only the answer to an earlier datagram: nobody listens, perhaps not yet.
pub(crate) fn is_refused(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        io::ErrorKind::ConnectionRefused | io::ErrorKind::ConnectionReset
    )
}
