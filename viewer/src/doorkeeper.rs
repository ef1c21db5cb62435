//! Allowed callers: this page, and programs of this computer.
//!
//! The server listens on the loopback address only. A foreign web page can reach that through the browser of whoever opens it: by a
//! direct request, which `Origin` reveals, or by a host name that resolves to this computer, which `Host` reveals.

use std::net::SocketAddr;
use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::header::{
    CACHE_CONTROL, CONTENT_SECURITY_POLICY, HOST, HeaderName, HeaderValue, ORIGIN, REFERRER_POLICY,
    X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderMap, Method, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use crate::refusal::Refusal;

/// The page uses its own files alone.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; media-src 'self'; \
                      connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// The names under which the page may be asked for.
#[derive(Debug)]
pub(crate) struct OwnNames(Vec<String>);

impl OwnNames {
    pub(crate) fn of(address: SocketAddr) -> Self {
        Self(vec![
            address.to_string(),
            format!("localhost:{}", address.port()),
        ])
    }

    /// Rejects a request that was not addressed to this server, or that another page makes.
    fn check(&self, headers: &HeaderMap) -> Result<(), Refusal> {
        let is_own = |text: &str| self.0.iter().any(|own| own.eq_ignore_ascii_case(text));
        let mut hosts = headers.get_all(HOST).iter().map(text_of);
        if !(hosts.next().is_some_and(is_own) && hosts.next().is_none()) {
            return Err(self.refused(&HOST));
        }
        let mut origins = headers.get_all(ORIGIN).iter().map(text_of);
        match origins.all(|origin| origin.strip_prefix("http://").is_some_and(is_own)) {
            true => Ok(()),
            false => Err(self.refused(&ORIGIN)),
        }
    }

    fn refused(&self, name: &HeaderName) -> Refusal {
        let known = self.0.join(" or ");
        Refusal::forbidden(format!(
            "the header {name} is missing or names someone else, expected {known}"
        ))
    }
}

fn text_of(value: &HeaderValue) -> &str {
    value.to_str().unwrap_or_default()
}

/// Lets requests of the page pass, and adds what protects the page to their answers.
pub(crate) async fn guard(
    State(names): State<Arc<OwnNames>>,
    request: Request,
    next: Next,
) -> Response {
    let is_reading = [Method::GET, Method::HEAD].contains(request.method());
    let mut response = match names.check(request.headers()) {
        Err(refusal) => refusal.into_response(),
        Ok(()) if !is_reading => {
            let message = "this page can only be read, with GET or HEAD";
            Refusal::new(StatusCode::METHOD_NOT_ALLOWED, message).into_response()
        }
        Ok(()) => next.run(request).await,
    };
    let headers = response.headers_mut();
    for (name, value) in [
        (CONTENT_SECURITY_POLICY, POLICY),
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
        let names = OwnNames::of("127.0.0.1:4180".parse().unwrap());
        let headers = |pairs: &[(HeaderName, &str)]| -> HeaderMap {
            let parsed = pairs
                .iter()
                .map(|(name, value)| (name.clone(), value.parse().unwrap()));
            parsed.collect()
        };
        for own in ["127.0.0.1:4180", "localhost:4180", "LOCALHOST:4180"] {
            let origin = format!("http://{own}");
            assert!(names.check(&headers(&[(HOST, own)])).is_ok(), "{own}");
            let both = headers(&[(HOST, own), (ORIGIN, &origin)]);
            assert!(names.check(&both).is_ok(), "{own}");
        }
        for host in [
            "evil.example:4180",
            "127.0.0.1",
            "127.0.0.1:80",
            "localhost.evil.example:4180",
            "127.0.0.1:4180.evil.example",
        ] {
            assert!(names.check(&headers(&[(HOST, host)])).is_err(), "{host}");
        }
        for origin in ["null", "http://localhost:3000", "https://localhost:4180"] {
            let both = headers(&[(HOST, "localhost:4180"), (ORIGIN, origin)]);
            assert!(names.check(&both).is_err(), "{origin}");
        }
        assert!(names.check(&HeaderMap::new()).is_err());
    }
}
