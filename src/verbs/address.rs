//! `--sim` of verbs that connect to a running simulator.

use std::net::{SocketAddr, ToSocketAddrs};

use crate::failure::Failure;

/// The simulator's address (a host name's first IPv4 address, where X-Plane listens); `None` with `auto`,
/// for the one that announces itself.
pub(super) fn simulator(text: &str) -> Result<Option<SocketAddr>, Failure> {
    if text == "auto" {
        return Ok(None);
    }
    let refused = |why: String| {
        Failure::bad_input_message(format!(
            "--sim {text:?} is neither `auto` nor HOST:PORT, e.g. 127.0.0.1:49000: {why}"
        ))
    };
    let found: Vec<SocketAddr> = match text.to_socket_addrs() {
        Ok(found) => found.collect(),
        Err(error) => return Err(refused(error.to_string())),
    };
    let first = found.iter().find(|address| address.is_ipv4());
    match first.or(found.first()) {
        Some(&address) => Ok(Some(address)),
        None => Err(refused("it has no address".into())),
    }
}
