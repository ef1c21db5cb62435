//! Allowed callers: this page, and programs of this computer.
//!
//! The server listens on the loopback address only. A foreign web page can reach that through the browser that opens it: by a
//! direct request, which `Origin` reveals, or by its own host name, made to resolve to this computer (DNS rebinding), which `Host`
//! reveals.

use std::net::Ipv4Addr;

use axum::extract::{Request, State};
use axum::http::header::{
    ACCEPT, CACHE_CONTROL, CONTENT_SECURITY_POLICY, HOST, HeaderName, HeaderValue, ORIGIN,
    REFERRER_POLICY, X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderMap, Method, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use crate::server::refusal::Refusal;
use crate::server::refusal_page;

/// The page uses its own files alone.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; media-src 'self'; \
                      connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
/// A page that explains a refusal is one file with its style: under a foreign name it gets no other.
const REFUSAL_POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Rejects requests for a foreign host name or from a foreign page.
fn check(headers: &HeaderMap) -> Result<(), Refusal> {
    let mut hosts = headers.get_all(HOST).iter().map(text_of);
    let (Some(host), None) = (hosts.next(), hosts.next()) else {
        return Err(Refusal::forbidden(
            "the request has no header host, or several; expected localhost or 127.0.0.1",
        ));
    };
    if !is_this_computer(host) {
        return Err(Refusal::forbidden(format!(
            "the request is addressed to {host}, expected localhost or 127.0.0.1"
        )));
    }
    let is_own = |origin: &str| {
        let from = origin.strip_prefix("http://");
        from.is_some_and(|from| from.eq_ignore_ascii_case(host))
    };
    let mut origins = headers.get_all(ORIGIN).iter().map(text_of);
    match origins.find(|origin| !is_own(origin)) {
        None => Ok(()),
        Some(origin) => Err(Refusal::forbidden(format!(
            "the request comes from a page at {origin}, expected http://{host}"
        ))),
    }
}

/// True for a `Host` that names the loopback device, with any port: a tunnel such as `ssh -L` may use a different one. No foreign page has
/// such a name, whatever its DNS server answers.
fn is_this_computer(host: &str) -> bool {
    let name = match host.rsplit_once(':') {
        Some((name, port)) if port.parse::<u16>().is_ok() => name,
        _ => host,
    };
    let is_loopback = |address: Ipv4Addr| address.is_loopback();
    name.eq_ignore_ascii_case("localhost") || name == "[::1]" || name.parse().is_ok_and(is_loopback)
}

fn text_of(value: &HeaderValue) -> &str {
    value.to_str().unwrap_or_default()
}

/// True if a browser opened this address, so that a person reads the answer.
fn is_navigation(headers: &HeaderMap) -> bool {
    let mut accepted = headers.get_all(ACCEPT).iter().map(text_of);
    accepted.any(|accepted| accepted.contains("text/html"))
}

/// Lets requests of the page pass, and adds what protects the page to their answers. Refusals are pages where a person reads them.
/// `port` is the server's.
pub(crate) async fn guard(State(port): State<u16>, request: Request, next: Next) -> Response {
    let is_reading = [Method::GET, Method::HEAD].contains(request.method());
    let is_navigation = is_navigation(request.headers());
    let mut response = match check(request.headers()) {
        Err(refusal) => refusal.into_response(),
        Ok(()) if !is_reading => {
            let message = "this page can only be read, with GET or HEAD";
            Refusal::new(StatusCode::METHOD_NOT_ALLOWED, message).into_response()
        }
        Ok(()) => next.run(request).await,
    };
    let mut policy = POLICY;
    if is_navigation && let Some(refusal) = response.extensions_mut().remove::<Refusal>() {
        response = refusal_page::answer(&refusal, port);
        policy = REFUSAL_POLICY;
    }
    let headers = response.headers_mut();
    for (name, value) in [
        (CONTENT_SECURITY_POLICY, policy),
        (X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (REFERRER_POLICY, "no-referrer"),
        (CACHE_CONTROL, "no-store"),
        (
            HeaderName::from_static("cross-origin-resource-policy"),
            "same-origin",
        ),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    response
}

#[cfg(test)]
mod tests {
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
            assert!(check(&headers(&[(HOST, own)])).is_ok(), "{own}");
            let both = headers(&[(HOST, own), (ORIGIN, &origin)]);
            assert!(check(&both).is_ok(), "{own}");
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
            assert!(check(&headers(&[(HOST, host)])).is_err(), "{host}");
        }
        let mut twice = headers(&[(HOST, "evil.example")]);
        twice.append(HOST, HeaderValue::from_static("localhost:4180"));
        assert!(check(&twice).is_err());
        for origin in [
            "null",
            "http://localhost:3000",
            "https://localhost:4180",
            "http://127.0.0.1:4180",
        ] {
            let both = headers(&[(HOST, "localhost:4180"), (ORIGIN, origin)]);
            assert!(check(&both).is_err(), "{origin}");
        }
        assert!(check(&HeaderMap::new()).is_err());
    }
}
