//! Serves the metrics over HTTP, at `/metrics`.

use std::net::SocketAddr;
use std::sync::Arc;
use std::thread;

use axum::Router;
use axum::extract::Request;
use axum::http::StatusCode;
use axum::http::header::CONTENT_TYPE;
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use doorway::{check_caller, serve_http};
use tokio::net::TcpListener;
use tokio::runtime::Builder;

use crate::clock::RunClock;
use crate::error::{Error, Result};
use crate::output::metrics::Metrics;

const OPEN_METRICS: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// Serves until the process ends; returns the address.
pub(crate) fn serve(
    address: SocketAddr,
    metrics: Arc<Metrics>,
    clock: RunClock,
) -> Result<SocketAddr> {
    let refused = |source| Error::Metrics { address, source };
    let runtime = (Builder::new_current_thread().enable_all().build()).map_err(Error::Thread)?;
    let listener = (runtime.block_on(TcpListener::bind(address))).map_err(refused)?;
    let bound = listener.local_addr().map_err(refused)?;
    let text = move || {
        let text = metrics.text(clock.now_s());
        async move { ([(CONTENT_TYPE, OPEN_METRICS)], text) }
    };
    let mut router = Router::new().route("/metrics", get(text));
    // On other addresses, this computer has names that are not known here.
    if bound.ip().is_loopback() {
        router = router.layer(middleware::from_fn(refuse_others));
    }
    let serve = move || {
        runtime.block_on(async { match serve_http("metrics", &listener, router, false).await {} });
    };
    thread::Builder::new()
        .name("metrics".into())
        .spawn(serve)
        .map_err(Error::Thread)?;
    Ok(bound)
}

/// Refuses web pages that a browser of this computer shows.
async fn refuse_others(request: Request, next: Next) -> Response {
    match check_caller(request.headers()) {
        Ok(()) => next.run(request).await,
        Err(why) => (StatusCode::FORBIDDEN, why).into_response(),
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};
    use std::net::{Ipv4Addr, TcpStream};

    use super::*;

    #[test]
    fn a_foreign_page_reads_no_metrics() {
        let metrics = Arc::new(Metrics::new("hash".into(), &["left".into()]));
        let address = (Ipv4Addr::LOCALHOST, 0).into();
        let address = serve(address, metrics, RunClock::start()).unwrap();
        for (host, status) in [("localhost", 200), ("evil.example", 403)] {
            let mut stream = TcpStream::connect(address).unwrap();
            let head = format!("Host: {host}\r\nConnection: close");
            write!(stream, "GET /metrics HTTP/1.1\r\n{head}\r\n\r\n").unwrap();
            let mut answer = String::new();
            stream.read_to_string(&mut answer).unwrap();
            assert!(
                answer.starts_with(&format!("HTTP/1.1 {status}")),
                "{answer}"
            );
        }
    }
}
