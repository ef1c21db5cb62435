//! Datarefs that stay subscribed, even if the simulator restarts.
//!
//! Input: an address, names, a rate. Output: the newest value of each and its arrival time. A separate task sends requests in
//! batches that X-Plane accepts, repeats lost ones, and subscribes again when values stop, since nothing survives a restart of the
//! simulator. Dropping a subscription ends it there: a leaked one would be sent forever.

mod requested;

use std::net::SocketAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::net::UdpSocket;
use tokio::sync::watch;
use tokio::task::JoinHandle;
use tokio::time::{Instant, sleep, timeout_at};

use crate::error::BridgeError;
use crate::packet::{DatarefValuesView, SubscribeDataref, ToSimulator};
use crate::udp_socket::{is_refused, open};
use requested::RequestedDatarefs;

/// Requests per batch. X-Plane handles about 140 in one of its frames and loses the others silently.
pub(crate) const BATCH: usize = 100;
/// Time between batches: X-Plane draws several frames in it.
pub(crate) const BATCH_PAUSE: Duration = Duration::from_millis(100);
/// A simulator that is silent for this long has forgotten us, or is gone.
pub const SILENCE: Duration = Duration::from_millis(2_500);
/// How long to listen on exit for values of subscriptions whose end was lost.
const LEAVE_PAUSE: Duration = Duration::from_millis(60);

/// The newest value of a dataref.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// In X-Plane's unit.
    pub value: f32,
    /// When it came.
    pub at: Instant,
}

/// Datarefs that stay subscribed until this is dropped.
#[derive(Debug)]
pub struct Subscription {
    shared: Arc<Shared>,
    readings: watch::Receiver<Vec<Option<Reading>>>,
    task: JoinHandle<()>,
}

#[derive(Debug)]
struct Shared {
    socket: UdpSocket,
    address: SocketAddr,
    requested: Mutex<RequestedDatarefs>,
}

impl Subscription {
    /// Subscribes to `names` at the simulator that takes packets at `address`. Returns at once; values come as they come.
    ///
    /// # Errors
    /// No socket is available. A missing simulator is not an error: it may come.
    pub async fn start(
        address: SocketAddr,
        names: impl IntoIterator<Item = String>,
        frequency_hz: i32,
    ) -> Result<Self, BridgeError> {
        let requested = RequestedDatarefs::new(names, frequency_hz);
        let (sender, readings) = watch::channel(requested.readings().to_vec());
        let shared = Arc::new(Shared {
            socket: open(address).await?,
            address,
            requested: Mutex::new(requested),
        });
        Ok(Self::keeping(shared, sender, readings))
    }

    /// Not `async`: what it spawns is compiled here, not by every caller.
    fn keeping(
        shared: Arc<Shared>,
        sender: watch::Sender<Vec<Option<Reading>>>,
        readings: watch::Receiver<Vec<Option<Reading>>>,
    ) -> Self {
        Self {
            task: tokio::spawn(keep(shared.clone(), sender)),
            shared,
            readings,
        }
    }

    /// The newest values, in the order of the names; `None` for those that have not arrived yet.
    pub fn readings(&self) -> Vec<Option<Reading>> {
        self.readings.borrow().clone()
    }

    /// Whether values changed since the last call. Cheap.
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

    /// Ends it, and listens for a moment whether something still arrives. Dropping ends it, too, but does not listen.
    pub async fn end(self) {
        self.task.abort();
        self.shared.say_end();
        let until = Instant::now() + LEAVE_PAUSE;
        let mut buffer = [0; 2048];
        while let Ok(received) = timeout_at(until, self.shared.socket.recv(&mut buffer)).await {
            match received {
                Ok(length) => {
                    for value in DatarefValuesView::new(&buffer[..length])
                        .into_iter()
                        .flat_map(DatarefValuesView::iter)
                    {
                        self.shared.send_now(&end_of(value.index));
                    }
                }
                Err(_) => return,
            }
        }
    }
}

impl Drop for Subscription {
    fn drop(&mut self) {
        self.task.abort();
        self.shared.say_end();
    }
}

impl Shared {
    fn requested(&self) -> MutexGuard<'_, RequestedDatarefs> {
        self.requested
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    /// Ends everything that was ever requested. Once is enough.
    fn say_end(&self) {
        for index in self.requested().end() {
            self.send_now(&end_of(index));
        }
    }

    /// Waits until the socket is writable. (A fresh one is not known to be, so that trying at once would lose everything.)
    async fn send(&self, request: SubscribeDataref) {
        if let Ok(datagram) = ToSimulator::SubscribeDataref(request).encode() {
            let _ = self.socket.send(&datagram).await;
        }
    }

    fn send_now(&self, request: &SubscribeDataref) {
        if let Ok(datagram) = ToSimulator::SubscribeDataref(request.clone()).encode() {
            let _ = self.socket.try_send(&datagram);
        }
    }
}

/// Sends and listens until it is aborted.
async fn keep(shared: Arc<Shared>, readings: watch::Sender<Vec<Option<Reading>>>) {
    let mut buffer = [0; 2048];
    loop {
        let (due, wake_at) = {
            let mut requested = shared.requested();
            let now = Instant::now();
            (requested.due(now), requested.wake_at(now))
        };
        for request in due {
            shared.send(request).await;
        }
        let length = match timeout_at(wake_at, shared.socket.recv(&mut buffer)).await {
            Err(_) => continue,
            Ok(Ok(length)) => length,
            Ok(Err(error)) => {
                // "Connection refused" answers an earlier datagram: nobody listens, perhaps not yet.
                if !is_refused(&error) {
                    tracing::warn!(address = %shared.address, %error, "subscription");
                }
                sleep(BATCH_PAUSE).await;
                continue;
            }
        };
        match DatarefValuesView::new(&buffer[..length]) {
            Ok(values) => {
                let now = Instant::now();
                let mut requested = shared.requested();
                for value in values.iter() {
                    if !requested.take(value, now) {
                        shared.send_now(&end_of(value.index));
                    }
                }
                readings.send_replace(requested.readings().to_vec());
            }
            Err(error) => tracing::debug!(address = %shared.address, %error, "datagram ignored"),
        }
    }
}

/// What ends a subscription by its number alone.
pub(crate) fn end_of(index: i32) -> SubscribeDataref {
    SubscribeDataref {
        frequency_hz: 0,
        index,
        path: String::new(),
    }
}
