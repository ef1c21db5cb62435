//! Recognises a simulator on this computer that does not answer because it is still starting.

use std::fs;
use std::io::ErrorKind;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::time::Duration;

/// Time for the system to report that nothing holds a port.
const REPORTED_WITHIN: Duration = Duration::from_millis(200);
/// How the names of X-Plane's processes begin.
const PROCESS: &str = "X-Plane";

/// True if something holds a UDP port of this computer, although it may not answer.
pub(super) fn holds_port(address: SocketAddr) -> bool {
    let asked = || {
        let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
        socket.connect(address)?;
        socket.set_read_timeout(Some(REPORTED_WITHIN))?;
        // X-Plane's request for its position, no times a second.
        socket.send(b"RPOS\x000\0")?;
        socket.recv(&mut [0; 64])
    };
    match asked() {
        Ok(_) => true,
        Err(error) => matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut),
    }
}

/// True if a process on this computer has X-Plane's name; only Linux lists them as files.
pub(super) fn has_process() -> bool {
    let processes = fs::read_dir("/proc").into_iter().flatten().flatten();
    processes
        .filter_map(|process| fs::read_to_string(process.path().join("comm")).ok())
        .any(|name| name.starts_with(PROCESS))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_is_held_as_long_as_its_socket_lives() {
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let address = socket.local_addr().unwrap();
        assert!(holds_port(address));
        drop(socket);
        assert!(!holds_port(address));
    }
}
