//! Retries for a store that does not answer, and progress reports.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use tokio::time::sleep;

use crate::error::{Result, StoreError};

const FIRST_PAUSE: Duration = Duration::from_millis(500);
const LONGEST_PAUSE: Duration = Duration::from_secs(30);
/// Cancellation is noticed within this time while waiting.
const LOOK_UP: Duration = Duration::from_millis(100);

/// Timeout for a store that does not answer, counted from the last byte transferred.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Patience(pub Duration);

/// Observer of a transfer.
pub trait Watch: Sync {
    /// Of the scenarios of a corpus, `done` of `total` are transferred, and this one is next.
    fn scenario(&self, _id: &str, _done: usize, _total: usize) {}
    /// This many more bytes were transferred.
    fn passed(&self, _bytes: u64) {}
    /// A file was transferred completely: no later attempt transfers it again.
    fn kept(&self) {}
    /// The store does not answer and is being retried. Reported once per interruption.
    fn waiting(&self, _reason: &StoreError) {}
    /// Returns true to stop the transfer.
    fn stopped(&self) -> bool {
        false
    }
}

/// No observer.
impl Watch for () {}

/// Measures how far an attempt gets.
struct Counting<'a> {
    watch: &'a dyn Watch,
    /// Files that are complete, of all attempts.
    kept: AtomicU64,
    /// Bytes of this attempt since the last complete file. A next attempt transfers them again.
    unkept_bytes: AtomicU64,
}

impl Watch for Counting<'_> {
    fn passed(&self, bytes: u64) {
        self.unkept_bytes.fetch_add(bytes, Ordering::Relaxed);
        self.watch.passed(bytes);
    }

    fn kept(&self) {
        self.kept.fetch_add(1, Ordering::Relaxed);
        self.unkept_bytes.store(0, Ordering::Relaxed);
        self.watch.kept();
    }

    fn waiting(&self, reason: &StoreError) {
        self.watch.waiting(reason);
    }

    fn stopped(&self) -> bool {
        self.watch.stopped()
    }
}

impl Patience {
    /// Repeats `attempt` with growing delays while the store does not answer. An attempt resumes where the last one stopped: the
    /// waiting time restarts if it completes a file, or gets further into one than any attempt before. Bytes that are transferred
    /// again are no progress: a store that always breaks off at the same place would be retried forever.
    pub async fn with<T>(
        self,
        watch: &dyn Watch,
        mut attempt: impl AsyncFnMut(&dyn Watch) -> Result<T>,
    ) -> Result<T> {
        let counting = Counting {
            watch,
            kept: AtomicU64::new(0),
            unkept_bytes: AtomicU64::new(0),
        };
        let (mut kept, mut furthest_bytes) = (0, 0);
        let mut waiting_since: Option<Instant> = None;
        let mut pause = FIRST_PAUSE;
        loop {
            let began = Instant::now();
            counting.unkept_bytes.store(0, Ordering::Relaxed);
            let error = match attempt(&counting).await {
                Err(error) if error.is_passing() => error,
                other => return other,
            };
            let now_kept = counting.kept.load(Ordering::Relaxed);
            let now_bytes = counting.unkept_bytes.load(Ordering::Relaxed);
            let got_further = now_kept > kept || now_bytes > furthest_bytes;
            if now_kept > kept {
                furthest_bytes = 0;
            }
            (kept, furthest_bytes) = (now_kept, furthest_bytes.max(now_bytes));
            if got_further {
                waiting_since = None;
                pause = FIRST_PAUSE;
            }
            if waiting_since.is_none() {
                watch.waiting(&error);
            }
            let since =
                *waiting_since.get_or_insert(if got_further { Instant::now() } else { began });
            if since.elapsed() + pause > self.0 {
                return Err(error);
            }
            let until = Instant::now() + pause;
            while Instant::now() < until {
                if watch.stopped() {
                    return Err(StoreError::Stopped);
                }
                sleep(LOOK_UP.min(until.saturating_duration_since(Instant::now()))).await;
            }
            pause = (pause * 2).min(LONGEST_PAUSE);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicU32;

    fn away() -> StoreError {
        StoreError::Away {
            url: "s3://bucket".into(),
            doing: "list".into(),
            message: "connection refused".into(),
        }
    }

    struct Listener {
        told: AtomicU32,
        stop: bool,
    }

    impl Watch for Listener {
        fn waiting(&self, _reason: &StoreError) {
            self.told.fetch_add(1, Ordering::Relaxed);
        }

        fn stopped(&self) -> bool {
            self.stop
        }
    }

    fn listener(stop: bool) -> Listener {
        Listener {
            told: AtomicU32::new(0),
            stop,
        }
    }

    #[tokio::test(start_paused = true)]
    async fn a_store_that_comes_back_is_waited_for_and_it_is_said_once() {
        let mut tries = 0;
        let listener = listener(false);
        let done = Patience(Duration::from_secs(60))
            .with(&listener, async |_| {
                tries += 1;
                if tries < 3 { Err(away()) } else { Ok(tries) }
            })
            .await;
        assert_eq!(done.unwrap(), 3);
        assert_eq!(listener.told.load(Ordering::Relaxed), 1);
    }

    #[tokio::test]
    async fn patience_ends_with_the_last_error_and_begins_anew_when_something_passes() {
        let mut tries = 0;
        let listener = listener(false);
        let error = Patience(Duration::from_millis(600))
            .with(&listener, async |watch: &dyn Watch| {
                tries += 1;
                if tries == 2 {
                    watch.passed(5);
                }
                Err::<(), _>(away())
            })
            .await
            .unwrap_err();
        assert!(error.is_passing());
        // The second attempt made progress: it was reported again, and a third was made.
        assert_eq!((tries, listener.told.load(Ordering::Relaxed)), (3, 2));
    }

    #[tokio::test]
    async fn bytes_that_are_transferred_again_and_again_are_no_progress() {
        let mut tries = 0;
        // Complete files are: the second attempt gets further with fewer bytes.
        let error = Patience(Duration::from_millis(600))
            .with(&(), async |watch: &dyn Watch| {
                tries += 1;
                watch.passed(if tries == 1 { 7 } else { 5 });
                if tries == 2 {
                    watch.kept();
                    watch.passed(5);
                }
                Err::<(), _>(away())
            })
            .await
            .unwrap_err();
        assert!(error.is_passing());
        assert_eq!(tries, 3);
    }

    #[tokio::test]
    async fn what_will_not_pass_is_not_repeated_and_a_wish_to_stop_is_heard() {
        let mut tries = 0;
        let refused = Patience(Duration::from_secs(60))
            .with(&(), async |_| {
                tries += 1;
                Err::<(), _>(StoreError::Refused {
                    url: String::new(),
                    doing: String::new(),
                    message: String::new(),
                })
            })
            .await;
        assert!(matches!(refused, Err(StoreError::Refused { .. })));
        assert_eq!(tries, 1);
        let stopped = Patience(Duration::from_secs(60))
            .with(&listener(true), async |_| Err::<(), _>(away()))
            .await;
        assert!(matches!(stopped, Err(StoreError::Stopped)));
    }
}
