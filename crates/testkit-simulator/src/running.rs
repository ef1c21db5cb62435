//! Stand-ins in this process.

use std::net::SocketAddr;
use std::sync::Arc;

use mock_xplane::server::{Addresses, BuiltIn, Engine, ServerOptions, serve_with};
use tokio::sync::oneshot;
use tokio::task::AbortHandle;

/// Free ports and no beacon.
pub fn quiet() -> ServerOptions {
    ServerOptions {
        port: 0,
        beacon: false,
        ..ServerOptions::default()
    }
}

/// A stand-in that ends with this value.
#[derive(Debug)]
pub struct Running {
    /// Where it listens.
    pub addresses: Addresses,
    server: AbortHandle,
}

impl Running {
    /// Starts one with the built-in engine; returns once it listens.
    pub async fn start(options: ServerOptions) -> Self {
        Self::start_with(options, Arc::new(BuiltIn)).await
    }

    /// The same with another engine.
    pub async fn start_with(options: ServerOptions, engine: Arc<dyn Engine>) -> Self {
        let (addresses, server) = serving_with(options, engine).await;
        Self { addresses, server }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.server.abort();
    }
}

/// The UDP address of a stand-in with the built-in engine that ends with the test's runtime.
pub async fn serving(options: ServerOptions) -> SocketAddr {
    serving_with(options, Arc::new(BuiltIn)).await.0.udp
}

/// The addresses of one with another engine, and a way to make it disappear earlier.
pub async fn serving_with(
    options: ServerOptions,
    engine: Arc<dyn Engine>,
) -> (Addresses, AbortHandle) {
    let (tell, told) = oneshot::channel();
    let server = tokio::spawn(async move {
        let ready = |addresses| tell.send(addresses).expect("the test waits for it");
        serve_with(options, engine, ready)
            .await
            .expect("a stand-in serves until it is aborted");
    });
    let addresses = told.await.expect("it listens");
    (addresses, server.abort_handle())
}
