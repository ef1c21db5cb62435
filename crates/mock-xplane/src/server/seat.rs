//! The single place at the aircraft. Its client keeps it while active; a silent client must leave when the next one requests it.
//!
//! So a client may take all the time it needs between two requests (a commit to a slow store, a debugger), and one that hangs, or was never
//! more than an open connection, blocks no other.

use std::sync::{Arc, Mutex as StdMutex, PoisonError};
use std::time::Duration;

use tokio::sync::{Mutex, Notify, OwnedMutexGuard};
use tokio::time::{Instant, timeout};

/// Timeouts of the capture link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LinkPatience {
    /// Time from the connection to its greeting and complete hello.
    pub hello: Duration,
    /// Time that a client waits for the seat.
    pub seat: Duration,
    /// A client that neither sends requests nor reads answers for this long loses its seat to the next one.
    pub silence: Duration,
}

impl Default for LinkPatience {
    fn default() -> Self {
        Self {
            hello: Duration::from_secs(5),
            seat: Duration::from_secs(2),
            silence: Duration::from_secs(120),
        }
    }
}

/// The place.
#[derive(Debug, Default)]
pub(super) struct Seat {
    place: Arc<Mutex<()>>,
    holder: StdMutex<Option<Arc<Activity>>>,
}

/// The holder of the seat. Dropping it releases the seat.
#[derive(Debug)]
pub(super) struct Seated {
    pub(super) activity: Arc<Activity>,
    _place: OwnedMutexGuard<()>,
}

/// Time of the client's last sign of life.
#[derive(Debug)]
pub(super) struct Activity {
    state: StdMutex<State>,
    leave: Notify,
}

#[derive(Debug)]
struct State {
    /// Requests in progress: meanwhile the client waits for us, not we for it.
    working: usize,
    last: Instant,
}

/// A request in progress, until this is dropped.
pub(super) struct Work(Arc<Activity>);

impl Seat {
    /// Takes the seat, if it becomes free in time.
    pub(super) async fn take(&self, patience: LinkPatience) -> Option<Seated> {
        let holder = self.lock_holder().clone();
        if let Some(holder) = holder
            && holder.is_silent(patience.silence)
        {
            tracing::warn!(
                "a client of the capture link was silent for {:?} and loses its seat to another one",
                patience.silence
            );
            holder.leave.notify_one();
        }
        let place = timeout(patience.seat, self.place.clone().lock_owned()).await;
        let activity = Arc::new(Activity::new());
        let seated = Seated {
            activity: activity.clone(),
            _place: place.ok()?,
        };
        *self.lock_holder() = Some(activity);
        Some(seated)
    }

    fn lock_holder(&self) -> std::sync::MutexGuard<'_, Option<Arc<Activity>>> {
        self.holder.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Activity {
    fn new() -> Self {
        Self {
            state: StdMutex::new(State {
                working: 0,
                last: Instant::now(),
            }),
            leave: Notify::new(),
        }
    }

    /// The client sent or read something.
    pub(super) fn heard(&self) {
        self.lock().last = Instant::now();
    }

    /// A request is in progress from now on.
    pub(super) fn work(self: &Arc<Self>) -> Work {
        self.lock().working += 1;
        Work(self.clone())
    }

    /// Waits until the client has to leave for the next one.
    pub(super) async fn has_to_leave(&self) {
        self.leave.notified().await;
    }

    fn is_silent(&self, silence: Duration) -> bool {
        let state = self.lock();
        state.working == 0 && state.last.elapsed() >= silence
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Work {
    fn drop(&mut self) {
        let mut state = self.0.lock();
        state.working -= 1;
        state.last = Instant::now();
    }
}

#[cfg(test)]
mod tests {
    use tokio::time::advance;

    use super::*;

    #[tokio::test(start_paused = true)]
    async fn a_silent_client_leaves_for_the_next_one_and_a_busy_or_lonely_one_stays() {
        let patience = LinkPatience::default();
        let almost = patience.silence - patience.seat - Duration::from_secs(1);
        let seat = Seat::default();
        let first = seat.take(patience).await.unwrap();
        let leaves = async |seated: &Seated| {
            timeout(Duration::ZERO, seated.activity.has_to_leave())
                .await
                .is_ok()
        };
        // The seat is not in demand.
        advance(10 * patience.silence).await;
        assert!(!leaves(&first).await);
        first.activity.heard();
        advance(almost).await;
        assert!(seat.take(patience).await.is_none());
        assert!(!leaves(&first).await);
        // It waits for us, not we for it.
        let work = first.activity.work();
        advance(10 * patience.silence).await;
        assert!(seat.take(patience).await.is_none());
        assert!(!leaves(&first).await);
        drop(work);
        advance(2 * patience.silence).await;
        let (second, ()) = tokio::join!(seat.take(patience), async {
            first.activity.has_to_leave().await;
            drop(first);
        });
        assert!(!leaves(&second.unwrap()).await);
    }
}
