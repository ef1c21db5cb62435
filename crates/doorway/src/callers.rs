//! Allowed callers of a server on the loopback address: its own page, and programs of this computer.
//!
//! A foreign web page can reach that address through the browser that opens it: by a direct request, which `Origin` reveals, or by its own
//! host name, made to resolve to this computer (DNS rebinding), which `Host` reveals.

use std::net::IpAddr;

use axum::http::HeaderMap;
use axum::http::header::{HOST, HeaderValue, ORIGIN};

/// Rejects requests for a foreign host name or from a foreign page.
///
/// # Errors
/// The expected and the found value.
pub fn check_caller(headers: &HeaderMap) -> Result<(), String> {
    let mut hosts = headers.get_all(HOST).iter().map(text_of);
    let (Some(host), None) = (hosts.next(), hosts.next()) else {
        return Err(
            "the request has no header host, or several; expected localhost or 127.0.0.1".into(),
        );
    };
    if !is_this_computer(host) {
        return Err(format!(
            "the request is addressed to {host}, expected localhost or 127.0.0.1"
        ));
    }
    let is_own = |origin: &str| {
        let from = origin.strip_prefix("http://");
        from.is_some_and(|from| from.eq_ignore_ascii_case(host))
    };
    let mut origins = headers.get_all(ORIGIN).iter().map(text_of);
    match origins.find(|origin| !is_own(origin)) {
        None => Ok(()),
        Some(origin) => Err(format!(
            "the request comes from a page at {origin}, expected http://{host}"
        )),
    }
}

/// True if a host always means this computer, however it is resolved, with any port: a tunnel such as `ssh -L` may use another one.
pub fn is_this_computer(host: &str) -> bool {
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

fn text_of(value: &HeaderValue) -> &str {
    value.to_str().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderName;

    use super::*;

    #[test]
    fn a_page_from_elsewhere_is_refused_by_its_origin_or_by_its_name() {
        let headers = |pairs: &[(HeaderName, &str)]| -> HeaderMap {
            let parsed = pairs
                .iter()
                .map(|(name, value)| (name.clone(), value.parse().unwrap()));
            parsed.collect()
        };
        for own in [
            "127.0.0.1:4180",
            "localhost:4180",
            "LOCALHOST:4180",
            // Through a tunnel.
            "localhost:9000",
            "127.0.0.1:80",
            "[::1]:9000",
            "localhost",
        ] {
            let origin = format!("http://{own}");
            assert!(check_caller(&headers(&[(HOST, own)])).is_ok(), "{own}");
            let both = headers(&[(HOST, own), (ORIGIN, &origin)]);
            assert!(check_caller(&both).is_ok(), "{own}");
        }
        for host in [
            "",
            "evil.example:4180",
            "192.168.0.1:4180",
            "localhost.evil.example:4180",
            "127.0.0.1.evil.example",
            "127.0.0.1:4180.evil.example",
            "evil.example:4180@localhost",
            "localhost:4180:4180",
            "0.0.0.0:4180",
        ] {
            assert!(check_caller(&headers(&[(HOST, host)])).is_err(), "{host}");
        }
        let mut twice = headers(&[(HOST, "evil.example")]);
        twice.append(HOST, HeaderValue::from_static("localhost:4180"));
        assert!(check_caller(&twice).is_err());
        for origin in [
            "null",
            "http://localhost:3000",
            "https://localhost:4180",
            "http://127.0.0.1:4180",
        ] {
            let both = headers(&[(HOST, "localhost:4180"), (ORIGIN, origin)]);
            assert!(check_caller(&both).is_err(), "{origin}");
        }
        assert!(check_caller(&HeaderMap::new()).is_err());
    }
}
