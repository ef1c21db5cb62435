//! Simulator addresses: the target of packets, and the recognition of answers.
//!
//! X-Plane receives on one UDP port (49000) and sends from a second one ("Port we send from (legacy)" in its network settings, 49001 by
//! default). So an answer is recognised by its IP address alone.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};

/// The address to send to for one that a user names. The unspecified address (0.0.0.0, ::), on which a simulator of this computer may
/// listen, becomes the loopback one, since not every system can send to it; an IPv4 address in IPv6 form becomes a plain one.
pub fn reachable(address: SocketAddr) -> SocketAddr {
    let ip = match address.ip().to_canonical() {
        IpAddr::V4(ip) if ip.is_unspecified() => Ipv4Addr::LOCALHOST.into(),
        IpAddr::V6(ip) if ip.is_unspecified() => Ipv6Addr::LOCALHOST.into(),
        ip if ip == address.ip() => return address,
        ip => ip,
    };
    SocketAddr::new(ip, address.port())
}

/// True if a datagram from this address comes from the simulator at `simulator`. A local simulator may answer from a different loopback
/// address than the given one.
pub fn is_answer(simulator: SocketAddr, from: SocketAddr) -> bool {
    let (simulator, from) = (simulator.ip().to_canonical(), from.ip().to_canonical());
    from == simulator || from.is_loopback() && simulator.is_loopback()
}

/// Local address of a socket for the simulator at `simulator`. Sockets for local simulators cannot be reached by other computers.
pub fn local_address(simulator: SocketAddr, port: u16) -> SocketAddr {
    let ip: IpAddr = match simulator {
        SocketAddr::V4(address) if address.ip().is_loopback() => Ipv4Addr::LOCALHOST.into(),
        SocketAddr::V6(address) if address.ip().is_loopback() => Ipv6Addr::LOCALHOST.into(),
        SocketAddr::V4(_) => Ipv4Addr::UNSPECIFIED.into(),
        SocketAddr::V6(_) => Ipv6Addr::UNSPECIFIED.into(),
    };
    SocketAddr::new(ip, port)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn address(text: &str) -> SocketAddr {
        text.parse().unwrap()
    }

    #[test]
    fn an_address_that_cannot_be_sent_to_becomes_one_that_can() {
        for (named, sent_to) in [
            ("0.0.0.0:49000", "127.0.0.1:49000"),
            ("[::]:49000", "[::1]:49000"),
            ("[::ffff:10.0.0.5]:49000", "10.0.0.5:49000"),
            ("[::ffff:0.0.0.0]:49000", "127.0.0.1:49000"),
            ("10.0.0.5:49000", "10.0.0.5:49000"),
            ("[fe80::1%3]:49000", "[fe80::1%3]:49000"),
        ] {
            assert_eq!(reachable(address(named)), address(sent_to), "{named}");
        }
    }

    #[test]
    fn an_answer_comes_from_any_port_of_the_simulator_and_from_no_other_computer() {
        let answers = [
            ("10.0.0.5:49000", "10.0.0.5:49001"),
            ("10.0.0.5:49000", "[::ffff:10.0.0.5]:49001"),
            ("127.0.0.2:49000", "127.0.0.1:49001"),
            ("[fe80::1]:49000", "[fe80::1%3]:49001"),
        ];
        for (simulator, from) in answers {
            assert!(is_answer(address(simulator), address(from)), "{from}");
        }
        for (simulator, from) in [
            ("10.0.0.5:49000", "10.0.0.6:49000"),
            ("10.0.0.5:49000", "127.0.0.1:49000"),
            ("127.0.0.1:49000", "10.0.0.5:49000"),
        ] {
            assert!(!is_answer(address(simulator), address(from)), "{from}");
        }
    }

    #[test]
    fn only_a_simulator_of_another_computer_opens_a_socket_to_the_network() {
        for (simulator, local) in [
            ("127.0.0.1:49000", "127.0.0.1:7"),
            ("[::1]:49000", "[::1]:7"),
            ("10.0.0.5:49000", "0.0.0.0:7"),
            ("[fe80::1]:49000", "[::]:7"),
        ] {
            assert_eq!(local_address(address(simulator), 7), address(local));
        }
    }
}
