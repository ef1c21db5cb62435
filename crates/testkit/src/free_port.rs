use std::net::{Ipv4Addr, UdpSocket};
use std::sync::atomic::{AtomicU16, Ordering};

/// Linux and macOS give sockets without a wanted port one from above: one from below stays free until it is asked for by number.
const FIRST: u16 = 20_000;
const PAIRS: u16 = 6_000;

/// A UDP port of the loopback interface that is free, as is the next one, from which a stand-in answers. Both stay so beside other tests.
///
/// # Panics
///
/// If no such port is left.
pub fn free_udp_port() -> u16 {
    static NEXT: AtomicU16 = AtomicU16::new(0);
    for _ in 0..PAIRS {
        // Test programs that run at the same time begin at different ports.
        let next = u32::from(NEXT.fetch_add(1, Ordering::Relaxed));
        let pair = (std::process::id().wrapping_mul(61) + next) % u32::from(PAIRS);
        let port = FIRST + 2 * u16::try_from(pair).expect("less than PAIRS");
        if [port, port + 1].map(is_free) == [true, true] {
            return port;
        }
    }
    panic!("no free pair of UDP ports from {FIRST} on");
}

fn is_free(port: u16) -> bool {
    UdpSocket::bind((Ipv4Addr::LOCALHOST, port)).is_ok()
}
