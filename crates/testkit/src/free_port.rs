use std::net::{Ipv4Addr, UdpSocket};
use std::sync::atomic::{AtomicU16, Ordering};

/// Linux and macOS give sockets without a wanted port one from above: one from below stays free until it is asked for by number.
const PORTS: std::ops::Range<u16> = 20_000..32_000;

/// A UDP port of the loopback interface that is free, and stays so beside other tests with sockets of their own.
///
/// # Panics
///
/// If no port of the range is free.
pub fn free_udp_port() -> u16 {
    static NEXT: AtomicU16 = AtomicU16::new(0);
    let count = u32::from(PORTS.end - PORTS.start);
    for _ in 0..count {
        // Test programs that run at the same time begin at different ports.
        let next = u32::from(NEXT.fetch_add(1, Ordering::Relaxed));
        let offset = (std::process::id().wrapping_mul(61) + next) % count;
        let port = PORTS.start + u16::try_from(offset).expect("less than the range");
        if UdpSocket::bind((Ipv4Addr::LOCALHOST, port)).is_ok() {
            return port;
        }
    }
    panic!("no free UDP port from {} to {}", PORTS.start, PORTS.end - 1);
}
