//! Allowed requests: reading ones, of this page and of programs on this computer, since the server listens on the loopback address only.

use axum::extract::{Request, State};
use axum::http::header::{
    ACCEPT, CACHE_CONTROL, CONTENT_SECURITY_POLICY, HeaderName, HeaderValue, REFERRER_POLICY,
    X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderMap, Method, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use doorway::check_caller;

use crate::server::refusal::Refusal;
use crate::server::refusal_page;

/// The page uses its own files alone.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; media-src 'self'; \
                      connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
/// A page that explains a refusal is one file with its style: under a foreign name it gets no other.
const REFUSAL_POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

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
    let mut response = match check_caller(request.headers()) {
        Err(message) => Refusal::forbidden(message).into_response(),
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
