//! Sockets for packets and for reports that come separately (UDP).

use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::time::Duration;

use socket2::{Domain, Socket, Type};

use super::link::{has_bytes, is_later};

/// Wait for a packet: shorter than the one for packets that are missing.
const WAIT: Duration = Duration::from_millis(20);
/// Bytes of the system's buffer: a key frame comes in a burst while an image is decoded.
const BUFFER_BYTES: usize = 4 << 20;
/// Attempts to find two neighbouring ports.
const ATTEMPTS: usize = 50;

pub(super) struct Sockets {
    packets: UdpSocket,
    reports: UdpSocket,
    /// Where packets may come from; anywhere if empty.
    sources: Vec<IpAddr>,
    buffer: Vec<u8>,
}

impl Sockets {
    /// Two free neighbouring ports of this computer's address, and the first one's number.
    pub(super) fn pair(own: IpAddr) -> io::Result<(Self, u16)> {
        let mut last = io::ErrorKind::AddrInUse.into();
        for _ in 0..ATTEMPTS {
            let port = UdpSocket::bind((own, 0))?.local_addr()?.port() & !1;
            match Self::at(own, port) {
                Ok(sockets) => return Ok((sockets, port)),
                Err(error) => last = error,
            }
        }
        Err(last)
    }

    /// Sockets for a stream that is sent to this address, of this computer or of a group.
    pub(super) fn receiving(address: Option<IpAddr>, port: u16) -> io::Result<Self> {
        let any = match address {
            Some(IpAddr::V6(_)) => IpAddr::V6(Ipv6Addr::UNSPECIFIED),
            _ => Ipv4Addr::UNSPECIFIED.into(),
        };
        let group = address.filter(IpAddr::is_multicast);
        let sockets = Self::at(group.unwrap_or(any), port)?;
        for socket in [&sockets.packets, &sockets.reports] {
            match group {
                Some(IpAddr::V4(group)) => {
                    socket.join_multicast_v4(&group, &Ipv4Addr::UNSPECIFIED)?;
                }
                Some(IpAddr::V6(group)) => socket.join_multicast_v6(&group, 0)?,
                None => {}
            }
        }
        Ok(sockets)
    }

    fn at(address: IpAddr, port: u16) -> io::Result<Self> {
        let socket = |port| {
            let address = SocketAddr::new(address, port);
            let socket = Socket::new(Domain::for_address(address), Type::DGRAM, None)?;
            if address.ip().is_multicast() {
                socket.set_reuse_address(true)?;
            }
            socket.set_recv_buffer_size(BUFFER_BYTES)?;
            socket.bind(&address.into())?;
            io::Result::Ok(UdpSocket::from(socket))
        };
        let (packets, reports) = (socket(port)?, socket(port.saturating_add(1))?);
        packets.set_read_timeout(Some(WAIT))?;
        reports.set_nonblocking(true)?;
        Ok(Self {
            packets,
            reports,
            sources: Vec::new(),
            buffer: vec![0; 1 << 16],
        })
    }

    /// Expects packets from these addresses only. Firewalls let them through after a packet to the server's ports.
    pub(super) fn expect(
        &mut self,
        sources: Vec<IpAddr>,
        ports: Option<[u16; 2]>,
    ) -> io::Result<()> {
        if let (Some([packets, reports]), Some(server)) = (ports, sources.first()) {
            // An empty packet and an empty report.
            self.packets
                .send_to(&[0x80, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0], (*server, packets))?;
            self.reports
                .send_to(&[0x80, 201, 0, 1, 0, 0, 0, 0], (*server, reports))?;
        }
        self.sources = sources;
        Ok(())
    }

    /// True if a packet has come that is not read yet.
    pub(super) fn has_packet(&self) -> bool {
        has_bytes(&self.packets)
    }

    /// The next packet; `None` if none comes.
    pub(super) fn packet(&mut self) -> io::Result<Option<Vec<u8>>> {
        receive(&self.packets, &self.sources, &mut self.buffer)
    }

    /// A report that has come.
    pub(super) fn report(&mut self) -> io::Result<Option<Vec<u8>>> {
        receive(&self.reports, &self.sources, &mut self.buffer)
    }
}

fn receive(
    socket: &UdpSocket,
    sources: &[IpAddr],
    buffer: &mut [u8],
) -> io::Result<Option<Vec<u8>>> {
    match socket.recv_from(buffer) {
        Ok((bytes, from)) if sources.is_empty() || sources.contains(&from.ip()) => {
            Ok(Some(buffer[..bytes].into()))
        }
        Ok(_) => Ok(None),
        // The server has no such port yet, or no more.
        Err(error) if is_later(&error) || error.kind() == io::ErrorKind::ConnectionRefused => {
            Ok(None)
        }
        Err(error) => Err(error),
    }
}
