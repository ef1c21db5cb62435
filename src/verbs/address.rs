//! `--sim` of verbs that talk to a simulator that runs already.

use std::net::{SocketAddr, ToSocketAddrs};

use crate::failure::Failure;

/// Which simulator is meant: the one at an address (of a name with several, the first of IPv4, on which X-Plane listens), or with
/// `auto` the one that announces itself, which is `None`.
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
