//! `HOST:PORT` as people write it.

use std::net::{SocketAddr, ToSocketAddrs};

use crate::failure::Failure;

/// The address of a simulator; of a name with several, the first of IPv4, on which X-Plane listens.
pub(super) fn address(text: &str) -> Result<SocketAddr, Failure> {
    let refused = |why: String| {
        Failure::bad_input_message(format!(
            "--sim {text:?} is no HOST:PORT, e.g. 127.0.0.1:49000: {why}"
        ))
    };
    let found: Vec<SocketAddr> = match text.to_socket_addrs() {
        Ok(found) => found.collect(),
        Err(error) => return Err(refused(error.to_string())),
    };
    let first = found.iter().find(|address| address.is_ipv4());
    first
        .or(found.first())
        .copied()
        .ok_or_else(|| refused("it has no address".into()))
}
