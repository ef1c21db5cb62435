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
    /// Listening addresses.
    pub addresses: Addresses,
    server: AbortHandle,
}

impl Running {
    /// Starts one with the built-in engine; returns once it listens.
    pub async fn start(options: ServerOptions) -> Self {
        Self::start_with(options, Arc::new(BuiltIn)).await
    }

    /// [`Running::start`] with a different engine.
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

/// Starts a stand-in with the built-in engine, which ends with the test's runtime; returns its UDP address.
pub async fn serving(options: ServerOptions) -> SocketAddr {
    serving_with(options, Arc::new(BuiltIn)).await.0.udp
}

/// Starts a stand-in with any engine; returns its addresses and a handle to stop it earlier.
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
