//! Allowed callers: programs and web pages of this computer.
//!
//! The Web API listens on the loopback address only. A foreign web page can reach that through the browser that opens it: by
//! a direct request, which `Origin` reveals, or by a host name that resolves to this computer, which `Host` reveals.

use std::net::IpAddr;

use axum::http::HeaderMap;
use axum::http::header::{HOST, HeaderName, ORIGIN};

use super::refusal::Refusal;

/// Rejects a request that was not addressed to this computer, or that comes from a foreign web page.
pub(super) fn check(headers: &HeaderMap) -> Result<(), Refusal> {
    for name in [HOST, ORIGIN] {
        for value in headers.get_all(&name) {
            let text = value.to_str().unwrap_or("no text");
            let host = if name == ORIGIN {
                text.split_once("://").map(|(_scheme, host)| host)
            } else {
                Some(text)
            };
            if !host.is_some_and(is_this_computer) {
                return Err(refused(&name, text));
            }
        }
    }
    Ok(())
}

fn refused(name: &HeaderName, found: &str) -> Refusal {
    Refusal::forbidden(
        "foreign_caller",
        format!("{name} is {found:?}, expected localhost or 127.0.0.1"),
    )
}

/// True if a host, with or without a port, always means this computer, however it is resolved.
fn is_this_computer(host: &str) -> bool {
    let (name, port) = match host.strip_prefix('[') {
        Some(rest) => match rest.split_once(']') {
            Some((name, "")) => (name, None),
            Some((name, rest)) => match rest.strip_prefix(':') {
                Some(port) => (name, Some(port)),
                None => return false,
            },
            None => return false,
        },
        None => match host.split_once(':') {
            Some((name, port)) => (name, Some(port)),
            None => (host, None),
        },
    };
    let port_is_one = port.is_none_or(|port| port.parse::<u16>().is_ok());
    let loopback = name.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback());
    port_is_one && (loopback || name.eq_ignore_ascii_case("localhost"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_that_always_mean_this_computer_are_its_own() {
        for host in [
            "localhost",
            "LOCALHOST:8086",
            "127.0.0.1:8086",
            "127.1.2.3",
            "[::1]:8086",
            "[::1]",
        ] {
            assert!(is_this_computer(host), "{host}");
        }
        for host in [
            "",
            "evil.example",
            "localhost.evil.example",
            "127.0.0.1.evil.example:8086",
            "10.0.0.5:8086",
            "0.0.0.0",
            "localhost:evil",
            "[::1",
            "[::1]evil",
            "::1:80:80",
        ] {
            assert!(!is_this_computer(host), "{host}");
        }
    }
}
