//! Datarefs that stay subscribed, even if the simulator restarts.
//!
//! Input: an address, names, a rate. Output: the newest value of each and its arrival time. A separate task sends requests in batches that
//! X-Plane accepts, repeats lost ones, and subscribes again when values stop, since subscriptions do not survive a restart of the
//! simulator. Dropping a subscription ends it there: a leaked one would be sent forever.

mod requested;

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::watch;
use tokio::task::JoinHandle;
use tokio::time::{Instant, timeout_at};

use crate::error::BridgeError;
use crate::packet::ToSimulator;
use crate::udp::socket::{Claim, LocalUdp, SimulatorSocket};
use requested::RequestedDatarefs;

/// Requests per batch. X-Plane handles about 140 per frame and loses the others silently.
pub(crate) const BATCH: usize = 100;
/// Time between batches: X-Plane draws several frames in it.
pub(crate) const BATCH_PAUSE: Duration = Duration::from_millis(100);
/// A simulator that is silent for this long has forgotten us, or is gone.
pub const SILENCE: Duration = Duration::from_millis(2_500);

/// Newest value of a dataref.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Value in X-Plane's unit.
    pub value: f32,
    /// Time of arrival.
    pub at: Instant,
}

/// Datarefs that stay subscribed until this is dropped.
#[derive(Debug)]
pub struct Subscription {
    socket: Arc<SimulatorSocket>,
    readings: watch::Receiver<Vec<Option<Reading>>>,
    task: JoinHandle<()>,
}

impl Subscription {
    /// Subscribes to `names` at the simulator that takes packets at `address`, on a separate socket. Returns at once; values come as they
    /// come.
    ///
    /// # Errors
    /// No socket is available. A missing simulator is not an error: it may come.
    pub async fn start(
        address: SocketAddr,
        names: impl IntoIterator<Item = String>,
        frequency_hz: i32,
    ) -> Result<Self, BridgeError> {
        let socket = SimulatorSocket::open(address, &LocalUdp::default()).await?;
        Ok(Self::on(&socket, names, frequency_hz))
    }

    /// [`Subscription::start`] on a socket that has other readers.
    pub(crate) fn on(
        socket: &Arc<SimulatorSocket>,
        names: impl IntoIterator<Item = String>,
        frequency_hz: i32,
    ) -> Self {
        let names: Vec<String> = names.into_iter().collect();
        let claim = socket.claim(names.len());
        let requested = RequestedDatarefs::new(names, frequency_hz, claim.first());
        let (sender, readings) = watch::channel(requested.readings().to_vec());
        Self {
            socket: socket.clone(),
            readings,
            task: tokio::spawn(keep(socket.clone(), requested, claim, sender)),
        }
    }

    /// The newest values, in the order of the names; `None` for those that have not arrived yet.
    pub fn readings(&self) -> Vec<Option<Reading>> {
        self.readings.borrow().clone()
    }

    /// True if values changed since the last call. Cheap.
    pub(crate) fn has_changed(&mut self) -> bool {
        let changed = self.readings.has_changed().unwrap_or(false);
        if changed {
            self.readings.mark_unchanged();
        }
        changed
    }

    /// Waits until values arrive. Cancel safe.
    pub async fn changed(&mut self) {
        // The task that sends lives as long as this.
        let _ = self.readings.changed().await;
    }

    /// Ends it, and listens for a moment for values that still arrive. Dropping it ends it without listening.
    pub async fn end(self) {
        let socket = self.socket.clone();
        drop(self);
        socket.close().await;
    }
}

impl Drop for Subscription {
    fn drop(&mut self) {
        // The task owns the claim, which ends what was requested.
        self.task.abort();
    }
}

/// Sends and listens until it is aborted.
async fn keep(
    socket: Arc<SimulatorSocket>,
    mut requested: RequestedDatarefs,
    mut claim: Claim,
    readings: watch::Sender<Vec<Option<Reading>>>,
) {
    loop {
        let now = Instant::now();
        for request in requested.due(now) {
            let request = ToSimulator::SubscribeDataref(request);
            if let Err(error) = socket.send(&request).await {
                tracing::debug!(%error, "not subscribed");
            }
        }
        let wake_at = requested.wake_at(now);
        let Ok(values) = timeout_at(wake_at, claim.values()).await else {
            continue;
        };
        let now = Instant::now();
        for value in values {
            requested.take(value, now);
        }
        readings.send_replace(requested.readings().to_vec());
    }
}
