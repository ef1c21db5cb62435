//! Retries for a store that does not answer, and progress reports.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use tokio::time::sleep;

use crate::error::{Result, StoreError};

const FIRST_PAUSE: Duration = Duration::from_millis(500);
const LONGEST_PAUSE: Duration = Duration::from_secs(30);
/// Cancellation is noticed within this time while waiting.
const LOOK_UP: Duration = Duration::from_millis(100);

/// How long to wait for a store that does not answer, counted from the last byte transferred.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Patience(pub Duration);

/// Observer of a transfer.
pub trait Watch: Sync {
    /// This many more bytes were transferred.
    fn passed(&self, _bytes: u64) {}
    /// The store does not answer and is being retried. Reported once per interruption.
    fn waiting(&self, _reason: &StoreError) {}
    /// Whether to stop.
    fn stopped(&self) -> bool {
        false
    }
}

/// Nobody watches.
impl Watch for () {}

/// Counts the bytes.
struct Counting<'a> {
    watch: &'a dyn Watch,
    bytes: AtomicU64,
}

impl Watch for Counting<'_> {
    fn passed(&self, bytes: u64) {
        self.bytes.fetch_add(bytes, Ordering::Relaxed);
        self.watch.passed(bytes);
    }

    fn waiting(&self, reason: &StoreError) {
        self.watch.waiting(reason);
    }

    fn stopped(&self) -> bool {
        self.watch.stopped()
    }
}

impl Patience {
    /// Repeats `attempt` with growing delays while the store does not answer. An attempt resumes where the last one stopped, so the
    /// waiting time restarts after every progress.
    pub async fn with<T>(
        self,
        watch: &dyn Watch,
        mut attempt: impl AsyncFnMut(&dyn Watch) -> Result<T>,
    ) -> Result<T> {
        let counting = Counting {
            watch,
            bytes: AtomicU64::new(0),
        };
        let mut passed = 0;
        let mut waiting_since: Option<Instant> = None;
        let mut pause = FIRST_PAUSE;
        loop {
            let began = Instant::now();
            let error = match attempt(&counting).await {
                Err(error) if error.is_passing() => error,
                other => return other,
            };
            let now_passed = counting.bytes.load(Ordering::Relaxed);
            if now_passed > passed {
                passed = now_passed;
                waiting_since = None;
                pause = FIRST_PAUSE;
            }
            if waiting_since.is_none() {
                watch.waiting(&error);
            }
            let since = *waiting_since.get_or_insert(began);
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
