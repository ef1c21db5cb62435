//! Serves the metrics over HTTP, at `/metrics`.

use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::thread;

use axum::Router;
use axum::http::header::CONTENT_TYPE;
use axum::routing::get;
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
    let listener = TcpListener::bind(address).map_err(refused)?;
    listener.set_nonblocking(true).map_err(refused)?;
    let bound = listener.local_addr().map_err(refused)?;
    let runtime = (Builder::new_current_thread().enable_all().build()).map_err(Error::Thread)?;
    let text = move || {
        let text = metrics.text(clock.now_s());
        async move { ([(CONTENT_TYPE, OPEN_METRICS)], text) }
    };
    let router = Router::new().route("/metrics", get(text));
    let serve = move || {
        runtime.block_on(async {
            let listener = tokio::net::TcpListener::from_std(listener)?;
            axum::serve(listener, router).await
        })
    };
    let logged = move || {
        if let Err(error) = serve() {
            tracing::warn!(%error, "metrics are not served any more");
        }
    };
    thread::Builder::new()
        .name("metrics".into())
        .spawn(logged)
        .map_err(Error::Thread)?;
    Ok(bound)
}
