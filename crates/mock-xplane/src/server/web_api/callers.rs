//! Allowed callers: programs and web pages of this computer.
//!
//! The Web API listens on the loopback address only. A foreign web page can reach that through the browser that opens it: by
//! a direct request, which `Origin` reveals, or by a host name that resolves to this computer, which `Host` reveals.

use axum::http::HeaderMap;
use axum::http::header::{HOST, HeaderName, ORIGIN};
use doorway::is_this_computer;

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
